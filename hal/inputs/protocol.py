"""What every driver of a stop input keeps. Whatever is not proven to be a closed contact stops."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple, Protocol

from hal.errors import HardwareError
from hal.inputs.device import InputRole


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
