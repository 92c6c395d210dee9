"""One tick's quantities, as the table of events compares them with its limits."""

from __future__ import annotations

from collections.abc import Iterable
from math import isnan, nan
from operator import ge, gt
from typing import TYPE_CHECKING

import numpy as np
from msgspec import Struct

from app.control.inputs import Inputs, Settings, StreamState, answers_ns
from app.control.silence import angles_sunk_rad, silent_joints
from app.control.stop_inputs import StopInputStates, reader_age_ns
from app.ipc.messages import LinkHealth
from app.ipc.states import LinkQuantity
from app.ipc.streams import NS_PER_MS, TRIGGER
from app.motion.follower import Mode, Motion
from hal.errors import HardwareError
from hal.joints.guard import RANGE_MARGIN_RAD, SPEED_MARGIN, TORQUE_MARGIN, Refusal
from hal.joints.protocol import BusFault, DriveFault, Joint, JointFeedback
from logs.reason import Reason, Value, reason

if TYPE_CHECKING:  # the state holds events, whose rows read the diagnostics
    from app.control.state import ControlState, Tick

FOLLOWING_WARN_RAD = 0.14  # 8°, four times the tracking that the plans are checked for
LOADING_MS = 30_000.0  # until the hand model is loaded, messages may be late or missing: no sign of a fault
# With more than this a gesture's release, which is 100 ms old when perception has judged it, may be older than TRIGGER
# allows when it arrives, and a heartbeat may look lost. TCP repeats what was lost after 200 ms.
LINK_LIMITS = {
    LinkQuantity.LOSS: 0.05,
    LinkQuantity.ROUND_TRIP: 100.0,
    LinkQuantity.JITTER: 30.0,
    LinkQuantity.UNCERTAINTY: 50.0,
}
UNKNOWN_MS = 60_000.0  # the uncertainty before the first round trip: more than any that is
SETTLED_NS = 500 * NS_PER_MS  # after a movement the joints settle; later motion while held is unexpected


class SessionDiagnostics(Struct, frozen=True, kw_only=True):
    """What the operator commanded, and what is missing before motion."""

    armed: bool = True
    patient_confirmed: bool = True
    lacks_preflight: bool = False  # an action requested in this tick has not passed its pre-flight
    stop_presses: int = 0
    voice_stopped: bool = False
    ending: bool = False
    ending_damped: bool = False  # it has been ending for so long that the joints are damped


class PlanningDiagnostics(Struct, frozen=True, kw_only=True):
    """Whether the planner keeps up with what runs."""

    ready: bool = True
    timed_out: bool = False
    next_step_missing: bool = False
    pause_too_long: bool = False


class LinkFigure(Struct, frozen=True):
    """A figure of the link, its unit in its name, and the largest with which gestures may be armed."""

    quantity: LinkQuantity
    limit: float
    value: float


class ProgramDiagnostics(Struct, frozen=True, kw_only=True):
    """The processes beside control; ages count from their last message."""

    frame_age_ms: float = 0.0
    camera_fault: Reason | None = None
    perception_age_ms: float = 0.0
    perception_limit_ms: float = TRIGGER.stale_ms  # longer while the hand model is loading
    perception_starting: bool = False  # the hand model is loading, at the session's start or after a restart
    console_age_ms: float = 0.0
    audit_age_ms: float = 0.0
    audit_waiting: int = 0
    audit_fault: Reason | None = None
    audit_full: bool = False
    guardian_age_ms: float = 0.0
    guardian_acted: bool = False
    guardian_fault: Reason | None = None
    rejected_messages: int = 0
    foreign_peers: int = 0
    link: tuple[LinkFigure, ...] = ()  # to the console's computer; empty where it is on this one


class ClockDiagnostics(Struct, frozen=True, kw_only=True):
    """How late control is, and what the computer's clocks did."""

    late_ms: float = 0.0
    missed_ticks: int = 0
    reader_age_ms: float = 0.0  # of the stop inputs' newest reading
    slept_s: float = 0.0
    step_s: float = 0.0


class JointDiagnostics(Struct, frozen=True, kw_only=True):
    """What joints, drives and bus report; errors are 0 where nothing is held that could err."""

    answering: bool = True  # every joint has answered at least once
    age_ms: float = 0.0  # of the oldest answer; without power, of drives that are asked then
    drives_lost: bool = False
    neutral: bool = False  # with power or without, no joint is stiff or damped
    drive_faults: DriveFault = DriveFault.NONE
    drive_detail: HardwareError | None = None
    silent_joint: Joint | None = None
    silent: frozenset[Joint] = frozenset()  # without an answer for a while, whoever is to blame
    sunk_rad: float = 0.0  # the most of a joint that answers again, since its last answer before
    sunk: frozenset[Joint] = frozenset()  # those that have sunk too far meanwhile
    drive_error: Reason | None = None
    bus: BusFault = BusFault.NONE
    hottest_c: float = nan
    warm: bool = False
    hot: bool = False
    following_rad: float = 0.0
    pose_error_rad: float = 0.0
    drift_rad_s: float = 0.0
    fastest_rad_s: float = 0.0  # of the joints that answer
    beyond_range: bool = False
    beyond_speed: bool = False
    beyond_torque: bool = False
    guard_refusal: Refusal | None = None
    feedback: JointFeedback | None = None  # what the figures above are of
    settings: Settings | None = None


class Diagnostics(Struct, frozen=True, kw_only=True):
    """All quantities of a tick."""

    now_ns: int
    powered: bool
    session: SessionDiagnostics = SessionDiagnostics()
    planning: PlanningDiagnostics = PlanningDiagnostics()
    programs: ProgramDiagnostics = ProgramDiagnostics()
    clocks: ClockDiagnostics = ClockDiagnostics()
    joints: JointDiagnostics = JointDiagnostics()
    stop_inputs: StopInputStates = ()


def collect_diagnostics(tick: Tick, session: SessionDiagnostics, planning: PlanningDiagnostics) -> Diagnostics:
    """The quantities of a tick; session and planning are its stages' state."""
    inputs, streams = tick.inputs, tick.state.streams
    return Diagnostics(
        now_ns=inputs.now_ns,
        powered=streams.powered,
        session=session,
        planning=planning,
        programs=_programs(inputs, streams),
        clocks=_clocks(inputs, streams),
        joints=_joints(inputs, tick.state, tick.settings),
        stop_inputs=tick.state.stop_inputs,
    )


def _programs(inputs: Inputs, streams: StreamState) -> ProgramDiagnostics:
    now_ns = inputs.now_ns
    report, audit, guardian = streams.report, streams.audit, streams.guardian
    perception_age_ms = _age_ms(now_ns, streams.report_ns)
    loading = report is None or not report.detector_ready
    return ProgramDiagnostics(
        frame_age_ms=_age_ms(now_ns, report.captured_ns) if report and streams.recognised else 0.0,
        camera_fault=report.camera_fault if report else None,
        perception_age_ms=perception_age_ms,
        perception_limit_ms=LOADING_MS if loading else TRIGGER.stale_ms,
        perception_starting=(loading or not streams.recognised) and perception_age_ms <= LOADING_MS,
        console_age_ms=_age_ms(now_ns, streams.console_ns),
        audit_age_ms=_age_ms(now_ns, streams.audit_ns),
        audit_waiting=audit.waiting if audit else 0,
        audit_fault=(audit.fault if audit else None) or _other_audit_fault(streams.link),
        audit_full=inputs.audit_full,
        guardian_age_ms=_age_ms(now_ns, streams.guardian_ns),
        guardian_acted=guardian is not None and guardian.acted,
        guardian_fault=guardian.fault if guardian else None,
        rejected_messages=inputs.rejected_messages,
        foreign_peers=inputs.foreign_peers,
        link=link_figures(streams.link),
    )


def _other_audit_fault(link: LinkHealth | None) -> Reason | None:
    """Of the other computer's trail, which must not fail unseen either."""
    return None if link is None or link.audit is None else link.audit.fault


def link_figures(link: LinkHealth | None) -> tuple[LinkFigure, ...]:
    """The link's figures with their limits; none where the console is on this host."""
    if link is None:
        return ()
    uncertainty_ms = UNKNOWN_MS if link.uncertainty_ns is None else link.uncertainty_ns / NS_PER_MS
    values = (link.loss, link.round_trip_ms, link.jitter_ms, uncertainty_ms)
    return tuple(LinkFigure(*limit, value) for limit, value in zip(LINK_LIMITS.items(), values, strict=True))


def link_values(figure: LinkFigure | None) -> dict[str, Value]:
    """The values of its message."""
    return {} if figure is None else {"quantity": reason(figure.quantity), "value": figure.value, "limit": figure.limit}


def exceeded_figure(figures: tuple[LinkFigure, ...]) -> LinkFigure | None:
    """The first that is over its limit."""
    return next((one for one in figures if one.value > one.limit), None)


def _clocks(inputs: Inputs, streams: StreamState) -> ClockDiagnostics:
    return ClockDiagnostics(
        late_ms=inputs.late_ns / NS_PER_MS,
        missed_ticks=inputs.missed_ticks,
        reader_age_ms=reader_age_ns(inputs.stop_inputs, inputs.now_ns, streams.reader_delay_ns) / NS_PER_MS,
        slept_s=streams.slept_ns / 1e9,
        step_s=streams.clock_step_ns / 1e9,
    )


def _joints(inputs: Inputs, state: ControlState, settings: Settings) -> JointDiagnostics:
    now_ns, feedback = inputs.now_ns, inputs.feedback
    motion, streams = state.motion, state.streams
    measured_ns, temperatures_c = feedback.measured_ns.tolist(), feedback.temperature_c.tolist()
    oldest_ns = min(answers_ns(feedback, streams.powered), default=now_ns)
    silent = silent_joints(streams, feedback, now_ns)
    sunk_rad = angles_sunk_rad(state.silenced, motion, feedback, silent)
    fastest_rad_s = _fastest_rad_s(feedback, silent if streams.powered else feedback.unasked)
    return JointDiagnostics(
        answering=min(measured_ns) > 0,
        age_ms=_age_ms(now_ns - streams.own_delay_ns, oldest_ns),
        drives_lost=motion.mode is not Mode.DISABLED and not streams.powered,
        neutral=motion.mode is Mode.DISABLED,
        drive_faults=_union(feedback.faults),
        drive_detail=feedback.detail,
        silent_joint=_silent_joint(measured_ns, oldest_ns),
        silent=silent,
        sunk_rad=max(sunk_rad.values(), default=0.0),
        sunk=frozenset(joint for joint, angle_rad in sunk_rad.items() if angle_rad > FOLLOWING_WARN_RAD),
        drive_error=inputs.drive_error,
        bus=feedback.bus,
        hottest_c=max([value for value in temperatures_c if not isnan(value)], default=nan),
        following_rad=_following_rad(motion, feedback),
        pose_error_rad=_pose_error_rad(state, feedback, settings),
        drift_rad_s=fastest_rad_s if _is_settled(state, now_ns) else 0.0,
        fastest_rad_s=fastest_rad_s,
        guard_refusal=inputs.guard_refusal,
        feedback=feedback,
        settings=settings,
        **exceeded(feedback, settings),
    )


def exceeded(feedback: JointFeedback, settings: Settings) -> dict[str, bool]:
    """Which limits any joint exceeds: fields of `JointDiagnostics`. A temperature not measured (NaN) is above none."""
    limits, temperatures_c = settings.limits, feedback.temperature_c.tolist()
    speeds, torques = map(abs, feedback.velocity_rad_s.tolist()), map(abs, feedback.torque_nm.tolist())
    return {
        "warm": any(map(ge, temperatures_c, settings.warn_c.tolist())),
        "hot": any(map(ge, temperatures_c, settings.limit_c.tolist())),
        "beyond_range": _beyond_range(feedback.position_rad.tolist(), settings),
        "beyond_speed": any(map(gt, speeds, [SPEED_MARGIN * limit for limit in limits.speed_rad_s.tolist()])),
        "beyond_torque": any(map(gt, torques, [TORQUE_MARGIN * limit for limit in limits.torque_nm.tolist()])),
    }


def _age_ms(now_ns: int, then_ns: int) -> float:
    return (now_ns - then_ns) / NS_PER_MS


def _silent_joint(measured_ns: list[int], oldest_ns: int) -> Joint | None:
    """The joint without an answer for the longest time; None when all answer."""
    if max(measured_ns) - oldest_ns < 10 * NS_PER_MS:
        return None
    return Joint(measured_ns.index(oldest_ns))


def _union(faults: Iterable[DriveFault]) -> DriveFault:
    union = DriveFault.NONE
    for fault in faults:
        if fault is not DriveFault.NONE:
            union |= fault
    return union


def _beyond_range(values: list[float], settings: Settings) -> bool:
    low, high = settings.limits.low_rad.tolist(), settings.limits.high_rad.tolist()
    return any(
        not least - RANGE_MARGIN_RAD <= value <= most + RANGE_MARGIN_RAD
        for value, least, most in zip(values, low, high, strict=True)
    )


def _following_rad(motion: Motion, feedback: JointFeedback) -> float:
    """The largest distance of a stiff joint from its target."""
    if motion.mode not in {Mode.HOLDING, Mode.MOVING}:
        return 0.0
    return float(np.abs(motion.command.position_rad - feedback.position_rad).max())


def _pose_error_rad(state: ControlState, feedback: JointFeedback, settings: Settings) -> float:
    """The largest distance of a resting, stiff joint from its state's pose."""
    pose = settings.poses.get(state.gait.state)
    if pose is None or state.gait.running is not None or state.motion.mode is not Mode.HOLDING:
        return 0.0
    return float(np.abs(pose - feedback.position_rad).max())


def _fastest_rad_s(feedback: JointFeedback, stale: frozenset[Joint]) -> float:
    """The largest speed of a joint; stale: those whose last answer, for ever the same, tells nothing of now."""
    speeds_rad_s = zip(Joint, map(abs, feedback.velocity_rad_s.tolist()), strict=True)
    return max((speed for joint, speed in speeds_rad_s if joint not in stale), default=0.0)


def _is_settled(state: ControlState, now_ns: int) -> bool:
    """Whether the joints have been held for a while."""
    still_ns = now_ns - state.still_since_ns
    held = state.streams.powered and state.motion.mode is Mode.HOLDING
    return held and state.still_since_ns > 0 and still_ns >= SETTLED_NS
