"""Rows of the table of events: where the legs are, and what joints, drives and their bus report."""

from __future__ import annotations

from enum import Flag

from app.control.diagnostics import Diagnostics
from app.control.events.row import Latch, Row
from app.ipc.states import Effect, Event
from hal.joints.protocol import BusFault, DriveFault
from logs.reason import Value, plain, reason

JOINT_SILENT_MS = 15.0  # with a tick and its margin the effect comes within 20 ms
FOLLOWING_WARN_RAD = 0.14  # 8°, four times the tracking that the plans are checked for
FOLLOWING_LIMIT_RAD = 0.26  # 15°
POSE_LIMIT_RAD = 0.21  # 12°
DRIFT_RAD_S = 0.6
STILL_RAD_S = 0.5

# The drive still does what it is told, or is simply off; the others go on holding the wearer.
HELD_FAULTS = (
    DriveFault.OVER_TEMPERATURE
    | DriveFault.OVER_CURRENT
    | DriveFault.OVER_VOLTAGE
    | DriveFault.UNDER_VOLTAGE
    | DriveFault.OVERLOAD
    | DriveFault.LOST_COMMUNICATION
    | DriveFault.UNEXPECTEDLY_DISABLED
)
# The drive's own law can't be trusted any more: stiffness about a wrong angle pushes the leg.
DAMPED_FAULTS = DriveFault.ENCODER | DriveFault.PHASE | DriveFault.WRONG_RANGE | DriveFault.OTHER
HELD_BUS_FAULTS = BusFault.SEND_FAILED | BusFault.BUS_OFF | BusFault.INTERFACE_GONE | BusFault.DUPLICATE_ID
NOTED_BUS_FAULTS = BusFault.ERROR_FRAME | BusFault.ARBITRATION_LOST | BusFault.UNKNOWN_ID | BusFault.MALFORMED


def _any_of(flags: Flag, wanted: Flag) -> bool:
    return flags.value & wanted.value != 0


def _drive_detail(facts: Diagnostics) -> dict[str, Value]:
    """What the driver reports; where it reports nothing, the joint without an answer."""
    joint = facts.legs.silent_joint
    return {"detail": plain(facts.legs.drive_detail) or ("" if joint is None else reason(joint))}


E, F = Event, Effect
POSE = (
    Row(
        event=E.NOT_HOMED,
        effect=F.REFUSE,
        present=lambda f: not f.powered and f.legs.answering and f.legs.beyond_range,
    ),
    Row(
        event=E.LEGS_MOVING,
        effect=F.REFUSE,
        settles=True,  # a swinging leg is slow for a moment at each turning point
        present=lambda f: not f.powered and f.legs.fastest_rad_s > STILL_RAD_S,
    ),
    Row(
        event=E.FAR_FROM_POSE,
        effect=F.REFUSE,
        latch=Latch.POWERED,
        displaces=True,
        present=lambda f: f.legs.pose_error_rad > POSE_LIMIT_RAD,
        detail=lambda f: {"angle_rad": f.legs.pose_error_rad},
    ),
)
DRIVES = (
    Row(
        event=E.JOINT_TIMEOUT,
        effect=F.HOLD,
        latch=Latch.POWERED,
        present=lambda f: f.legs.age_ms > JOINT_SILENT_MS if f.powered else not f.legs.answering,
        detail=_drive_detail,
    ),
    Row(
        event=E.DRIVE_FAULT,
        effect=F.HOLD,
        latch=Latch.POWERED,
        present=lambda f: _any_of(f.legs.drive_faults, HELD_FAULTS),
        detail=_drive_detail,
    ),
    Row(
        event=E.DRIVE_UNTRUSTED,
        effect=F.DAMP,
        latch=Latch.POWERED,
        present=lambda f: _any_of(f.legs.drive_faults, DAMPED_FAULTS),
        detail=_drive_detail,
    ),
    Row(
        event=E.DRIVES_POWER_LOST,
        effect=F.HOLD,
        latch=Latch.ALWAYS,
        present=lambda f: f.legs.drives_lost,
        detail=_drive_detail,
    ),
    Row(
        event=E.DRIVE_ORDER_FAILED,
        effect=F.REFUSE,
        latch=Latch.ALWAYS,
        present=lambda f: f.legs.drive_error is not None,
        detail=lambda f: {"detail": f.legs.drive_error or ""},
    ),
    Row(
        event=E.OVER_TEMPERATURE_WARNING,
        effect=F.NOTE,
        present=lambda f: f.legs.warm,
        detail=lambda f: {"temperature_c": f.legs.hottest_c},
    ),
    Row(
        event=E.OVER_TEMPERATURE,
        effect=F.HOLD,
        latch=Latch.POWERED,
        present=lambda f: f.legs.hot,
        detail=lambda f: {"temperature_c": f.legs.hottest_c},
    ),
    Row(
        event=E.FOLLOWING_WARNING,
        effect=F.NOTE,
        present=lambda f: f.legs.following_rad > FOLLOWING_WARN_RAD,
        detail=lambda f: {"angle_rad": f.legs.following_rad},
    ),
    Row(
        event=E.FOLLOWING_LIMIT,
        effect=F.HOLD,
        latch=Latch.POWERED,
        present=lambda f: f.legs.following_rad > FOLLOWING_LIMIT_RAD,
        detail=lambda f: {"angle_rad": f.legs.following_rad},
    ),
    Row(
        event=E.OUT_OF_RANGE,
        effect=F.HOLD,
        latch=Latch.POWERED,
        present=lambda f: f.powered and f.legs.beyond_range,
    ),
    Row(
        event=E.OVER_SPEED,
        effect=F.DAMP,
        latch=Latch.POWERED,
        present=lambda f: f.powered and f.legs.beyond_speed,
    ),
    Row(
        event=E.OVER_TORQUE,
        effect=F.DAMP,
        latch=Latch.POWERED,
        present=lambda f: f.powered and f.legs.beyond_torque,
    ),
    Row(
        event=E.GUARD_REFUSAL,
        effect=F.HOLD,
        latch=Latch.POWERED,
        present=lambda f: f.legs.guard_refusal is not None,
        detail=lambda f: {"detail": plain(str(f.legs.guard_refusal)) or ""},
    ),
    Row(
        event=E.BUS_FAULT,
        effect=F.HOLD,
        latch=Latch.POWERED,
        present=lambda f: _any_of(f.legs.bus, HELD_BUS_FAULTS),
        detail=_drive_detail,
    ),
    Row(
        event=E.BUS_ERRORS,
        effect=F.NOTE,
        present=lambda f: _any_of(f.legs.bus, NOTED_BUS_FAULTS),
        detail=_drive_detail,
    ),
    Row(
        event=E.UNEXPECTED_MOTION,
        effect=F.DAMP,
        latch=Latch.POWERED,
        present=lambda f: f.legs.drift_rad_s > DRIFT_RAD_S,
    ),
)
