"""The faults of emulated drives, and when they set in, as the command line names both."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

from hal.errors import DeviceFault, HardwareError
from hal.joints.device import JOINT_NAMES
from hal.joints.protocol import Joint


class Fault(Enum):
    """The faults, as the command line names them."""

    SILENT = "silent"  # receives and answers nothing, goes on as it was
    ERROR = "error"  # reports an error code and gives no torque
    LATE = "late"  # answers after `value` milliseconds
    WRONG_ID = "wrong-id"  # answers as drive `value`
    WRONG_RANGE = "wrong-range"  # its firmware scales velocity by `value` times the table's range
    DUPLICATE = "duplicate"  # a second drive with the same ID
    GARBAGE = "garbage"  # replies of wrong length
    DISABLED = "disabled"  # leaves motor mode by itself
    HOT = "hot"  # reports `value` °C
    BUS_OFF = "bus-off"  # the whole bus: error frame, then nothing
    ERROR_FRAMES = "error-frames"  # the whole bus: no acknowledgement, now and then
    HEALED = "healed"  # all faults end


DEFAULT_VALUE = {
    Fault.ERROR: 1.0,
    Fault.LATE: 30.0,
    Fault.WRONG_ID: 77.0,
    Fault.WRONG_RANGE: 0.45,
    Fault.HOT: 90.0,
}

_LARGEST_ID = 255  # a byte of an MIT reply


@dataclass(frozen=True, slots=True, kw_only=True)
class ScheduledFault:
    """A fault that sets in by itself; without a joint at all four."""

    fault: Fault
    joint: Joint | None = None
    after_s: float = 0.0
    value: float = 0.0


def read_schedule(text: str) -> ScheduledFault:
    """`[joint:]fault[=value][@seconds]`, e.g. `left_knee:error=2@10`. Raises HardwareError."""
    head, _, seconds = text.partition("@")
    name, _, value = head.partition("=")
    where, _, what = name.rpartition(":")
    try:
        fault = Fault(what.strip())
        largest = _LARGEST_ID if fault is Fault.WRONG_ID else math.inf
        return ScheduledFault(
            fault=fault,
            joint=Joint[where.strip().upper()] if where else None,
            after_s=_number(seconds or "0"),
            value=_number(value, largest) if value else DEFAULT_VALUE.get(fault, 0.0),
        )
    except (KeyError, ValueError) as error:
        faults = ", ".join(fault.value for fault in Fault)
        joints = ", ".join(JOINT_NAMES)
        raise HardwareError(DeviceFault.BAD_FAULT_SCHEDULE, fault=text, joints=joints, known=faults) from error


def _number(text: str, largest: float = math.inf) -> float:
    if not 0.0 <= (number := float(text)) <= largest or math.isinf(number):
        raise ValueError(text)
    return number
