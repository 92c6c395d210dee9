"""The snapshot of control for console, demo and observers."""

from __future__ import annotations

from dataclasses import dataclass

from app.control.events.table import ROW, RaisedEvent, blocker
from app.control.gait import machine as gait_machine
from app.control.inputs import Inputs
from app.control.state import ControlState
from app.ipc.messages import (
    ActiveEvent,
    ControlSnapshot,
    JointSnapshot,
    Lateness,
    RealTime,
)
from app.ipc.states import Action, RequestRefusal, Source
from app.ipc.streams import NS_PER_MS
from hal.joints.protocol import Joint
from logs.reason import Reason, reason


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopStatus:
    """What only the loop knows."""

    incarnation: int
    sequence: int
    simulated: bool
    lateness: Lateness
    real_time: RealTime


def snapshot(state: ControlState, inputs: Inputs, status: LoopStatus) -> ControlSnapshot:
    """Everything that a screen shows of control."""
    gait, running, report = state.gait, state.running, state.streams.report
    allowed, why_not = _allowed(state)
    open_reports = tuple(one for one in (running.report, running.ending) if one is not None) if running else ()
    return ControlSnapshot(
        incarnation=status.incarnation,
        sequence=status.sequence,
        at_ns=inputs.now_ns,
        state=gait.state,
        effect=state.effect,
        armed=state.armed_ns > 0,
        patient_confirmed=state.patient_confirmed,
        enabled=state.streams.powered,
        action=gait.running,
        progress=state.motion.progress,
        pending=Action.WALK_END if gait.closing else None,
        allowed=allowed,
        why_not=why_not,
        joints=_joints(state, inputs),
        events=tuple(_event(one) for one in state.events),
        reports=(*state.reports, *open_reports),
        refusal=state.refusal,
        refusal_count=state.refusal_count,
        ignored_count=state.ignored_count,
        acknowledged_sequence=state.sequence,
        stop_seen_ns=state.stop_seen_ns,
        stop_command_ns=state.stop_command_ns,
        steps=state.steps,
        distance_walked_m=state.distance_walked_m,
        lateness=status.lateness,
        real_time=status.real_time,
        report_age_ms=(inputs.now_ns - (report.captured_ns if report else state.streams.report_ns)) / NS_PER_MS,
        simulated=status.simulated,
    )


def _allowed(state: ControlState) -> tuple[tuple[Action, ...], Reason | None]:
    """The actions that the therapist's keys may start now; without one, why. Events go before the gait table."""
    forbidden = blocker(state.events, Source.THERAPIST)
    if forbidden is not None:
        return (), forbidden.reason
    running = state.gait.running
    if running is None and not state.motion.settled:
        return (), reason(RequestRefusal.COMING_TO_REST)
    allowed = gait_machine.allowed(state.gait)
    return allowed, None if allowed or running is None else reason(RequestRefusal.ACTION_RUNNING, action=running)


def _event(one: RaisedEvent) -> ActiveEvent:
    return ActiveEvent(
        event=one.event,
        detail=one.detail,
        effect=ROW[one.event].effect,
        since_ns=one.since_ns,
        present=one.present,
        acknowledged=one.acknowledged or not one.latched,
    )


def _joints(state: ControlState, inputs: Inputs) -> tuple[JointSnapshot, JointSnapshot, JointSnapshot, JointSnapshot]:
    left_hip, left_knee, right_hip, right_knee = (_joint(state, inputs, joint) for joint in Joint)
    return left_hip, left_knee, right_hip, right_knee


def _joint(state: ControlState, inputs: Inputs, joint: Joint) -> JointSnapshot:
    feedback, command = inputs.feedback, state.motion.command
    fault = feedback.faults[joint]
    stiff = command.stiffness_nm_rad[joint] > 0
    angle_rad = float(feedback.position_rad[joint])
    return JointSnapshot(
        angle_rad=angle_rad,
        target_rad=float(command.position_rad[joint]) if stiff else angle_rad,
        speed_rad_s=float(feedback.velocity_rad_s[joint]),
        torque_nm=float(feedback.torque_nm[joint]),
        temperature_c=float(feedback.temperature_c[joint]),
        age_ms=(inputs.now_ns - int(feedback.measured_ns[joint])) / NS_PER_MS,
        faults=tuple(reason(each) for each in fault),
    )
