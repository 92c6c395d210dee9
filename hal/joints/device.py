"""The exoskeleton as a device: joints, drives, transmission and the hard limits (`exoskeleton.toml`)."""

from __future__ import annotations

from enum import IntEnum
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta, Struct

from hal.errors import DeviceFault, HardwareError
from logs.reading.errors import cause_of
from logs.reading.formats import read_toml


class Joint(IntEnum):
    """The four driven joints, and their index in every (4,) array."""

    LEFT_HIP = 0
    LEFT_KNEE = 1
    RIGHT_HIP = 2
    RIGHT_KNEE = 3


JOINT_NAMES = tuple(joint.name.lower() for joint in Joint)  # in files
DEFAULT_DEVICE = Path(__file__).with_name("exoskeleton.toml")
ROOM_C = 25.0  # where no drive has warmed up

# Upper limits: ten times what drives for legs have, so that a slip of the keyboard is refused and no limit vanishes.
Degrees = Annotated[float, Meta(ge=-360, le=360)]
Celsius = Annotated[float, Meta(ge=0, le=200)]
Speed = Annotated[float, Meta(gt=0, le=10_000)]  # degrees per second
Torque = Annotated[float, Meta(gt=0, le=2_000)]  # Nm
Gain = Annotated[float, Meta(gt=0, le=10_000)]  # Nm/rad, Nm s/rad
Ratio = Annotated[float, Meta(gt=0, le=1_000)]
Thermal = Annotated[float, Meta(gt=0, le=1e6)]


class JointDevice(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One joint's drive, wiring, transmission and hard limits; angles at the joint, degrees in the file's `_deg`."""

    motor: str  # name of an entry of the motor table
    can_bus: Annotated[int, Meta(ge=0, le=3)] = 0
    can_id: Annotated[int, Meta(ge=0, le=0x7F)]
    reply_id: Annotated[int, Meta(ge=0, le=0x7FF)] = 0
    direction: Literal[1, -1] = 1  # +1 or -1: motor's positive against the joint's
    zero_offset_deg: Degrees = 0.0
    transmission: Ratio = 1.0  # motor output turns per joint turn, after the drive's own gearbox
    min_deg: Degrees
    max_deg: Degrees
    max_speed_deg_s: Speed
    max_torque_nm: Torque
    max_stiffness_nm_rad: Gain
    max_damping_nm_s_rad: Gain
    damp_nm_s_rad: Gain  # damping used by the damp effect and by the guardian
    rotor_inertia_kgm2: Annotated[float, Meta(gt=0, le=100)]  # reflected to the joint
    friction_nm: Annotated[float, Meta(ge=0, le=200)]
    no_load_speed_deg_s: Speed
    thermal_resistance_k_w: Thermal
    thermal_capacity_j_k: Thermal
    torque_constant_loss_w_nm2: Thermal  # copper loss per joint torque squared
    warn_c: Celsius = 65.0
    limit_c: Celsius = 80.0

    def __post_init__(self) -> None:
        if self.min_deg >= self.max_deg:
            raise ValueError("max_deg must be above min_deg")
        if not self.min_deg <= 0 <= self.max_deg:  # standing; neutral and damping commands carry it
            raise ValueError("0 degrees, upright, must lie between min_deg and max_deg")
        if self.damp_nm_s_rad > self.max_damping_nm_s_rad:
            raise ValueError("damp_nm_s_rad must not be above max_damping_nm_s_rad")
        if self.warn_c > self.limit_c:
            raise ValueError("limit_c must not be below warn_c")


EMULATED_INTERFACES = ("local", "udp_multicast", "virtual")  # no real drive can hang on these
SHARING_INTERFACES = ("socketcan", *EMULATED_INTERFACES)  # each program that opens the bus receives every frame
# python-can reads these from a terminal device: a byte that one program has read no other one receives.
UNSHARED_INTERFACES = ("slcan", "serial", "robotell", "seeedstudio")


class BusDevice(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One CAN bus as python-can opens it."""

    interface: str = "socketcan"
    channel: str = "can0"
    bitrate: Annotated[int, Meta(gt=0, le=8_000_000)] = 1_000_000  # CAN FD's fastest
    options: dict[str, str | int | float | bool] = {}  # further arguments of python-can's interface


class Exoskeleton(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The whole device."""

    schema: Literal[1] = 1
    name: str
    mass_kg: Annotated[float, Meta(gt=0, le=200)]
    buses: Annotated[tuple[BusDevice, ...], Meta(min_length=1, max_length=4)]
    soft_start_s: Annotated[float, Meta(ge=0, le=5)] = 0.3  # stiffness and torque ramp after enabling
    left_hip: JointDevice
    left_knee: JointDevice
    right_hip: JointDevice
    right_knee: JointDevice

    @property
    def joints(self) -> tuple[JointDevice, JointDevice, JointDevice, JointDevice]:
        """In the order of `Joint`."""
        return (self.left_hip, self.left_knee, self.right_hip, self.right_knee)


def load_exoskeleton(path: Path = DEFAULT_DEVICE) -> Exoskeleton:
    """The device described in a TOML file. Raises HardwareError naming the file and the field."""
    try:
        return read_toml(path, Exoskeleton)
    except OSError as error:
        raise HardwareError(DeviceFault.DEVICE_UNREADABLE, path=path, detail=cause_of(error)) from error
