"""One stop input: as `[[inputs]]` of the configuration describes it, and what its driver keeps.

Whatever is not proven to be a closed contact stops.
"""

from __future__ import annotations

from enum import Enum
from typing import Annotated, Literal, NamedTuple, Protocol

from msgspec import Meta, Struct

from hal.errors import HardwareError
from hal.joints.device import BusDevice

InputKind = Literal["simulated", "can", "evdev", "gpiod"]


class InputRole(Enum):
    """Whose button it is; each has its row in control's table of events."""

    EMERGENCY_STOP = "emergency-stop"  # an auxiliary contact of the hardwired one
    WEARER = "wearer"
    THERAPIST = "therapist"


class InputDevice(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A normally-closed contact and how it is read."""

    name: Annotated[str, Meta(pattern="^[a-z0-9][a-z0-9-]{0,19}$")]  # in events and the audit trail
    role: InputRole
    kind: InputKind
    bus: BusDevice = BusDevice()  # can: of the module that reads the contact
    can_id: Annotated[int, Meta(ge=0, le=0x1FFF_FFFF)] | None = None
    extended: bool = False
    byte: Annotated[int, Meta(ge=0, le=7)] = 0
    bit: Annotated[int, Meta(ge=0, le=7)] = 0
    # The bit, the line's level, or whether the key is down, while the contact is closed. None: 1; of a key 0.
    closed: Literal[0, 1] | None = None
    device: str = ""  # evdev, gpiod: its file
    key: str = ""  # evdev: as `evtest` names it, KEY_B
    keyboard: bool = False  # evdev: this pedal types letters; it is grabbed all the same
    line: Annotated[int, Meta(ge=0, le=1023)] | None = None  # gpiod: its offset on the chip
    # Longer than this without a frame is an open contact; with reader and tick the effect comes within 25 ms.
    timeout_ms: Annotated[float, Meta(ge=2, le=15)] = 15.0

    def __post_init__(self) -> None:
        for field in _NEEDS[self.kind]:
            if getattr(self, field) in (None, ""):
                raise ValueError(f"the input {self.name} of kind {self.kind} needs its {field}")
        if self.can_id is not None and self.can_id > 0x7FF and not self.extended:
            raise ValueError(f"the can_id of the input {self.name} needs extended = true")

    @property
    def closed_level(self) -> bool:
        """What is read while the contact is closed."""
        return self.kind != "evdev" if self.closed is None else bool(self.closed)


_NEEDS: dict[InputKind, tuple[str, ...]] = {
    "simulated": (),
    "can": ("can_id",),
    "evdev": ("device", "key"),
    "gpiod": ("device", "line"),
}


def check_inputs(
    devices: tuple[InputDevice, ...], *, emulated: bool, drive_buses: frozenset[tuple[str, str]] = frozenset()
) -> None:
    """Raises ValueError for a name that is taken, and for a button that nobody can reach beside real drives.

    Nor may a module send on a bus of the drives: their replies are known by their data, which its frames may resemble.
    drive_buses: interface and channel of each.
    """
    names = [device.name for device in devices]
    for device in devices:
        if names.count(device.name) > 1:
            raise ValueError(f"two inputs are named {device.name}: give each its own name")
        if device.kind == "simulated" and not emulated:
            raise ValueError(f"the input {device.name} is simulated, so nobody could press it beside real drives")
        if device.kind == "can" and (device.bus.interface, device.bus.channel) in drive_buses:
            raise ValueError(
                f"the input {device.name} is on {device.bus.channel} with the drives, where its frames could be taken "
                "for a drive's reply: give its module a bus of its own"
            )


class Contact(Enum):
    """A normally-closed contact. Only CLOSED lets the legs move."""

    CLOSED = "closed"
    OPEN = "open"  # pressed, or its wire is broken: the contact can't tell which
    SILENT = "silent"  # unplugged, or without an answer in time


class ContactReading(NamedTuple):
    """A contact as it is now, and what is known of a silent one."""

    contact: Contact
    fault: HardwareError | None = None


class InputReading(NamedTuple):
    """One input as it was read last."""

    name: str
    role: InputRole
    contact: Contact
    opened_ns: int  # when it was last found not closed; 0: never
    fault: HardwareError | None = None


class InputReadings(NamedTuple):
    """All inputs, and when they were read."""

    at_ns: int = 0
    inputs: tuple[InputReading, ...] = ()


class StopInput(Protocol):
    """One input. Times are monotonic, in ns."""

    def open(self, now_ns: int) -> None:
        """Raises HardwareError. May be called again after `close`."""

    def read(self, now_ns: int) -> ContactReading:
        """What it is now, or OPEN if it was that since the last call. Neither waits nor raises."""

    def close(self) -> None:
        """Release it; may be called twice, and without `open`."""
