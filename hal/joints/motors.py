"""The motor table: named, versioned entries from `motors.toml`, which users extend by a TOML of their own.

Ranges belong to the firmware: a wrong velocity range mis-scales damping by about two. So nothing is guessed: a name
with several versions has to be given with its version.
"""

from __future__ import annotations

from enum import Enum
from functools import cache
from pathlib import Path
from typing import Annotated

from msgspec import Meta, Struct

from hal.errors import DeviceFault, HardwareError
from hal.joints.protocol import DriveFault
from logs.reading.errors import cause_of
from logs.reading.formats import read_toml

BUILT_IN_TABLE = Path(__file__).with_name("motors.toml")

Positive = Annotated[float, Meta(gt=0, le=100_000)]


class WireProtocol(Enum):
    """Which codec the drive needs."""

    MIT = "mit"
    AK_V3 = "ak-v3"
    DAMIAO = "damiao"
    CYBERGEAR = "cybergear"
    SERVO = "servo"


class ReplyLayout(Enum):
    """What follows the six bytes of an MIT reply."""

    SHORT = "six bytes"
    VOLTAGE = "bus voltage"
    TEMPERATURE = "temperature and error"


class OnTimeout(Enum):
    """What the drive does when no more commands come."""

    HOLDS = "holds the last command"
    LIMPS = "limps"


class Watchdog(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The drive's own timeout, as its source documents it."""

    on_silence: OnTimeout = OnTimeout.HOLDS
    after_ms: Annotated[float, Meta(ge=0, le=100_000)] = 0.0


class MotorModel(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One motor with one firmware: how its wire format is scaled, and how it behaves."""

    name: str
    version: str
    protocol: WireProtocol
    source: Annotated[str, Meta(min_length=8)]
    position_rad: Positive = 12.5  # ± on the wire
    velocity_rad_s: Positive
    torque_nm: Positive
    stiffness_nm_rad: Positive = 500.0
    damping_nm_s_rad: Positive = 5.0
    reply: ReplyLayout = ReplyLayout.TEMPERATURE
    errors: dict[str, str] = {}  # the drive's code (or bit number) → name of a DriveFault
    temperature_offset_c: Annotated[float, Meta(ge=-500, le=500)] = 0.0  # raw byte − offset = °C
    watchdog: Watchdog = Watchdog()
    zero_in_motor_mode: bool = False  # accepts "set zero" while enabled
    answers_each_command: bool = True  # else it uploads by itself
    pole_pairs: Positive = 21.0  # the rest is for drives that report electrical speed and current
    gear_ratio: Positive = 1.0
    torque_constant_nm_a: Positive = 0.1

    @property
    def label(self) -> str:
        """Name and version, as the device description may give it."""
        return f"{self.name}/{self.version}"

    def fault_of(self, code: int) -> DriveFault:
        """The meaning of an error code by this motor's own table; an unlisted one is OTHER, 0 is NONE."""
        if code == 0:
            return DriveFault.NONE
        return _fault(self.errors.get(str(code)))

    def fault_bits(self, bits: int) -> DriveFault:
        """The meaning of a bit field by this motor's own table."""
        faults = DriveFault.NONE
        for number in range(bits.bit_length()):
            if bits >> number & 1:
                faults |= _fault(self.errors.get(str(number)))
        return faults


def _fault(name: str | None) -> DriveFault:
    return DriveFault.OTHER if name is None else DriveFault[name]


class _Table(Struct, frozen=True, forbid_unknown_fields=True):
    motor: tuple[MotorModel, ...] = ()


class MotorTable:
    """Entries by name and version."""

    def __init__(self, entries: tuple[MotorModel, ...]) -> None:
        self.entries = {entry.label: entry for entry in entries}

    def find(self, wanted: str) -> MotorModel:
        """The entry called "name/version", or "name" where only one version exists.

        Raises HardwareError listing what there is.
        """
        if wanted in self.entries:
            return self.entries[wanted]
        versions = [entry for entry in self.entries.values() if entry.name == wanted]
        if len(versions) == 1:
            return versions[0]
        if versions:
            labels = ", ".join(sorted(entry.label for entry in versions))
            raise HardwareError(DeviceFault.SEVERAL_MOTOR_VERSIONS, motor=wanted, known=labels)
        known = ", ".join(sorted(self.entries))
        raise HardwareError(DeviceFault.UNKNOWN_MOTOR, motor=wanted, known=known)


def _read_table(path: Path) -> tuple[MotorModel, ...]:
    try:
        entries = read_toml(path, _Table).motor
    except OSError as error:
        raise HardwareError(DeviceFault.MOTORS_UNREADABLE, path=path, detail=cause_of(error)) from error
    for entry in entries:
        _check_errors(entry, path)
    return entries


def _check_errors(entry: MotorModel, path: Path) -> None:
    unknown = sorted(set(entry.errors.values()) - set(DriveFault.__members__))
    if unknown:
        known = ", ".join(DriveFault.__members__)
        raise HardwareError(DeviceFault.UNKNOWN_FAULT_NAME, path=path, motor=entry.label, fault=unknown[0], known=known)


@cache
def load_motors(extension: Path | None = None) -> MotorTable:
    """The built-in table, extended (and overridden entry by entry) by a user's file.

    Raises HardwareError naming the file and the field.
    """
    extra = _read_table(extension) if extension is not None else ()
    return MotorTable(_read_table(BUILT_IN_TABLE) + extra)
