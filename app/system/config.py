"""The configuration: what a lab sets once. Read from `config.toml`; absent means these defaults."""

from __future__ import annotations

import os
from enum import Enum
from os.path import realpath
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from msgspec import Meta, Struct
from msgspec.structs import replace

from app.ipc.streams import LinkDirectory
from app.system.errors import AppError
from hal.cameras.webcam_list import same_webcam
from hal.errors import HardwareError
from hal.inputs.device import InputDevice, check_inputs
from hal.joints.device import EMULATED_INTERFACES
from hal.microphone import VoiceConfig
from logs.reading.errors import cause_of
from logs.reading.formats import read_toml
from logs.reading.regular import path_named
from profiles.schema import Profile

if TYPE_CHECKING:
    from hal.joints.device import Exoskeleton

CameraKind = Literal["digital-hand", "webcam", "realsense", "recording"]
ArmFrom = Literal["below", "left", "above", "right", "anywhere"]
JointsKind = Literal["simulated", "can"]
ThemeName = Literal["dark", "light", "high-contrast", "projector"]
Purpose = Literal["session", "training", "enrolment"]  # the first alone may be armed
RATES_HZ = (0.1, 120.0)  # of a camera, least and most
HOST_FORM = r"^([A-Za-z0-9]([A-Za-z0-9.-]*[A-Za-z0-9])?(:[0-9]{1,5})?)?$"  # name or IPv4 address, and port


class ConfigFault(Enum):
    """What can be wrong with the configuration."""

    UNREADABLE = "unreadable"
    UNSUITABLE = "unsuitable"  # detail
    NOT_CHANGED = "not changed"  # detail
    NO_SUCH_FIELD = "no such field"  # field


class CameraConfig(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Which camera, and what is known of it."""

    kind: CameraKind = "digital-hand"
    device: str = ""  # webcam: name or index; recording: path; realsense: serial or path of a recording
    width_px: Annotated[int, Meta(ge=160, le=4096)] = 1280
    height_px: Annotated[int, Meta(ge=120, le=4096)] = 720
    rate_hz: Annotated[float, Meta(ge=RATES_HZ[0], le=RATES_HZ[1])] = 30.0
    focal_px: Annotated[float, Meta(gt=0, le=100_000)] | None = None
    mirrored: bool = False
    arm: ArmFrom = "below"  # where on the unmirrored image the patient's arm comes from
    seed: Annotated[int, Meta(ge=0)] = 1  # digital hand: which person
    hand: Literal["profile", "left", "right"] = "profile"  # digital hand: which one it shows; a wrong one is refused
    limit: Literal["none", "two-fingers", "no-spread", "tremor"] = "none"  # digital hand: what it can't do
    depth: bool = False  # digital hand: give a D435i's depth as well, also where the patient needs none
    depth_holes: Annotated[float, Meta(ge=0, le=1)] = 0.0  # digital hand: share of frames whose depth misses the hand

    @property
    def turned_back(self) -> bool:
        """Whether its mirrored images are turned back; a RealSense and the digital hand mirror none."""
        return self.mirrored and self.kind in {"webcam", "recording"}


class JointsConfig(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Which joints."""

    kind: JointsKind = "simulated"
    device: str = ""  # path of an exoskeleton.toml; empty: the built-in description
    motors: str = ""  # path of a TOML that extends the motor table
    interface: str = ""  # overrides the device's bus, e.g. udp_multicast
    channel: str = ""
    host: Annotated[str, Meta(pattern=HOST_FORM, max_length=260)] = ""  # of the exoskeleton's own computer; empty: here

    @property
    def emulated(self) -> bool:
        """Whether no real drive can move: simulated joints, or a bus that none can hang on."""
        return self.kind == "simulated" or self.interface in EMULATED_INTERFACES


class ButtonConfig(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The virtual button on the image, as shares of width and height."""

    x: Annotated[float, Meta(ge=0, le=1)] = 0.5
    y: Annotated[float, Meta(ge=0, le=1)] = 0.5
    mode: Literal["robust", "published"] = "robust"


class RecordingConfig(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The session's recording, without pictures."""

    on: bool = False
    encrypt: bool = False  # by the station's key (app/recording/encryption.py)
    keep_days: Annotated[int, Meta(ge=1, le=36_500)] | None = None  # then `rleex recording expire` deletes it


class SoundsConfig(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """When the terminal's bell rings."""

    press: bool = False
    release: bool = False
    refusal: bool = True
    stop: bool = True


class Config(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Everything a lab sets once."""

    camera: CameraConfig = CameraConfig()
    joints: JointsConfig = JointsConfig()
    button: ButtonConfig = ButtonConfig()
    recording: RecordingConfig = RecordingConfig()
    inputs: tuple[InputDevice, ...] = ()  # buttons that stop
    voice: VoiceConfig = VoiceConfig()
    rules: Literal["robust", "published"] = "robust"
    model: str = ""  # path of a hand_landmarker.task; empty: the one set up into models/
    patient: str = "demo"
    language: str = "en"
    theme: ThemeName = "dark"
    picture: Literal["auto", "blocks"] = "auto"  # auto: pixels where the terminal says that it shows them
    sounds: SoundsConfig = SoundsConfig()
    control_core: Annotated[int, Meta(ge=0, le=4095)] | None = None  # none: one set apart, else the last of several
    unattended_s: Annotated[float, Meta(ge=2, le=3600)] = 120.0  # a session without a console ends after this
    idle_lock_s: Annotated[float, Meta(ge=0, le=1e9)] = 600.0
    keys: dict[str, str] = {}  # console action → key
    checkpoint_copy: str = ""  # a second place for signed checkpoints

    def __post_init__(self) -> None:
        buses = _buses_of(self.joints) if any(one.kind == "can" for one in self.inputs) else frozenset()
        check_inputs(self.inputs, emulated=self.joints.emulated, drive_buses=buses)


def _buses_of(joints: JointsConfig) -> frozenset[tuple[str, str]]:
    """Interface and channel of the drives' buses; none of simulated ones.

    A device that can't be read is refused where it is needed.
    """
    if joints.kind == "simulated":
        return frozenset()
    try:
        buses = load_device(joints).buses
    except HardwareError:
        return frozenset()
    channels = [part.strip() for part in joints.channel.split(",")]
    return frozenset((joints.interface or bus.interface, name or bus.channel) for bus in buses for name in channels)


def load_config(path: Path) -> Config:
    """The configuration in a file, or the defaults when there is none. Raises AppError naming the field."""
    if not path.exists():
        return Config()
    try:
        return read_toml(path, Config)
    except OSError as error:
        raise AppError(ConfigFault.UNREADABLE, path=path, detail=cause_of(error)) from error


def with_choices(
    config: Config, *, camera: CameraKind | None, joints: JointsKind | None, patient: str | None
) -> Config:
    """The configuration with what the command line chose instead. Raises AppError where its inputs don't suit."""
    if camera is not None:
        device = config.camera.device if config.camera.kind == camera else ""
        config = replace(config, camera=with_camera(config.camera, camera, device))
    if patient is not None:
        config = replace(config, patient=patient)
    if joints is None:
        return config
    try:
        return replace(config, joints=replace(config.joints, kind=joints, host=""))  # this computer's joints
    except ValueError as error:
        raise AppError(ConfigFault.UNSUITABLE, detail=str(error)) from error


def with_camera(settings: CameraConfig, kind: str, device: str) -> CameraConfig:
    """These settings for that camera; focal length and mirroring are those of their own camera."""
    same = settings.kind == kind and _same_device(kind, settings.device, device)
    own = {} if same else {"focal_px": None, "mirrored": False}
    return replace(settings, kind=kind, device=device, **own)


def _same_device(kind: str, first: str, second: str) -> bool:
    """Whether two names are one device's; of a recording, one path's."""
    if kind == "recording":
        first, second = (realpath(path_named(each)) for each in (first, second))
    return first == second or (kind == "webcam" and same_webcam(first, second))


class SessionSetup(Struct, frozen=True, kw_only=True):
    """Everything the processes of one session need to know at their start."""

    session: str  # name of the session, sortable: 20261121T093000Z-1a2b
    home: Path
    links: LinkDirectory
    config: Config
    profile: Profile
    operator: str
    role: str = "therapist"
    host_pid: int = 0  # the process that runs the session (app/session/supervise.py)
    host_started: str = ""  # when, as `app.session.shared.start_of` has it
    began_ns: int = 0  # monotonic; 0: nobody knows
    linked: bool = False  # its console is on another computer (app/link)
    purpose: Purpose = "session"

    @property
    def joints_elsewhere(self) -> bool:
        """Whether another computer has the joints."""
        return bool(self.config.joints.host) and not self.linked

    @property
    def orphaned(self) -> bool:
        """Whether the process that asks has lost the one that runs the session, perhaps before its first look."""
        return os.getppid() != self.host_pid


def load_device(joints: JointsConfig) -> Exoskeleton:
    """The device that the configuration names. Raises HardwareError."""
    from hal.joints.device import DEFAULT_DEVICE, load_exoskeleton

    return load_exoskeleton(Path(joints.device) if joints.device else DEFAULT_DEVICE)
