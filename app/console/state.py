"""What the console knows of the running session: the newest of each stream, folded from what arrives."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum, auto

from app.ipc.messages import ActiveEvent, AuditHealth, ControlSnapshot, Preview, TriggerReport
from app.ipc.states import Effect
from app.ipc.streams import SNAPSHOT, TRIGGER
from app.session.host import Latest, ProcessStatus
from app.system.config import SessionSetup
from app.text.catalogue import render


@dataclass(frozen=True, slots=True, kw_only=True)
class PushNote:
    """`said` in perception's own words; `cancelled`: a press was under way, else none had begun."""

    said: str = ""
    cancelled: bool = False
    since_ns: int = 0
    cancel_count: int = 0
    incarnation: int = 0


NOTHING_PUSHED = PushNote()


class ProcessFault(Enum):
    """Why the console records the end of another process."""

    EXITED = auto()  # exit_code: negative is a signal's number


def newly_ended(before: tuple[ProcessStatus, ...], now: tuple[ProcessStatus, ...]) -> tuple[ProcessStatus, ...]:
    """The processes that were alive before and are not any more, restarted ones too."""
    latest = {(process.name, process.pid): process for process in now}
    ended = (
        latest.get((process.name, process.pid), replace(process, alive=False)) for process in before if process.alive
    )
    return tuple(process for process in ended if not process.alive)


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionState:
    """Everything the session's widgets draw from; time is the console's monotonic clock at the last fold."""

    setup: SessionSetup
    started_ns: int
    now_ns: int
    snapshot: ControlSnapshot | None = None
    report: TriggerReport | None = None
    preview: Preview | None = None
    audit: AuditHealth | None = None
    processes: tuple[ProcessStatus, ...] = ()
    push: PushNote = NOTHING_PUSHED
    fault: str = ""  # why the session could not start

    @property
    def snapshot_fresh(self) -> bool:
        """Whether control has spoken lately."""
        return self.snapshot is not None and self.now_ns - self.snapshot.at_ns < SNAPSHOT.stale_ms * 1e6

    @property
    def report_fresh(self) -> bool:
        """Whether perception has spoken lately of a recent picture."""
        return self.report is not None and self.now_ns - self.report.sent_ns < TRIGGER.stale_ms * 1e6

    @property
    def effect(self) -> Effect | None:
        """The strongest effect in force; None before control has spoken."""
        return None if self.snapshot is None else self.snapshot.effect

    @property
    def events(self) -> tuple[ActiveEvent, ...]:
        """Unacknowledged ones first, the strongest of them on top, then the newest."""
        found = () if self.snapshot is None else self.snapshot.events
        return tuple(sorted(found, key=lambda event: (event.acknowledged, -event.effect, -event.since_ns)))

    @property
    def moving(self) -> bool:
        """Whether legs move, or control's silence leaves it open."""
        return self.snapshot is None or self.snapshot.action is not None or not self.snapshot_fresh

    @property
    def elapsed_s(self) -> float:
        """Since the session began."""
        return (self.now_ns - self.started_ns) / 1e9


def fold(state: SessionState, latest: Latest, now_ns: int) -> SessionState:
    """The state after a look at the streams; what did not arrive stays."""
    return replace(
        state,
        now_ns=now_ns,
        snapshot=latest.snapshot or state.snapshot,
        report=latest.report or state.report,
        preview=latest.preview or state.preview,
        audit=latest.audit or state.audit,
        processes=latest.processes,
        push=state.push if latest.report is None else note(state.push, latest.report, now_ns),
    )


READABLE_NS = 5_000_000_000


def note(before: PushNote, report: TriggerReport, now_ns: int) -> PushNote:
    """The note after one more report; a press that succeeds, and time, wipe it out."""
    if report.incarnation != before.incarnation:
        return PushNote(incarnation=report.incarnation, cancel_count=report.cancel_count)
    if report.cancel_count > before.cancel_count:
        return replace(
            before,
            said=render(report.cancel_reason) if report.cancel_reason else "",
            cancelled=True,
            since_ns=now_ns,
            cancel_count=report.cancel_count,
        )
    if report.press_hint and not report.pressed:
        return replace(before, said=render(report.press_hint), cancelled=False, since_ns=now_ns)
    if report.pressed or now_ns - before.since_ns > READABLE_NS:
        return replace(before, said="", cancelled=False)
    return before
