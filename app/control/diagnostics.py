"""One tick's quantities, as the table of events compares them with its limits."""

from __future__ import annotations

from typing import TYPE_CHECKING

from msgspec import Struct

from app.control.inputs import Inputs, StreamState
from app.control.joint_diagnostics import JointDiagnostics, joint_diagnostics
from app.control.stop_inputs import StopInputStates, reader_age_ns
from app.ipc.messages import LinkHealth
from app.ipc.states import LinkQuantity
from app.ipc.streams import NS_PER_MS, TRIGGER
from logs.reason import Reason, Value, reason

if TYPE_CHECKING:  # the state holds events, whose rows read the diagnostics
    from app.control.state import Tick

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
        joints=joint_diagnostics(inputs, tick.state, tick.settings),
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


def _age_ms(now_ns: int, then_ns: int) -> float:
    return (now_ns - then_ns) / NS_PER_MS
