"""What a tick is given and what it gives back, and how fresh the received streams are: values only.

Freshness is computed here, once, the same on hardware as in simulation.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

from msgspec import Struct
from msgspec.structs import replace

from app.ipc.messages import AuditHealth, GuardianHealth, LinkHealth, OperatorCommand, TriggerReport
from app.ipc.states import ACTION_OF, Action, GaitState, Source
from app.motion.follower import Gains
from app.motion.plan import Plan, PlanRequest
from hal.inputs.device import InputReadings
from hal.joints.guard import Limits, Refusal
from hal.joints.protocol import Joint, JointArray, JointCommand, JointFeedback, carries_power
from kgdfa.gesture import Gesture
from logs.reason import Reason
from logs.records import Body

HOST_SUSPENDED_S = 0.1  # less is the time between two clocks' readings


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """One session's constants; poses (4,) a state, radians."""

    limits: Limits
    gains: Gains
    poses: Mapping[GaitState, JointArray]
    warn_c: JointArray
    limit_c: JointArray
    patient: str
    vocabulary: frozenset[Gesture] = frozenset(Gesture)  # the gestures that command
    device_high_rad: JointArray | None = None  # the device's own limit of flexion, where a patient's is known too
    unattended_ns: int = 120_000_000_000  # without a console for so long, the session ends


class Inputs(Struct, frozen=True, kw_only=True):
    """Everything that one tick may know; None or empty: not received since the tick before."""

    now_ns: int  # monotonic, read once at the tick's start
    wall_ns: int
    boot_ns: int  # as monotonic, but going on while the host sleeps
    feedback: JointFeedback
    report: TriggerReport | None = None
    commands: tuple[OperatorCommand, ...] = ()
    plans: tuple[Plan, ...] = ()
    audit: AuditHealth | None = None
    guardian: GuardianHealth | None = None
    link: LinkHealth | None = None
    late_ns: int = 0  # how late this tick began
    missed_ticks: int = 0  # left out before this one
    written: JointCommand | None = None  # the command that passed the guard, in the tick before
    written_ns: int = 0  # when
    guard_refusal: Refusal | None = None  # of the command of the tick before
    withheld: bool = False  # the command of the tick before was not written: control was frozen in it
    audit_full: bool = False  # a record of the tick before found the queue full
    rejected_messages: int = 0  # since the tick before
    foreign_peers: int = 0  # turned away since the tick before: they don't have the session's key
    drive_error: Reason | None = None  # why the order of the tick before to the drives failed
    stop_inputs: InputReadings = InputReadings()  # newest, whatever tick it came in
    must_end: bool = False  # the session's process is gone, or a signal asked for the end
    cleared: frozenset[Action] | None = None  # passed the pre-flight; None: none is needed (simulated joints)


class DriveOrder(Enum):
    """What the loop has to do with the drives beside writing the command."""

    NONE = "none"
    ENABLE = "enable"
    DISABLE = "disable"


class DriveNotice(Enum):
    """What control records about the drives' power that no command gives."""

    FOLLOWED_GUARDIAN = "followed-guardian"


class Outputs(Struct, frozen=True, kw_only=True):
    """What the loop has to do after a tick."""

    command: JointCommand
    unheld: frozenset[Joint] = frozenset()  # not held any more, whatever was commanded last
    drives: DriveOrder = DriveOrder.NONE
    plan_requests: tuple[PlanRequest, ...] = ()
    audit: tuple[Body, ...] = ()
    finished: bool = False  # the drives are off and the process may end


@dataclass(frozen=True, slots=True, kw_only=True)
class ActionRequest:
    """An action that the wearer or the therapist requested; moments are 0 where there was no gesture."""

    action: Action
    source: Source
    recognised_ns: int = 0
    released_ns: int = 0
    pressed_ns: int = 0  # capture of the frame in which the push that released it had pressed
    requested_ns: int = 0  # when the therapist's key was pressed


class StreamState(Struct, frozen=True, kw_only=True):
    """The newest message of each stream with its time, and the clocks. Times are monotonic.

    Before the first message of a stream its age counts from the start.
    """

    report: TriggerReport | None = None
    report_ns: int
    release_count: int = 0  # the highest of this perception
    recognised: bool = False  # the hand model has been loaded since the session's start
    console_ns: int
    audit: AuditHealth | None = None
    audit_ns: int
    guardian: GuardianHealth | None = None
    guardian_ns: int
    link: LinkHealth | None = None  # None: the console is on this host
    resumed_ns: int = 0  # when control last came back from missed ticks
    own_delay_ns: int = 0  # how long control sent no command, of the time since the oldest feedback
    reader_delay_ns: int = 0  # how long control stood still, of the time since the stop inputs' newest reading
    unread_ns: int = 0  # how long control read no command, of the time since the console's newest one
    clock_offset_ns: int  # wall minus monotonic
    sleep_ns: int  # boot time minus monotonic: how long the host has slept
    clock_step_ns: int = 0  # in this tick
    slept_ns: int = 0  # in this tick
    woken_ns: int = 0  # when the host last woke
    powered: bool = False


def initial_streams(inputs: Inputs) -> StreamState:
    """Before the first tick."""
    now_ns = inputs.now_ns
    return StreamState(
        report_ns=now_ns,
        console_ns=now_ns,
        audit_ns=now_ns,
        guardian_ns=now_ns,
        clock_offset_ns=inputs.wall_ns - now_ns,
        sleep_ns=inputs.boot_ns - now_ns,
    )


def without_stale_report(streams: StreamState, inputs: Inputs) -> Inputs:
    """The inputs; a report of an earlier perception, or one that was received before, becomes a rejected message."""
    before, report = streams.report, inputs.report
    if before is None or report is None:
        return inputs
    if (report.incarnation, report.sequence) > (before.incarnation, before.sequence):
        return inputs
    return replace(inputs, report=None, rejected_messages=inputs.rejected_messages + 1)


def update_streams(streams: StreamState, inputs: Inputs, lease: int) -> StreamState:
    """The streams after this tick's messages; lease: of the console that counts."""
    now_ns = inputs.now_ns
    offset_ns, sleep_ns = inputs.wall_ns - now_ns, inputs.boot_ns - now_ns
    slept_ns = sleep_ns - streams.sleep_ns
    return StreamState(
        report=inputs.report or streams.report,
        report_ns=now_ns if inputs.report else streams.report_ns,
        release_count=_release_count(streams, inputs.report),
        recognised=streams.recognised or (inputs.report is not None and inputs.report.detector_ready),
        console_ns=max(streams.console_ns, *(one.sent_ns for one in inputs.commands if one.lease == lease), 0),
        audit=inputs.audit or streams.audit,
        audit_ns=now_ns if inputs.audit else streams.audit_ns,
        guardian=inputs.guardian or streams.guardian,
        guardian_ns=now_ns if inputs.guardian else streams.guardian_ns,
        link=inputs.link or streams.link,
        resumed_ns=now_ns if inputs.missed_ticks else streams.resumed_ns,
        own_delay_ns=_own_delay_ns(streams, inputs),
        reader_delay_ns=_reader_delay_ns(streams, inputs),
        unread_ns=(0 if streams.console_ns > streams.resumed_ns else streams.unread_ns) + _delay_ns(inputs),
        clock_offset_ns=offset_ns,
        sleep_ns=sleep_ns,
        clock_step_ns=offset_ns - streams.clock_offset_ns,
        slept_ns=slept_ns,
        woken_ns=now_ns if slept_ns > HOST_SUSPENDED_S * 1e9 else streams.woken_ns,
        powered=carries_power(inputs.feedback.state),
    )


def _own_delay_ns(streams: StreamState, inputs: Inputs) -> int:
    """Drives answer commands: while control misses ticks, the missing answers are not their fault."""
    all_since_resumed = min(answers_ns(inputs.feedback, streams.powered), default=inputs.now_ns) > streams.resumed_ns
    before_ns = 0 if all_since_resumed else streams.own_delay_ns
    return before_ns + _delay_ns(inputs)


def _reader_delay_ns(streams: StreamState, inputs: Inputs) -> int:
    """The thread that reads the stop inputs stands still with control; a reading after a delay ends it."""
    read_ns = inputs.stop_inputs.at_ns
    before_ns = 0 if read_ns > streams.resumed_ns else streams.reader_delay_ns
    return before_ns + min(_delay_ns(inputs), inputs.now_ns - read_ns)


def answers_ns(feedback: JointFeedback, powered: bool) -> list[int]:
    """When each joint answered last; without power, of those that are asked then."""
    unasked = frozenset[Joint]() if powered else feedback.unasked
    return [int(feedback.measured_ns[joint]) for joint in Joint if joint not in unasked]


def _delay_ns(inputs: Inputs) -> int:
    """How long control itself stood still before this tick."""
    return inputs.late_ns if inputs.missed_ticks else 0


def new_release(streams: StreamState, report: TriggerReport | None) -> ActionRequest | None:
    """The request of a gesture released in this report, if it is new; its age is judged by `requests`.

    streams: as they were before this report. A count that grew acts once, in a perception that restarted from 0.
    """
    if report is None or report.released_gesture is None or not report.release_count > _counted(streams, report):
        return None
    return ActionRequest(
        action=ACTION_OF[report.released_gesture],
        source=Source.GESTURE,
        recognised_ns=report.released_recognised_ns,
        released_ns=report.released_ns,
        pressed_ns=report.released_pressed_ns,
    )


def _counted(streams: StreamState, report: TriggerReport) -> int:
    """The releases that this perception had counted before."""
    before = streams.report
    return streams.release_count if before is not None and before.incarnation == report.incarnation else 0


def _release_count(streams: StreamState, report: TriggerReport | None) -> int:
    """A count that falls and grows again is not counted twice."""
    return streams.release_count if report is None else max(_counted(streams, report), report.release_count)
