"""The doctor's checks of the computer itself: terminal, real time, disk and clock."""

from __future__ import annotations

import ctypes
import os
import resource
import shutil
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from app.diagnostics.doctor_codes import DoctorFinding, Remedy, Subject, run
from app.diagnostics.findings import Finding, bad, good, note
from app.system.config import Config
from app.system.paths import Home
from app.system.scheduling import SCHEDULING, WAKE_LATENCY
from logs.reason import reason

DISK_NEEDED_GB = 2.0
DISK_NEEDED_ON_CAN_GB = 6.0  # 8 h of bus logs, 0.65 GB an hour, and the half gigabyte that they leave to others
_RT_PRIORITY = 80
_TIME_ERROR = 5  # adjtimex(2): the clock is not synchronised
_TIMEX_BYTES = 512  # struct timex has 208; modes = 0 only reads
_LIMITS_FILE = "/etc/security/limits.d/rleex.conf"
_LIMITS_COMMAND = (
    f'printf \'%s - rtprio {_RT_PRIORITY}\\n%s - memlock unlimited\\n\' "$USER" "$USER" | sudo tee {_LIMITS_FILE}'
)
_WAKE_COMMAND = """echo 'KERNEL=="cpu_dma_latency", GROUP="plugdev", MODE="0660"' | \
sudo tee /etc/udev/rules.d/81-rleex.rules"""
_TRUE_COLOUR = ("truecolor", "24bit")
_PICTURE_TERMS = ("kitty", "ghostty", "wezterm", "foot", "mlterm")
F, R, T = DoctorFinding, Remedy, Subject


def check_terminal(environment: Mapping[str, str], *, is_terminal: bool) -> Iterator[Finding]:
    """Whether the terminal can show the camera's image, and its locale."""
    term = environment.get("TERM", "dumb")
    if not is_terminal:
        yield note(T.TERMINAL, reason(F.OUTPUT_TO_FILE))
        return
    if any(name in term or name in environment.get("TERM_PROGRAM", "").lower() for name in _PICTURE_TERMS):
        yield good(T.TERMINAL, F.PICTURES_FULL, term=term)
    elif environment.get("COLORTERM", "") in _TRUE_COLOUR or "direct" in term:
        yield good(T.TERMINAL, F.PICTURES_TRUE_COLOUR, term=term)
    elif "256color" in term:
        yield note(T.TERMINAL, reason(F.PICTURES_256_COLOURS, term=term), run("export COLORTERM=truecolor"))
    else:
        yield note(T.TERMINAL, reason(F.NO_PICTURES, term=term), reason(R.BETTER_TERMINAL))
    language = environment.get("LC_ALL") or environment.get("LC_CTYPE") or environment.get("LANG", "")
    if "utf" not in language.lower():
        yield note(T.TERMINAL, reason(F.LOCALE_NOT_UTF8), run("export LANG=C.UTF-8"))


def check_real_time() -> Iterator[Finding]:
    """SCHED_FIFO and locked memory for control."""
    remedy = reason(R.RUN_THEN_LOG_IN, command=_LIMITS_COMMAND)
    if _may_be_fifo():
        yield good(T.REAL_TIME, F.FIFO_ALLOWED)
    else:
        yield note(T.REAL_TIME, reason(F.FIFO_NOT_ALLOWED), remedy)
    soft, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    if os.geteuid() != 0 and soft != resource.RLIM_INFINITY:
        yield note(T.REAL_TIME, reason(F.MEMORY_LIMITED, kibibytes=soft // 1024), remedy)
    if os.access(WAKE_LATENCY, os.W_OK):
        yield good(T.REAL_TIME, F.WAKE_LATENCY_ALLOWED)
    else:
        wake = reason(R.RUN_THEN_RESTART, command=_WAKE_COMMAND)
        yield note(T.REAL_TIME, reason(F.WAKE_LATENCY_NOT_ALLOWED, path=WAKE_LATENCY), wake)
    cores = len(os.sched_getaffinity(0))
    if cores < 2:
        yield bad(T.REAL_TIME, reason(F.ONE_CORE), reason(R.SECOND_CORE))
    else:
        yield good(T.REAL_TIME, F.CORES, cores=cores)


def _may_be_fifo() -> bool:
    policy, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(max(one.fifo or 0 for one in SCHEDULING.values())))
    except PermissionError:
        return False
    os.sched_setscheduler(0, policy, parameters)
    return True


def check_disk(
    home: Home, config: Config, free_bytes: Callable[[Path], int] = lambda folder: shutil.disk_usage(folder).free
) -> Iterator[Finding]:
    """Room for a day of sessions, in a place that only this user reads."""
    place = next(path for path in (home.root, *home.root.parents) if path.exists())
    if not os.access(place, os.W_OK):
        yield bad(T.DISK, reason(F.DISK_NOT_WRITABLE, path=place), reason(R.OTHER_HOME))
        return
    free_gb = free_bytes(place) / 1e9
    has_bus_logs = config.joints.kind == "can" and not config.joints.host
    needed_gb = DISK_NEEDED_ON_CAN_GB if has_bus_logs else DISK_NEEDED_GB
    if free_gb < needed_gb:
        low = reason(F.DISK_LOW, free_gb=free_gb, path=place, needed_gb=needed_gb)
        yield bad(T.DISK, low, reason(R.FREE_DISK, path=place))
    else:
        yield good(T.DISK, F.DISK_FREE, free_gb=free_gb, path=place)
    if home.keys.exists() and home.keys.stat().st_mode & 0o077:
        yield bad(T.DISK, reason(F.KEYS_READABLE_BY_OTHERS, path=home.keys), run(f"chmod 700 {home.keys}"))


def check_clock() -> Iterator[Finding]:
    """The wall clock is synchronised (the audit trail uses it), the monotonic clock is a quick one."""
    state = _clock_state()
    if state == _TIME_ERROR:
        yield note(T.CLOCK, reason(F.CLOCK_NOT_SYNCHRONISED), run("sudo timedatectl set-ntp true"))
    elif state < 0:
        yield note(T.CLOCK, reason(F.CLOCK_UNKNOWN))
    else:
        yield good(T.CLOCK, F.CLOCK_SYNCHRONISED)
    source = Path("/sys/devices/system/clocksource/clocksource0/current_clocksource")
    name = source.read_text().strip() if source.exists() else ""
    if name in ("hpet", "acpi_pm"):
        yield note(T.CLOCK, reason(F.CLOCK_SOURCE_SLOW, name=name), reason(R.BOOT_WITH_TSC))


def _clock_state() -> int:
    try:
        libc = ctypes.CDLL(None, use_errno=True)
        return int(libc.adjtimex(ctypes.create_string_buffer(_TIMEX_BYTES)))
    except (OSError, AttributeError):
        return -1
