"""What `rleex doctor` examines, what it can find, and what to do about it: the codes of its findings."""

from __future__ import annotations

from enum import Enum

from logs.reason import Reason, reason


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


def run(command: str) -> Reason:
    """The remedy that is a command."""
    return reason(Remedy.RUN, command=command)
