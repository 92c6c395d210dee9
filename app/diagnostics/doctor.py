"""Is this machine fit for a session? Each finding comes with the command that mends it."""

from __future__ import annotations

import ctypes
import os
import resource
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from app.diagnostics.findings import Finding, bad, good, note
from app.system.config import Config, load_config
from app.system.errors import AppError
from app.system.hand_model import find_model
from app.system.paths import Home
from app.system.scheduling import WAKE_LATENCY
from hal.errors import HardwareError

DISK_NEEDED_GB = 2.0  # a day of sessions on CAN, the bus logs included
MODEL_REMEDY = "rleex model"
_RT_PRIORITY = 80
_TIME_ERROR = 5  # adjtimex(2): the clock is not synchronised
_TIMEX_BYTES = 512  # struct timex has 208; modes = 0 only reads
_LIMITS_FILE = "/etc/security/limits.d/rleex.conf"
_WAKE_REMEDY = """echo 'KERNEL=="cpu_dma_latency", GROUP="plugdev", MODE="0660"' | \
sudo tee /etc/udev/rules.d/81-rleex.rules  (then restart the machine)"""
_TRUE_COLOUR = ("truecolor", "24bit")
_PICTURE_TERMS = ("kitty", "ghostty", "wezterm", "foot", "mlterm")


def examine(home: Home) -> Iterator[Finding]:
    """Look at everything, one after the other."""
    try:
        config = load_config(home.config)
    except AppError as error:
        yield bad("settings", str(error), f"edit or remove {home.config}")
        config = Config()
    checks: tuple[Callable[[], Iterator[Finding]], ...] = (
        lambda: check_model(home, config),
        lambda: check_cameras(config),
        lambda: check_realsense(config),
        lambda: check_terminal(os.environ, is_terminal=sys.stdout.isatty()),
        check_real_time,
        lambda: check_disk(home),
        check_clock,
        lambda: check_joints(config),
    )
    for check in checks:
        yield from check()


def check_model(home: Home, config: Config) -> Iterator[Finding]:
    """The hand model is there and the one that was checked."""
    try:
        yield good("model", str(find_model(home, config)))
    except AppError as error:
        yield bad("model", str(error), MODEL_REMEDY)


def check_cameras(config: Config, devices: Path = Path("/dev")) -> Iterator[Finding]:
    """Video devices, and whether this user may read them."""
    found = sorted(devices.glob("video*"))
    readable = [path for path in found if os.access(path, os.R_OK | os.W_OK)]
    needed = config.camera.kind == "webcam"
    if readable:
        yield good("camera", ", ".join(map(str, readable)))
    elif found:
        remedy = f"sudo usermod -aG video {os.environ.get('USER', '$USER')}  (then log in again)"
        yield (bad if needed else note)("camera", f"{found[0]} may not be opened by this user", remedy)
    elif needed:
        yield bad("camera", "the configuration names a webcam, but there is no video device", "plug it in: lsusb")
    else:
        yield note("camera", f"no webcam; the configuration uses the {config.camera.kind}")


def check_realsense(config: Config) -> Iterator[Finding]:
    """The RealSense library can be loaded."""
    grade = bad if config.camera.kind == "realsense" else note
    try:
        import pyrealsense2
    except ImportError as error:
        if "libusb" in str(error):
            yield grade("RealSense", str(error), "sudo apt-get install libusb-1.0-0")
        else:
            yield grade("RealSense", "pyrealsense2 is not installed", "pip install 'rleex[realsense]'")
        return
    yield good("RealSense", f"library {getattr(pyrealsense2, '__version__', '?')}")


def check_terminal(environment: Mapping[str, str], *, is_terminal: bool) -> Iterator[Finding]:
    """Whether the terminal can show the camera's picture, and in which letters."""
    term = environment.get("TERM", "dumb")
    if not is_terminal:
        yield note("terminal", "the output goes to a file: what the terminal can do was not looked at")
        return
    if any(name in term or name in environment.get("TERM_PROGRAM", "").lower() for name in _PICTURE_TERMS):
        yield good("terminal", f"{term}: pictures in full resolution")
    elif environment.get("COLORTERM", "") in _TRUE_COLOUR or "direct" in term:
        yield good("terminal", f"{term}: pictures in half blocks, all colours")
    elif "256color" in term:
        yield note("terminal", f"{term}: pictures in 256 colours", "export COLORTERM=truecolor  (if it can)")
    else:
        yield note("terminal", f"{term}: no pictures", "use a terminal with true colour, e.g. kitty or gnome-terminal")
    language = environment.get("LC_ALL") or environment.get("LC_CTYPE") or environment.get("LANG", "")
    if "utf" not in language.lower():
        yield note("terminal", "the locale is not UTF-8: frames and marks may look odd", "export LANG=C.UTF-8")


def check_real_time() -> Iterator[Finding]:
    """SCHED_FIFO and locked memory for control."""
    remedy = (
        f'printf \'%s - rtprio {_RT_PRIORITY}\\n%s - memlock unlimited\\n\' "$USER" "$USER" | '
        f"sudo tee {_LIMITS_FILE}  (then log in again)"
    )
    if _may_be_fifo():
        yield good("real time", "SCHED_FIFO is allowed")
    else:
        yield note("real time", "no SCHED_FIFO: ticks are late while the machine is busy", remedy)
    soft, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    if os.geteuid() != 0 and soft != resource.RLIM_INFINITY:
        yield note("real time", f"only {soft // 1024} KiB of memory may be locked", remedy)
    if os.access(WAKE_LATENCY, os.W_OK):
        yield good("real time", "idle cores can be kept awake")
    else:
        yield note("real time", f"{WAKE_LATENCY} may not be written: a core that fell asleep is late", _WAKE_REMEDY)
    cores = len(os.sched_getaffinity(0))
    if cores < 2:
        yield bad("real time", "one core: control and perception need one each", "give the machine a second core")
    else:
        yield good("real time", f"{cores} cores")


def _may_be_fifo() -> bool:
    policy, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    except PermissionError:
        return False
    os.sched_setscheduler(0, policy, parameters)
    return True


def check_disk(home: Home) -> Iterator[Finding]:
    """Room for the audit trail, in a place that only this user reads."""
    place = next(path for path in (home.root, *home.root.parents) if path.exists())
    if not os.access(place, os.W_OK):
        yield bad("disk", f"{place} can't be written", "choose another --home, or RLEEX_HOME")
        return
    free_gb = shutil.disk_usage(place).free / 1e9
    if free_gb < DISK_NEEDED_GB:
        yield bad("disk", f"{free_gb:.1f} GB free at {place}, {DISK_NEEDED_GB:.0f} are needed", f"make room on {place}")
    else:
        yield good("disk", f"{free_gb:.1f} GB free at {place}")
    if home.keys.exists() and home.keys.stat().st_mode & 0o077:
        yield bad("disk", f"{home.keys} may be read by others", f"chmod 700 {home.keys}")


def check_clock() -> Iterator[Finding]:
    """The wall clock is synchronised (the audit trail tells by it), the monotonic clock is a quick one."""
    state = _clock_state()
    if state == _TIME_ERROR:
        yield note("clock", "not synchronised: the audit trail's times may be off", "sudo timedatectl set-ntp true")
    elif state < 0:
        yield note("clock", "could not be asked whether it is synchronised")
    else:
        yield good("clock", "synchronised")
    source = Path("/sys/devices/system/clocksource/clocksource0/current_clocksource")
    name = source.read_text().strip() if source.exists() else ""
    if name in ("hpet", "acpi_pm"):
        yield note("clock", f"slow clock source {name}", "boot with clocksource=tsc, if the processor has a steady one")


def _clock_state() -> int:
    try:
        libc = ctypes.CDLL(None, use_errno=True)
        return int(libc.adjtimex(ctypes.create_string_buffer(_TIMEX_BYTES)))
    except (OSError, AttributeError):
        return -1


def check_joints(config: Config) -> Iterator[Finding]:
    """The joints' buses, without asking the drives: `rleex can doctor` does."""
    if config.joints.kind != "can":
        yield note("joints", "the configuration uses simulated joints")
        return
    from app.diagnostics.can_doctor import examine as examine_can
    from hal.joints.can.bus import with_bus
    from hal.joints.device import DEFAULT_DEVICE, load_exoskeleton

    chosen = config.joints
    try:
        device = load_exoskeleton(Path(chosen.device) if chosen.device else DEFAULT_DEVICE)
    except HardwareError as error:
        yield bad("joints", str(error), "restore the device description")
        return
    device = with_bus(device, chosen.interface, chosen.channel)
    yield from examine_can(device, Path(chosen.motors) if chosen.motors else None, ask=False)
