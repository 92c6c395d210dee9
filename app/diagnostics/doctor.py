"""Is this machine fit for a session? Each finding comes with the command that repairs it."""

from __future__ import annotations

import ctypes
import os
import resource
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from enum import Enum
from pathlib import Path

from app.diagnostics.findings import Finding, bad, good, note
from app.link.wire import LinkFault
from app.system.config import Config, load_config
from app.system.errors import AppError
from app.system.hand_model import ModelFault, find_model
from app.system.paths import Home
from app.system.scheduling import SCHEDULING, WAKE_LATENCY
from app.voice.spotter import require_spotter
from hal.errors import HardwareError
from hal.inputs.device import Contact, InputDevice, StopInput
from hal.inputs.reader import InputReader, make_input
from hal.microphone import make_microphone
from logs.reason import Reason, reason, reason_of

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
MICROPHONE_BLOCKS = 10  # a second
_TRUE_COLOUR = ("truecolor", "24bit")
_PICTURE_TERMS = ("kitty", "ghostty", "wezterm", "foot", "mlterm")


class Subject(Enum):
    """What is examined."""

    SETTINGS = "settings"
    MODEL = "model"
    CAMERA = "camera"
    REALSENSE = "RealSense"
    TERMINAL = "terminal"
    REAL_TIME = "real time"
    DISK = "disk"
    CLOCK = "clock"
    JOINTS = "joints"
    STOP_BUTTON = "stop button"
    VOICE = "voice stop"
    LINK = "link"


class DoctorFinding(Enum):
    """What is found of a machine."""

    MODEL_FOUND = "model found"
    CAMERAS_READABLE = "cameras readable"
    CAMERA_NOT_PERMITTED = "camera not permitted"
    CAMERA_MISSING = "camera missing"
    CAMERA_NOT_NEEDED = "camera not needed"
    REALSENSE_LOADED = "RealSense loaded"
    REALSENSE_NOT_INSTALLED = "RealSense not installed"
    REALSENSE_NOT_LOADED = "RealSense not loaded"
    OUTPUT_TO_FILE = "output to a file"
    PICTURES_FULL = "pictures in full resolution"
    PICTURES_TRUE_COLOUR = "pictures in true colour"
    PICTURES_256_COLOURS = "pictures in 256 colours"
    NO_PICTURES = "no pictures"
    LOCALE_NOT_UTF8 = "locale not UTF-8"
    FIFO_ALLOWED = "FIFO allowed"
    FIFO_NOT_ALLOWED = "FIFO not allowed"
    MEMORY_LIMITED = "memory limited"
    WAKE_LATENCY_ALLOWED = "wake latency allowed"
    WAKE_LATENCY_NOT_ALLOWED = "wake latency not allowed"
    ONE_CORE = "one core"
    CORES = "cores"
    DISK_NOT_WRITABLE = "disk not writable"
    DISK_LOW = "disk low"
    DISK_FREE = "disk free"
    KEYS_READABLE_BY_OTHERS = "keys readable by others"
    CLOCK_NOT_SYNCHRONISED = "clock not synchronised"
    CLOCK_UNKNOWN = "clock unknown"
    CLOCK_SYNCHRONISED = "clock synchronised"
    CLOCK_SOURCE_SLOW = "clock source slow"
    JOINTS_SIMULATED = "joints simulated"
    NO_STOP_BUTTON = "no stop button"
    STOP_BUTTON_SIMULATED = "stop button simulated"
    STOP_BUTTON_CLOSED = "stop button closed"
    STOP_BUTTON_OPEN = "stop button open"
    STOP_BUTTON_SILENT = "stop button silent"
    VOICE_OFF = "voice off"
    MICROPHONE_FOUND = "microphone found"
    MICROPHONE_MUTE = "microphone mute"
    LINK_ANSWERS = "link answers"


class Remedy(Enum):
    """What to do."""

    RUN = "run"
    RUN_THEN_LOG_IN = "run, then log in"
    RUN_THEN_RESTART = "run, then restart"
    EDIT_SETTINGS = "edit the settings"
    PLUG_IN = "plug in"
    BETTER_TERMINAL = "better terminal"
    SECOND_CORE = "second core"
    OTHER_HOME = "other home"
    FREE_DISK = "free the disk"
    BOOT_WITH_TSC = "boot with tsc"
    RELEASE_BUTTON = "release the button"
    CONNECT_BUTTON = "connect the button"
    CHECK_OTHER_COMPUTER = "check the other computer"
    UPDATE_OLDER = "update the older one"


F, R, T = DoctorFinding, Remedy, Subject


def run(command: str) -> Reason:
    """The remedy that is a command."""
    return reason(R.RUN, command=command)


def examine(home: Home) -> Iterator[Finding]:
    """Every check, one after the other."""
    try:
        config = load_config(home.config)
    except AppError as error:
        yield bad(T.SETTINGS, reason_of(error), reason(R.EDIT_SETTINGS, path=home.config))
        config = Config()
    yield from check_model(home, config)
    yield from check_cameras(config)
    yield from check_realsense(config)
    yield from check_terminal(os.environ, is_terminal=sys.stdout.isatty())
    yield from check_real_time()
    yield from check_disk(home, config)
    yield from check_clock()
    yield from check_joints(config)
    yield from check_stop_buttons(config)
    yield from check_voice(config)
    yield from check_link(home, config)


def check_model(home: Home, config: Config) -> Iterator[Finding]:
    """The hand model is there and the one that was checked; a computer that serves joints needs none."""
    try:
        yield good(T.MODEL, F.MODEL_FOUND, path=find_model(home, config))
    except AppError as error:
        remedies: dict[Enum, Reason] = {
            ModelFault.DAMAGED: run("rleex model --again"),
            ModelFault.CONFIGURED_MISSING: reason(R.EDIT_SETTINGS, path=home.config),
        }
        grade = note if _serves_joints(home, config) else bad
        yield grade(T.MODEL, reason_of(error), remedies.get(error.code, run("rleex model")))


def _serves_joints(home: Home, config: Config) -> bool:
    """Whether a laptop is paired, which runs perception; keys that can't be read tell of none."""
    from app.link.keys import peers_of

    with suppress(AppError):
        return not config.joints.host and any(not peer.host for peer in peers_of(home))
    return False


def check_cameras(config: Config, devices: Path = Path("/dev")) -> Iterator[Finding]:
    """Video devices, and whether this user may read them."""
    found = sorted(devices.glob("video*"))
    readable = [path for path in found if os.access(path, os.R_OK | os.W_OK)]
    needed = config.camera.kind == "webcam"
    if readable:
        yield good(T.CAMERA, F.CAMERAS_READABLE, devices=", ".join(map(str, readable)))
    elif found:
        remedy = reason(R.RUN_THEN_LOG_IN, command=f"sudo usermod -aG video {os.environ.get('USER', '$USER')}")
        yield (bad if needed else note)(T.CAMERA, reason(F.CAMERA_NOT_PERMITTED, device=found[0]), remedy)
    elif needed:
        yield bad(T.CAMERA, reason(F.CAMERA_MISSING), reason(R.PLUG_IN))
    else:
        yield note(T.CAMERA, reason(F.CAMERA_NOT_NEEDED, kind=Reason(f"camera.{config.camera.kind}")))


def check_realsense(config: Config) -> Iterator[Finding]:
    """The RealSense library can be loaded."""
    grade = bad if config.camera.kind == "realsense" else note
    try:
        import pyrealsense2
    except ImportError as error:
        if "libusb" in str(error):
            install = run("sudo apt-get install libusb-1.0-0")
            yield grade(T.REALSENSE, reason(F.REALSENSE_NOT_LOADED, detail=str(error)), install)
        else:
            install = run(".venv/bin/python -m pip install --no-deps pyrealsense2")
            yield grade(T.REALSENSE, reason(F.REALSENSE_NOT_INSTALLED), install)
        return
    yield good(T.REALSENSE, F.REALSENSE_LOADED, version=getattr(pyrealsense2, "__version__", "?"))


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


def check_link(home: Home, config: Config) -> Iterator[Finding]:
    """The computer that has the joints: whether it answers, its version, its clock, and whether they are paired."""
    host = config.joints.host
    if not host:
        return
    from app.link.keys import PEERS, joints_at
    from app.link.questions import check_version, find

    try:
        found = find(host)
    except AppError as error:
        yield bad(T.LINK, reason_of(error), reason(R.CHECK_OTHER_COMPUTER))
        return
    try:
        check_version(host, found.link, found.program)
    except AppError as error:
        yield bad(T.LINK, reason_of(error), reason(R.UPDATE_OLDER))
        return
    values = {"round_trip_ms": found.round_trip_ns / 1e6, "uncertainty_ms": found.uncertainty_ns / 1e6}
    yield good(T.LINK, F.LINK_ANSWERS, host=host, version=found.program, offset_s=found.offset_ns / 1e9, **values)
    pair = f"rleex link pair {host}"
    try:
        if joints_at(home, host) is None:
            yield bad(T.LINK, reason(LinkFault.NOT_PAIRED, host=host), run(pair))
    except AppError as error:
        yield bad(T.LINK, reason_of(error), run(f"rm {home.link_keys / PEERS} && {pair}"))


def check_joints(config: Config) -> Iterator[Finding]:
    """The joints' buses, without asking the drives: `rleex can doctor` does."""
    if config.joints.host:
        return
    if config.joints.kind != "can":
        yield note(T.JOINTS, reason(F.JOINTS_SIMULATED))
        return
    from app.diagnostics.can_doctor import examine as examine_can
    from app.system.config import load_device
    from hal.joints.can.bus import with_bus

    chosen = config.joints
    try:
        device = with_bus(load_device(chosen), chosen.interface, chosen.channel)
    except HardwareError as error:
        yield bad(T.JOINTS, reason_of(error), None)  # it says itself what to do
        return
    yield from examine_can(device, Path(chosen.motors) if chosen.motors else None, ask=False)


def check_stop_buttons(
    config: Config, make: Callable[[InputDevice, Path], StopInput] = make_input
) -> Iterator[Finding]:
    """Whether the contact of each stop button is closed now, on the computer that reads them: the joints'."""
    if config.joints.host:
        return
    if not config.inputs:
        yield note(T.STOP_BUTTON, reason(F.NO_STOP_BUTTON))
        return
    devices = tuple(device for device in config.inputs if device.kind != "simulated")
    for device in config.inputs:
        if device not in devices:
            yield note(T.STOP_BUTTON, reason(F.STOP_BUTTON_SIMULATED, name=device.name))
    reader = InputReader(devices, tuple(make(device, Path()) for device in devices))
    try:
        reader.start()
        readings = reader.newest.inputs
    finally:
        reader.close()
    for one in readings:
        values = {"name": one.name, "role": one.role}
        if one.contact is Contact.CLOSED:
            yield good(T.STOP_BUTTON, F.STOP_BUTTON_CLOSED, **values)
        elif one.contact is Contact.OPEN:
            yield bad(T.STOP_BUTTON, reason(F.STOP_BUTTON_OPEN, **values), reason(R.RELEASE_BUTTON))
        else:
            why = reason(F.STOP_BUTTON_SILENT, **values) if one.fault is None else reason_of(one.fault)
            yield bad(T.STOP_BUTTON, why, reason(R.CONNECT_BUTTON, name=one.name))


def check_voice(config: Config) -> Iterator[Finding]:
    """Whether a microphone is there and gives sound; a session is fit without it."""
    voice = config.voice
    if not voice.on:
        yield note(T.VOICE, reason(F.VOICE_OFF))
        return
    microphone, device = make_microphone(voice, lambda: None), voice.device or "default"
    try:
        require_spotter()
        microphone.open()
        sound = any(any(microphone.read()) for _ in range(MICROPHONE_BLOCKS))
    except HardwareError as error:
        yield note(T.VOICE, reason_of(error))
        return
    finally:
        microphone.close()
    if sound:
        yield good(T.VOICE, F.MICROPHONE_FOUND, device=device)
    else:
        yield note(T.VOICE, reason(F.MICROPHONE_MUTE, device=device))
