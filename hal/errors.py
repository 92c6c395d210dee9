"""What hardware refuses: codes with values. The wording is in the catalogues (`app/text`, domain hal)."""

from __future__ import annotations

from enum import Enum, auto

from logs.reading.errors import CodedError


class CameraFault(Enum):
    """Cameras and their intrinsics."""

    UNKNOWN_KIND = auto()
    NOT_OPEN = auto()
    NO_FRAMES = auto()
    NO_FIRST_FRAME = auto()
    UNPLUGGED = auto()
    NO_WEBCAM = auto()
    WEBCAM_NOT_FOUND = auto()
    WEBCAM_BUSY = auto()
    NO_REALSENSE_LIBRARY = auto()
    REALSENSE_NOT_FOUND = auto()
    REALSENSE_IS_ANOTHER = auto()
    REALSENSE_NOT_STARTED = auto()
    REALSENSE_RECORDING_DAMAGED = auto()
    REALSENSE_LOST = auto()
    REALSENSE_NO_COLOUR = auto()
    USB_TOO_SLOW = auto()
    RATE_OUT_OF_RANGE = auto()
    UNKNOWN_POSE = auto()
    CLICK_OUT_OF_RANGE = auto()
    FOCAL_LENGTH_OUT_OF_RANGE = auto()
    OTHER_RESOLUTION = auto()
    IMAGES_OTHER_SIZE = auto()
    FOCAL_LENGTH_OTHER_SIZE = auto()
    INTRINSICS_IMPOSSIBLE = auto()
    DEPTH_INTRINSICS_IMPOSSIBLE = auto()
    INTRINSICS_UNREADABLE = auto()
    INTRINSICS_UNWRITABLE = auto()
    TOO_FEW_CHESSBOARDS = auto()
    CHESSBOARDS_DISAGREE = auto()
    CHESSBOARDS_ALIKE = auto()
    SQUEEZED = auto()
    FACTORY_CALIBRATED = auto()
    IMAGE_SIZES_DIFFER = auto()
    CAMERA_NAME_MISSING = auto()


class RecordingFault(Enum):
    """Videos and folders of images as a camera."""

    NOT_NAMED = auto()
    NOT_FOUND = auto()
    FOLDER_NOT_FOUND = auto()
    FOLDER_UNREADABLE = auto()
    FOLDER_EMPTY = auto()
    EMPTY = auto()
    ENDED = auto()
    VIDEO_UNREADABLE = auto()
    IMAGE_UNREADABLE = auto()


class DeviceFault(Enum):
    """The device description, the motor table, and what they ask of joints."""

    DEVICE_UNREADABLE = auto()
    LIMIT_LOOSENED = auto()
    UNKNOWN_JOINTS_KIND = auto()
    NO_BODY = auto()
    UNKNOWN_JOINT = auto()
    MOTORS_UNREADABLE = auto()
    UNKNOWN_FAULT_NAME = auto()
    SEVERAL_MOTOR_VERSIONS = auto()
    UNKNOWN_MOTOR = auto()
    NO_SUCH_BUS = auto()
    CHANNEL_SHARED = auto()  # device, count, bus
    IDENTIFIER_TAKEN = auto()
    BUS_OVERLOADED = auto()
    BEYOND_WIRE_RANGE = auto()
    SERVO_MODE = auto()
    BAD_FAULT_SCHEDULE = auto()


class DrivesFault(Enum):
    """Drives that can't be opened, enabled, disabled or zeroed."""

    ALREADY_OPEN = auto()
    NOT_READY_TO_ENABLE = auto()
    NO_REPLY = auto()
    NO_REPLY_BUS_FAULT = auto()
    FAULT_REPORTED = auto()
    FAULT_BEFORE_ENABLING = auto()
    STAYS_DISABLED = auto()
    NOT_CONFIRMED_OFF = auto()
    RANGE_MISMATCH = auto()
    REPLY_SIZE_MISMATCH = auto()
    RANGES_UNREPORTED = auto()
    ALREADY_EMULATED = auto()
    ZERO_WRONG_CODE = auto()
    ZERO_TOO_LATE = auto()
    ZERO_MOVED = auto()
    ZERO_MOVING = auto()
    ZERO_ENABLED = auto()
    ZERO_NO_REPLY = auto()
    ZERO_NOT_TAKEN = auto()


class CanFault(Enum):
    """CAN interfaces, traffic and logs."""

    NO_INTERFACE = auto()
    INTERFACE_DOWN = auto()
    NOT_OPENED = auto()
    NOT_OPENED_COMMAND = auto()
    NOT_SHARED = auto()
    SEND_FAILED = auto()
    RECEIVE_FAILED = auto()
    NOT_A_CAN_FRAME = auto()
    NOT_A_DATA_FRAME = auto()
    INVALID_COMMAND_DAMPED = auto()
    OTHER_COMMANDER = auto()
    UNKNOWN_SENDER = auto()
    UNREADABLE_REPLY = auto()
    TOO_MANY_REPLIES = auto()
    BUS_IN_USE = auto()
    BUS_NOT_FREE = auto()  # bus, frames
    LOG_UNREADABLE = auto()
    LOG_WITHOUT_FRAMES = auto()  # path
    LOG_UNWRITABLE = auto()
    LOG_DISK_LOW = auto()
    LOG_PAUSED = auto()  # bus, detail
    LOG_RESUMED = auto()  # bus, missing_s
    CONTROLLER_OFF = auto()
    ARBITRATION_LOST = auto()
    NOT_ACKNOWLEDGED = auto()
    CONTROLLER_RESTARTED = auto()
    PROTOCOL_VIOLATION = auto()
    CONTROLLER_COUNTS_ERRORS = auto()
    BUS_ERROR = auto()
    ERROR_FRAME = auto()


class StopInputFault(Enum):
    """Buttons that stop."""

    NO_FRAME = auto()  # bus, identifier
    UNPLUGGED = auto()  # name
    NOT_SIMULATED = auto()  # name, known
    EXTRA_MISSING = auto()  # kind, detail
    NOT_OPENED = auto()  # device, detail
    NO_SUCH_KEY = auto()  # device, key
    KEYBOARD = auto()  # device, name


class MicrophoneFault(Enum):
    """Microphones that can't be opened or have gone."""

    EXTRA_MISSING = auto()
    NO_PORTAUDIO = auto()
    NOT_OPENED = auto()  # device, detail
    OTHER_FORMAT = auto()  # file, rate_hz
    GONE = auto()  # device
    RECORDING_ENDED = auto()  # file


class HardwareError(CodedError):
    """A device that is missing, broken or misconfigured.

    Also a value: the detail of a fault that feedback carries without being raised.
    """
