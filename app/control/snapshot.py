"""What control tells the console, the demo and whoever listens, twenty times a second."""

from __future__ import annotations

from dataclasses import dataclass

from app.control.events.table import ROW, Active, blocker
from app.control.freshness import NS_PER_MS
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
from hal.joints.protocol import Joint
from logs.reason import Reason, reason


@dataclass(frozen=True, slots=True, kw_only=True)
class Shell:
    """What only the shell knows."""

    incarnation: int
    sequence: int
    simulated: bool
    lateness: Lateness
    real_time: RealTime


def snapshot(memory: ControlState, inputs: Inputs, shell: Shell) -> ControlSnapshot:
    """Everything a screen shows of control."""
    gait, task, report = memory.gait, memory.task, memory.heard.report
    allowed, why_not = _allowed(memory)
    running = tuple(one for one in (task.report, task.ending) if one is not None) if task else ()
    return ControlSnapshot(
        incarnation=shell.incarnation,
        sequence=shell.sequence,
        at_ns=inputs.now_ns,
        state=gait.state,
        effect=memory.effect,
        armed=memory.armed_ns > 0,
        patient_confirmed=memory.patient_confirmed,
        enabled=memory.heard.powered,
        action=gait.running,
        progress=memory.motion.progress,
        pending=Action.WALK_END if gait.closing else None,
        allowed=allowed,
        why_not=why_not,
        joints=_joints(memory, inputs),
        events=tuple(_event(one) for one in memory.active),
        reports=(*memory.reports, *running),
        refusal=memory.refusal,
        refusal_count=memory.refusal_count,
        ignored_count=memory.ignored_count,
        acknowledged_sequence=memory.sequence,
        stop_seen_ns=memory.stop_seen_ns,
        stop_command_ns=memory.stop_command_ns,
        steps=memory.steps,
        distance_walked_m=memory.distance_walked_m,
        lateness=shell.lateness,
        real_time=shell.real_time,
        report_age_ms=(inputs.now_ns - (report.captured_ns if report else memory.heard.report_ns)) / NS_PER_MS,
        simulated=shell.simulated,
    )


def _allowed(memory: ControlState) -> tuple[tuple[Action, ...], Reason | None]:
    """What the therapist's keys may do now; the table of events has its say before the gait table."""
    forbidden = blocker(memory.active, Source.THERAPIST)
    if forbidden is not None:
        return (), forbidden.reason
    running = memory.gait.running
    if running is None and not memory.motion.settled:
        return (), reason(RequestRefusal.COMING_TO_REST)
    allowed = gait_machine.allowed(memory.gait)
    return allowed, None if allowed or running is None else reason(RequestRefusal.ACTION_RUNNING, action=running)


def _event(one: Active) -> ActiveEvent:
    return ActiveEvent(
        event=one.event,
        detail=one.detail,
        effect=ROW[one.event].effect,
        since_ns=one.since_ns,
        present=one.present,
        acknowledged=one.acknowledged or not one.latched,
    )


def _joints(memory: ControlState, inputs: Inputs) -> tuple[JointSnapshot, JointSnapshot, JointSnapshot, JointSnapshot]:
    left_hip, left_knee, right_hip, right_knee = (_joint(memory, inputs, joint) for joint in Joint)
    return left_hip, left_knee, right_hip, right_knee


def _joint(memory: ControlState, inputs: Inputs, joint: Joint) -> JointSnapshot:
    feedback, command = inputs.feedback, memory.motion.command
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
