"""What can go wrong with an emulated drive or its bus, on demand and on schedule."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from hal.errors import HardwareError
from hal.joints.protocol import Joint


class Fault(Enum):
    """The faults, as the command line names them."""

    SILENT = "silent"  # hears and answers nothing, goes on as it was
    ERROR = "error"  # reports an error code and lets go of the joint
    LATE = "late"  # answers after `value` milliseconds
    WRONG_ID = "wrong-id"  # answers as drive `value`
    WRONG_RANGE = "wrong-range"  # its firmware scales velocity by `value` times the table's range
    DUPLICATE = "duplicate"  # a second drive with the same ID
    GARBAGE = "garbage"  # replies of wrong length
    DISABLED = "disabled"  # leaves motor mode by itself
    HOT = "hot"  # reports `value` °C
    BUS_OFF = "bus-off"  # the whole bus: error frame, then nothing
    ERROR_FRAMES = "error-frames"  # the whole bus: nobody acknowledges, now and then
    HEALED = "healed"  # everything well again


DEFAULT_VALUE = {
    Fault.ERROR: 1.0,
    Fault.LATE: 30.0,
    Fault.WRONG_ID: 77.0,
    Fault.WRONG_RANGE: 0.45,
    Fault.HOT: 90.0,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class ScheduledFault:
    """A fault that sets in by itself; without a joint it befalls all four."""

    fault: Fault
    joint: Joint | None = None
    after_s: float = 0.0
    value: float = 0.0


def read_schedule(text: str) -> ScheduledFault:
    """`[joint:]fault[=value][@seconds]`, e.g. `left_knee:error=2@10`. Raises HardwareError saying what is wrong."""
    head, _, seconds = text.partition("@")
    name, _, value = head.partition("=")
    where, _, what = name.rpartition(":")
    try:
        fault = Fault(what.strip())
        return ScheduledFault(
            fault=fault,
            joint=Joint[where.strip().upper()] if where else None,
            after_s=float(seconds) if seconds else 0.0,
            value=float(value) if value else DEFAULT_VALUE.get(fault, 0.0),
        )
    except (KeyError, ValueError) as error:
        faults = ", ".join(fault.value for fault in Fault)
        raise HardwareError(
            f"The fault {text!r} is not of the form [joint:]fault[=value][@seconds]: joints are left_hip, left_knee, "
            f"right_hip, right_knee; faults are {faults}."
        ) from error
