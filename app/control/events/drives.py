"""Rows of the table of events: what joints, drives and their bus report."""

from __future__ import annotations

from enum import Flag
from math import isfinite

from app.control.diagnostics import Diagnostics
from app.control.events.row import Latch, Row
from app.ipc.states import Effect, Event
from hal.joints.protocol import BusFault, DriveFault
from logs.reason import Value, reason, reason_of

JOINT_TIMEOUT_MS = 15.0  # with a tick and its margin the effect comes within 20 ms
FOLLOWING_WARN_RAD = 0.14  # 8°, four times the tracking that the plans are checked for
FOLLOWING_LIMIT_RAD = 0.26  # 15°
DRIFT_RAD_S = 0.6

# The drive still follows commands, or is simply off; the others go on holding the wearer.
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


def _joint_timeout(d: Diagnostics) -> bool:
    return d.joints.age_ms > JOINT_TIMEOUT_MS if d.powered else not d.joints.answering


def _report(d: Diagnostics) -> dict[str, Value]:
    """What the driver reports; where it reports nothing, the joint without an answer."""
    detail, joint = d.joints.drive_detail, d.joints.silent_joint
    if detail is not None:
        return {"detail": reason_of(detail)}
    return {"detail": "" if joint is None else reason(joint)}


def _guard_refusal(d: Diagnostics) -> dict[str, Value]:
    refusal = d.joints.guard_refusal
    return {"detail": "" if refusal is None else reason(refusal.code, **refusal.values)}


def _temperature(d: Diagnostics) -> dict[str, Value]:
    return {"temperature_c": d.joints.hottest_c if isfinite(d.joints.hottest_c) else "–"}


def _following(d: Diagnostics) -> dict[str, Value]:
    return {"angle_rad": d.joints.following_rad}


E, F, P = Event, Effect, Latch.POWERED
DRIVES = (
    Row(E.JOINT_TIMEOUT, F.HOLD, _joint_timeout, P, _report),
    Row(E.DRIVE_FAULT, F.HOLD, lambda d: _any_of(d.joints.drive_faults, HELD_FAULTS), P, _report),
    Row(E.DRIVE_UNTRUSTED, F.DAMP, lambda d: _any_of(d.joints.drive_faults, DAMPED_FAULTS), P, _report),
    Row(E.DRIVES_POWER_LOST, F.HOLD, lambda d: d.joints.drives_lost, Latch.ALWAYS, _report),
    Row(
        E.DRIVE_ORDER_FAILED,
        F.REFUSE,
        lambda d: d.joints.drive_error is not None,
        Latch.ALWAYS,
        lambda d: {"detail": d.joints.drive_error or ""},
    ),
    Row(E.OVER_TEMPERATURE_WARNING, F.NOTE, lambda d: d.joints.warm, detail=_temperature),
    Row(E.OVER_TEMPERATURE, F.HOLD, lambda d: d.joints.hot, P, _temperature),
    Row(E.FOLLOWING_WARNING, F.NOTE, lambda d: d.joints.following_rad > FOLLOWING_WARN_RAD, detail=_following),
    Row(E.FOLLOWING_LIMIT, F.HOLD, lambda d: d.joints.following_rad > FOLLOWING_LIMIT_RAD, P, _following),
    Row(E.OUT_OF_RANGE, F.HOLD, lambda d: d.powered and d.joints.beyond_range, P),
    Row(E.OVER_SPEED, F.DAMP, lambda d: d.powered and d.joints.beyond_speed, P),
    Row(E.OVER_TORQUE, F.DAMP, lambda d: d.powered and d.joints.beyond_torque, P),
    Row(E.GUARD_REFUSAL, F.HOLD, lambda d: d.joints.guard_refusal is not None, P, _guard_refusal),
    Row(E.BUS_FAULT, F.HOLD, lambda d: _any_of(d.joints.bus, HELD_BUS_FAULTS), P, _report),
    Row(E.BUS_ERRORS, F.NOTE, lambda d: _any_of(d.joints.bus, NOTED_BUS_FAULTS), detail=_report),
    Row(E.UNEXPECTED_MOTION, F.DAMP, lambda d: d.joints.drift_rad_s > DRIFT_RAD_S, P),
)
