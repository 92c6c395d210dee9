"""Rows of the table of events, and the check of a plan, again over the values that the trail holds of them."""

from __future__ import annotations

from collections.abc import Iterator
from math import nan
from typing import Any

import numpy as np
from msgspec.structs import replace

from app.control.diagnostics import ClockDiagnostics, Diagnostics, LinkFigure, ProgramDiagnostics
from app.control.events.row import Above, Compared
from app.control.events.table import ROW, advance, compared_fields
from app.control.inputs import Settings
from app.control.joint_diagnostics import JointDiagnostics, exceeded
from app.ipc.states import Event, LinkQuantity
from app.ipc.streams import TRIGGER
from app.motion.follower import Gains
from app.motion.plan import PLAN_SPEED_SHARE, PLAN_TORQUE_SHARE, PlanFault
from app.motion.plan_check import LEAST_CLEARANCE_M
from app.replay.difference import Difference, difference, differences
from hal.joints.guard import Limits, Quantity, Refusal
from hal.joints.protocol import DriveFault, DriveState, Joint, JointFeedback
from logs.reason import Reason, key_of, reason
from logs.records import EventRaised, JointLimits, PlanChecked, Record

UNPOWERED = {Event.NOT_HOMED, Event.LEGS_MOVING}


def event_differences(record: Record, body: EventRaised, limits: JointLimits) -> Iterator[Difference]:
    """What its row of the table makes of the recorded value, with the limits that control started with."""
    if body.event not in {one.value for one in Event}:
        yield difference(record, "event", body.event, None)
        return
    event = Event(body.event)
    again = replace(body, effect=ROW[event].effect.name.lower())
    if body.quantity and body.value is not None and body.limit is not None:
        compared = _compared_again(event, body.value, body, limits)
        again = replace(again, event="") if compared is None else replace(again, **compared)
    yield from differences(record, again)


def _compared_again(event: Event, value: float, body: EventRaised, limits: JointLimits) -> dict[str, Any] | None:
    """What the row compares, as the trail names it; None where it does not raise its event for the recorded value."""
    condition = ROW[event].present
    if isinstance(condition, Above):
        return (
            compared_fields(Compared(condition.quantity, value, condition.limit)) if value > condition.limit else None
        )
    raised = {one.event: one for one in advance((), _diagnostics(event, body, limits))}
    return compared_fields(raised[event].compared) if event in raised else None


# Where the value of a row that is more than `Above` stands in the diagnostics; a joint's stands in its feedback.
_PLACE: dict[Event, tuple[str, str]] = {
    Event.CAMERA_STALE: ("programs", "frame_age_ms"),
    Event.PERCEPTION_TIMEOUT: ("programs", "perception_age_ms"),
    Event.GUARDIAN_TIMEOUT: ("programs", "guardian_age_ms"),
    Event.TICK_LATE: ("clocks", "late_ms"),
    Event.CONTROL_LATE: ("clocks", "late_ms"),
    Event.JOINT_TIMEOUT: ("joints", "age_ms"),
    Event.LEGS_MOVING: ("joints", "fastest_rad_s"),
}
_FEEDBACK = {"angle_rad": "position_rad", "speed_rad_s": "velocity_rad_s"}  # others are named alike


def _diagnostics(event: Event, body: EventRaised, limits: JointLimits) -> Diagnostics:
    """A tick in which nothing but the recorded value is remarkable."""
    value, limit, values = body.value or 0.0, body.limit or 0.0, _values(body)
    detail = values.get("detail")
    fault = detail if isinstance(detail, Reason) else None
    tick = Diagnostics(
        now_ns=body.raised_ns,
        powered=event not in UNPOWERED,
        programs=ProgramDiagnostics(
            camera_fault=fault if event is Event.CAMERA_STALE else None,
            guardian_fault=fault if event is Event.GUARDIAN_TIMEOUT else None,
            link=(LinkFigure(LinkQuantity(body.quantity), limit, value),) if event is Event.LINK_POOR else (),
            perception_limit_ms=limit if event is Event.PERCEPTION_TIMEOUT else TRIGGER.stale_ms,
        ),
        clocks=ClockDiagnostics(missed_ticks=int(values.get("missed", 0))),
        joints=_joints(event, body, limits),
    )
    if event not in _PLACE:
        return tick
    part, field = _PLACE[event]
    return replace(tick, **{part: replace(getattr(tick, part), **{field: value})})


def _joints(event: Event, body: EventRaised, limits: JointLimits) -> JointDiagnostics:
    value = body.value or 0.0
    joint = Joint[body.joint.upper()] if body.joint else None
    if event is Event.GUARD_REFUSAL and joint is not None:
        refused = Refusal(joint=joint, quantity=Quantity(body.quantity), value=value, limit=body.limit or 0.0)
        return JointDiagnostics(guard_refusal=refused)
    if joint is None or event in _PLACE:
        return JointDiagnostics(silent_joint=joint)
    settings, feedback = _settings(limits), _at_rest(limits)
    getattr(feedback, _FEEDBACK.get(body.quantity, body.quantity))[joint] = value
    return replace(JointDiagnostics(feedback=feedback, settings=settings), **exceeded(feedback, settings))


def _values(body: EventRaised) -> dict[str, Any]:
    return body.text.values if isinstance(body.text, Reason) else {}


def _settings(limits: JointLimits) -> Settings:
    """Only what the rows compare with is real."""
    none = np.zeros(4)
    arrays = {
        name: np.array(getattr(limits, name), dtype=float)
        for name in ("low_rad", "high_rad", "speed_rad_s", "torque_nm")
    }
    return Settings(
        limits=Limits(stiffness_nm_rad=none, damping_nm_s_rad=none, **arrays),
        gains=Gains(
            stiffness_nm_rad=none, damping_nm_s_rad=none, damped_nm_s_rad=none, assist=none, torque_slew_nm=none
        ),
        poses={},
        warn_c=np.array(limits.warn_c, dtype=float),
        limit_c=np.array(limits.limit_c, dtype=float),
        patient="",
    )


def _at_rest(limits: JointLimits) -> JointFeedback:
    """In the middle of the range, without a temperature."""
    middle = (np.array(limits.low_rad, dtype=float) + np.array(limits.high_rad, dtype=float)) / 2
    return JointFeedback(
        measured_ns=np.ones(4, dtype=np.int64),
        position_rad=middle,
        velocity_rad_s=np.zeros(4),
        torque_nm=np.zeros(4),
        temperature_c=np.full(4, nan),
        faults=(DriveFault.NONE,) * 4,
        state=DriveState.ENABLED,
    )


REPLAYED = {key_of(one) for one in (PlanFault.TOO_FAST, PlanFault.TOO_MUCH_TORQUE, PlanFault.TOO_LITTLE_CLEARANCE)}


def plan_differences(record: Record, body: PlanChecked, limits: JointLimits) -> Iterator[Difference]:
    """A plan that may run is within its limits; one refused for its peaks is beyond the limit that it names.

    Other refusals (angles, a path out of reach) rest on the whole path, which the trail does not hold.
    """
    beyond = [*_beyond(body, limits)]
    if body.ok and beyond:
        yield difference(record, "ok", True, beyond[0].code)
    code = body.reason.code if isinstance(body.reason, Reason) else ""
    if not body.ok and code in REPLAYED and body.reason not in beyond:
        same = (one for one in beyond if one.code == code)
        yield difference(record, "reason", body.reason, next(same, None))


def _beyond(body: PlanChecked, limits: JointLimits) -> Iterator[Reason]:
    for joint in Joint:
        speed, fastest = body.peak_speed_rad_s[joint], limits.speed_rad_s[joint]
        if speed is not None and fastest is not None and speed > PLAN_SPEED_SHARE * fastest:
            limit = PLAN_SPEED_SHARE * fastest
            yield reason(PlanFault.TOO_FAST, joint=joint, speed_rad_s=speed, limit_rad_s=limit)
        torque, strongest = body.peak_torque_nm[joint], limits.torque_nm[joint]
        if torque is not None and strongest is not None and torque > PLAN_TORQUE_SHARE * strongest:
            limit = PLAN_TORQUE_SHARE * strongest
            yield reason(PlanFault.TOO_MUCH_TORQUE, joint=joint, torque_nm=torque, limit_nm=limit)
    clearance = body.min_clearance_m
    if clearance is not None and clearance < LEAST_CLEARANCE_M:
        yield reason(PlanFault.TOO_LITTLE_CLEARANCE, clearance_m=clearance, limit_m=LEAST_CLEARANCE_M)
