"""Rows of the table of events: what joints, drives and their bus report."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from enum import Enum, Flag
from math import isfinite

import numpy as np

from app.control.diagnostics import Diagnostics
from app.control.events.row import Above, Compared, Latch, Row
from app.control.inputs import Settings
from app.control.joint_diagnostics import FOLLOWING_WARN_RAD
from app.control.silence import JOINT_TIMEOUT_MS
from app.ipc.states import Effect, Event
from hal.joints.guard import RANGE_MARGIN_RAD, SPEED_MARGIN, TORQUE_MARGIN
from hal.joints.protocol import BusFault, DriveFault, Joint, JointArray, JointFeedback
from logs.reason import Value, reason, reason_of

FOLLOWING_LIMIT_RAD = 0.26  # 15°
DRIFT_RAD_S = 0.6
POLL_TIMEOUT_MS = 1_000.0  # without power drives are asked fifty times a second, and nobody is held by them

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


class AngleDetail(Enum):
    """What else is known of an angle out of range."""

    BEYOND_PATIENT = "beyond-patient"  # joint, angle_rad, limit_rad


def _any_of(flags: Flag, wanted: Flag) -> bool:
    return flags.value & wanted.value != 0


_ANSWER_AGE = Above("answer_age_ms", lambda d: d.joints.age_ms, JOINT_TIMEOUT_MS)


def _joint_timeout(d: Diagnostics) -> bool:
    return _ANSWER_AGE(d) if d.powered else not d.joints.answering or d.joints.age_ms > POLL_TIMEOUT_MS


def _answer_age(d: Diagnostics) -> Compared | None:
    return replace(_ANSWER_AGE.compared(d), joint=d.joints.silent_joint) if d.powered else None


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


def _worst(
    quantity: str, values: Callable[[JointFeedback], JointArray], limits: Callable[[Settings], JointArray]
) -> Callable[[Diagnostics], Compared | None]:
    """The joint that is farthest above its limit; joints without a measurement are left out."""

    def compared(d: Diagnostics) -> Compared | None:
        if d.joints.feedback is None or d.joints.settings is None:
            return None
        value, limit = values(d.joints.feedback), limits(d.joints.settings)
        if np.isnan(value).all():
            return None
        joint = Joint(int(np.nanargmax(value - limit)))
        return Compared(quantity, float(value[joint]), float(limit[joint]), joint)

    return compared


_warmest = _worst("temperature_c", lambda f: f.temperature_c, lambda s: s.warn_c)
_hottest = _worst("temperature_c", lambda f: f.temperature_c, lambda s: s.limit_c)
_worst_speed = _worst("speed_rad_s", lambda f: np.abs(f.velocity_rad_s), lambda s: SPEED_MARGIN * s.limits.speed_rad_s)
_worst_torque = _worst("torque_nm", lambda f: np.abs(f.torque_nm), lambda s: TORQUE_MARGIN * s.limits.torque_nm)


def worst_range(d: Diagnostics) -> Compared | None:
    """The joint that is farthest beyond its range, or nearest to its end, with the end that it is nearer to."""
    if d.joints.feedback is None or d.joints.settings is None:
        return None
    angle_rad, limits = d.joints.feedback.position_rad, d.joints.settings.limits
    low_rad, high_rad = limits.low_rad - RANGE_MARGIN_RAD, limits.high_rad + RANGE_MARGIN_RAD
    joint = Joint(int(np.maximum(low_rad - angle_rad, angle_rad - high_rad).argmax()))
    below = low_rad[joint] - angle_rad[joint] > angle_rad[joint] - high_rad[joint]
    end_rad = low_rad if below else high_rad
    return Compared("angle_rad", float(angle_rad[joint]), float(end_rad[joint]), joint)


def _patients_limit(d: Diagnostics) -> dict[str, Value]:
    """The patient's own limit, where the device's would let the angle pass: then its zero may well be right."""
    worst, settings = worst_range(d), d.joints.settings
    if worst is None or worst.joint is None or settings is None or settings.device_high_rad is None:
        return {"detail": ""}
    limit_rad, device_rad = float(settings.limits.high_rad[worst.joint]), settings.device_high_rad[worst.joint]
    if not limit_rad < worst.value - RANGE_MARGIN_RAD <= device_rad:
        return {"detail": ""}
    beyond = reason(AngleDetail.BEYOND_PATIENT, joint=worst.joint, angle_rad=worst.value, limit_rad=limit_rad)
    return {"detail": beyond}


def _guard_compared(d: Diagnostics) -> Compared | None:
    refusal = d.joints.guard_refusal
    return None if refusal is None else Compared(refusal.quantity.value, refusal.value, refusal.limit, refusal.joint)


def _following_above(limit_rad: float) -> Above:
    return Above("following_rad", lambda d: d.joints.following_rad, limit_rad)


E, F, P = Event, Effect, Latch.POWERED
DRIVES = (
    Row(E.JOINT_TIMEOUT, F.HOLD, _joint_timeout, P, _report, compares=_answer_age),
    # A drive may go limp without commands: what has sunk meanwhile is not pulled back.
    Row(E.JOINT_SANK, F.DAMP, Above("following_rad", lambda d: d.joints.sunk_rad, FOLLOWING_WARN_RAD), P),
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
    Row(E.OVER_TEMPERATURE_WARNING, F.NOTE, lambda d: d.joints.warm, detail=_temperature, compares=_warmest),
    Row(E.OVER_TEMPERATURE, F.HOLD, lambda d: d.joints.hot, P, _temperature, compares=_hottest),
    Row(E.FOLLOWING_WARNING, F.NOTE, _following_above(FOLLOWING_WARN_RAD), detail=_following),
    Row(E.FOLLOWING_LIMIT, F.HOLD, _following_above(FOLLOWING_LIMIT_RAD), P, _following),
    Row(E.OUT_OF_RANGE, F.HOLD, lambda d: d.powered and d.joints.beyond_range, P, compares=worst_range),
    Row(E.OVER_SPEED, F.DAMP, lambda d: d.powered and d.joints.beyond_speed, P, compares=_worst_speed),
    Row(E.OVER_TORQUE, F.DAMP, lambda d: d.powered and d.joints.beyond_torque, P, compares=_worst_torque),
    Row(
        E.GUARD_REFUSAL,
        F.HOLD,
        lambda d: d.joints.guard_refusal is not None,
        P,
        _guard_refusal,
        compares=_guard_compared,
    ),
    Row(E.BUS_FAULT, F.HOLD, lambda d: _any_of(d.joints.bus, HELD_BUS_FAULTS), P, _report),
    Row(E.BUS_ERRORS, F.NOTE, lambda d: _any_of(d.joints.bus, NOTED_BUS_FAULTS), detail=_report),
    Row(E.UNEXPECTED_MOTION, F.DAMP, Above("drift_rad_s", lambda d: d.joints.drift_rad_s, DRIFT_RAD_S), P),
)

POSE_LIMIT_RAD = 0.21  # 12°
STILL_RAD_S = 0.5

_FASTEST = Above("speed_rad_s", lambda d: d.joints.fastest_rad_s, STILL_RAD_S)


def _legs_moving(d: Diagnostics) -> bool:
    """Power alone holds no leg: a STOP while the drives woke leaves them neutral."""
    return (not d.powered or d.joints.neutral) and _FASTEST(d)


POSE = (
    Row(
        E.NOT_HOMED,
        F.REFUSE,
        lambda d: not d.powered and d.joints.answering and d.joints.beyond_range,
        detail=_patients_limit,
        compares=worst_range,
    ),
    # A swinging leg is slow for a moment at each turning point: the event settles.
    Row(E.LEGS_MOVING, F.REFUSE, _legs_moving, compares=_FASTEST.compared, settles=True),
    Row(
        E.FAR_FROM_POSE,
        F.REFUSE,
        Above("pose_error_rad", lambda d: d.joints.pose_error_rad, POSE_LIMIT_RAD),
        P,
        lambda d: {"angle_rad": d.joints.pose_error_rad},
        displaces=True,
    ),
)
