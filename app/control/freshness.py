"""What control has heard, and when: freshness is computed here, once, the same on hardware as in simulation."""

from __future__ import annotations

from dataclasses import dataclass

from msgspec import Struct

from app.control.inputs import Inputs
from app.ipc.messages import AuditHealth, GuardianHealth, TriggerReport
from app.ipc.states import ACTION_OF, Action
from app.ipc.streams import TRIGGER
from hal.joints.protocol import carries_power

NS_PER_MS = 1_000_000
_FUTURE_NS = 50 * NS_PER_MS  # a capture time that lies ahead of now by more than this is nonsense


class StreamState(Struct, frozen=True, kw_only=True):
    """The newest of each stream, and the clocks of the tick before. Times are monotonic; before the first word of a
    stream its age counts from the start."""

    report: TriggerReport | None = None
    report_ns: int
    alive_ns: int
    audit: AuditHealth | None = None
    audit_ns: int
    guardian: GuardianHealth | None = None
    guardian_ns: int
    resumed_ns: int = 0  # when control last came back from missed ticks
    unasked_ns: int = 0  # for how long it asked no drive, of the time since the oldest answer
    clock_offset_ns: int  # wall minus monotonic
    sleep_ns: int  # boot time minus monotonic: how long the host has slept
    clock_step_ns: int = 0  # in this tick
    slept_ns: int = 0  # in this tick
    was_powered: bool = False
    powered: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Release:
    """A press that ended by withdrawal in this tick: the wearer's wish."""

    action: Action
    recognised_ns: int
    captured_ns: int


def initial_streams(inputs: Inputs) -> StreamState:
    """Before the first tick."""
    now_ns = inputs.now_ns
    return StreamState(
        report_ns=now_ns,
        alive_ns=now_ns,
        audit_ns=now_ns,
        guardian_ns=now_ns,
        clock_offset_ns=inputs.wall_ns - now_ns,
        sleep_ns=inputs.boot_ns - now_ns,
    )


def update_streams(heard: StreamState, inputs: Inputs) -> StreamState:
    """What has been heard after a tick."""
    now_ns = inputs.now_ns
    offset_ns, sleep_ns = inputs.wall_ns - now_ns, inputs.boot_ns - now_ns
    return StreamState(
        report=inputs.report or heard.report,
        report_ns=now_ns if inputs.report else heard.report_ns,
        alive_ns=max(heard.alive_ns, *(command.sent_ns for command in inputs.commands), 0),
        audit=inputs.audit or heard.audit,
        audit_ns=now_ns if inputs.audit else heard.audit_ns,
        guardian=inputs.guardian or heard.guardian,
        guardian_ns=now_ns if inputs.guardian else heard.guardian_ns,
        resumed_ns=now_ns if inputs.missed_ticks else heard.resumed_ns,
        unasked_ns=_unasked_ns(heard, inputs),
        clock_offset_ns=offset_ns,
        sleep_ns=sleep_ns,
        clock_step_ns=offset_ns - heard.clock_offset_ns,
        slept_ns=sleep_ns - heard.sleep_ns,
        was_powered=heard.powered,
        powered=carries_power(inputs.feedback.state, heard.powered),
    )


def _unasked_ns(heard: StreamState, inputs: Inputs) -> int:
    """Drives answer commands: while control misses ticks, their silence is not theirs. It counts on afterwards."""
    all_since_resumed = int(inputs.feedback.measured_ns.min()) > heard.resumed_ns
    before_ns = 0 if all_since_resumed else heard.unasked_ns
    return before_ns + (inputs.late_ns if inputs.missed_ticks else 0)


def release_in(heard: StreamState, report: TriggerReport | None, now_ns: int) -> Release | None:
    """The release that this report tells for the first time, while its frame is fresh.

    heard: as it was before this report. A count that grew acts once, in a perception that restarted from nothing; a
    stale release never acts, not even later.
    """
    if report is None or report.released_gesture is None or not _first_told(heard.report, report):
        return None
    if not -_FUTURE_NS <= now_ns - report.released_ns <= TRIGGER.stale_ms * NS_PER_MS:
        return None
    return Release(
        action=ACTION_OF[report.released_gesture],
        recognised_ns=report.released_recognised_ns,
        captured_ns=report.released_ns,
    )


def _first_told(before: TriggerReport | None, report: TriggerReport) -> bool:
    if before is None or before.incarnation != report.incarnation:
        return report.release_count > 0
    return report.release_count > before.release_count
