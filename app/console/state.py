"""What the console knows of the running session: the newest of each stream, folded from what arrives."""

from __future__ import annotations

from dataclasses import dataclass, replace

from app.ipc.messages import AuditHealth, GuardianHealth, LinkHealth, Preview, ProcessStatus, TriggerReport
from app.ipc.snapshot import ActiveEvent, ControlSnapshot
from app.ipc.states import Effect, Event
from app.ipc.streams import AUDIT_HEALTH, GUARDIAN, SNAPSHOT, TRIGGER
from app.session.latest import Latest
from app.session.launch import MOVERS
from app.system.config import SessionSetup
from app.system.vocabulary import VocabularyStatus
from app.voice.signals import VoiceState
from logs.reason import Reason


@dataclass(frozen=True, slots=True, kw_only=True)
class PressNote:
    """Why a push gave no command. cancelled: a press was under way, else none had begun."""

    reason: Reason | None = None
    cancelled: bool = False
    since_ns: int = 0
    cancel_count: int = 0
    incarnation: int = 0


NO_NOTE = PressNote()
PATIENCE_S = 8.0  # starting the processes and loading the hand model


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionState:
    """Everything the session's widgets draw from; time is the console's monotonic clock at the last fold."""

    setup: SessionSetup
    started_ns: int  # when this console came to it
    now_ns: int
    snapshot: ControlSnapshot | None = None
    report: TriggerReport | None = None
    preview: Preview | None = None
    audit: AuditHealth | None = None
    guardian: GuardianHealth | None = None
    processes: tuple[ProcessStatus, ...] = ()
    press_note: PressNote = NO_NOTE
    fault: str = ""  # why the session could not start
    link: LinkHealth | None = None  # to the computer that has the joints; None: this one has
    stop_sent_ns: int = 0  # of the oldest STOP that control has not acknowledged; 0: none waits
    vocabulary: VocabularyStatus = VocabularyStatus.NOT_NEEDED  # of the patient, as the session began
    voice: VoiceState | None = None  # None: not switched on

    @property
    def snapshot_fresh(self) -> bool:
        """Whether control's newest snapshot is recent."""
        return self.snapshot is not None and self.now_ns - self.snapshot.at_ns < SNAPSHOT.stale_ms * 1e6

    @property
    def report_fresh(self) -> bool:
        """Whether perception's newest report is recent."""
        return self.report is not None and self.now_ns - self.report.sent_ns < TRIGGER.stale_ms * 1e6

    @property
    def audit_silent(self) -> bool:
        """Whether the audit process has spoken and does not any more: what is recorded now is lost."""
        return self.audit is not None and self.now_ns - self.audit.at_ns > AUDIT_HEALTH.stale_ms * 1e6

    @property
    def stop_waits_ms(self) -> float:
        """For so long a STOP has waited to be acknowledged by control; 0: none waits. Sent is not acknowledged."""
        return (self.now_ns - self.stop_sent_ns) / 1e6 if self.stop_sent_ns else 0.0

    @property
    def all_processes(self) -> tuple[ProcessStatus, ...]:
        """Of this computer, and of the one that has the joints."""
        return (*self.processes, *(self.link.processes if self.link is not None else ()))

    @property
    def control_alive(self) -> bool:
        """Whether anything could still move: control runs, here or behind the link."""
        return any(process.name in MOVERS and process.alive for process in self.processes)

    @property
    def control_ended(self) -> bool:
        """Whether what commands the legs ran and is gone: STOP has no effect."""
        return any(process.name in MOVERS for process in self.processes) and not self.control_alive

    @property
    def simulated(self) -> bool:
        """Whether no drive exists."""
        return self.setup.config.joints.kind == "simulated" and not self.setup.joints_elsewhere

    @property
    def unanswered(self) -> bool:
        """Whether the guardian's frames have no effect on some drive, as far as anybody knows."""
        return self.guardian is not None and bool(self.guardian.unanswered)

    @property
    def left_on(self) -> bool:
        """Whether control has ended, or its computer is gone, and nobody has seen the drives off.

        Those that hold their last command for ever are stiff until the next session starts or their supply is cut.
        """
        now, guardian = self.snapshot, self.guardian
        if now is None or self.simulated or self.control_alive:
            return False
        switched_off = guardian is not None and guardian.off and guardian.fault is None
        return self.unanswered or (now.enabled and not switched_off)

    @property
    def abandoned(self) -> bool:
        """Whether drives were left on and the guardian does not damp them: nothing can stop the legs."""
        guardian = self.guardian
        if guardian is None or self.now_ns - guardian.at_ns > GUARDIAN.stale_ms * 1e6:
            return self.left_on
        return self.left_on and (guardian.fault is not None or self.unanswered)

    @property
    def ended_processes(self) -> tuple[ProcessStatus, ...]:
        """Those that ran and have ended."""
        return tuple(one for one in self.all_processes if not one.alive and one.exit_code is not None)

    @property
    def effect(self) -> Effect | None:
        """The strongest effect in force; None before the first snapshot."""
        return None if self.snapshot is None else self.snapshot.effect

    @property
    def events(self) -> tuple[ActiveEvent, ...]:
        """Unacknowledged ones first, the strongest of them on top, then the newest."""
        found = () if self.snapshot is None else self.snapshot.events
        return tuple(sorted(found, key=lambda event: (event.acknowledged, -event.effect, -event.since_ns)))

    @property
    def misses_process(self) -> bool:
        """Whether control waits for a process without which nothing begins; it may be frozen."""
        needed = (Event.AUDIT_TIMEOUT, Event.GUARDIAN_TIMEOUT)
        return any(one.present and one.event in needed for one in self.events)

    @property
    def has_stop_inputs(self) -> bool:
        """Whether stop buttons are connected: control knows; before its first snapshot, the configuration here may."""
        if self.snapshot is not None:
            return bool(self.snapshot.stop_inputs)
        return bool(self.setup.config.inputs) and not self.setup.joints_elsewhere

    @property
    def moving(self) -> bool:
        """Whether the legs move, or may as far as the console can know; a session that did not start moves none."""
        if self.snapshot is None or not self.snapshot_fresh:
            return not self.fault
        return self.snapshot.action is not None

    @property
    def elapsed_s(self) -> float:
        """Since the session began, which may have been before this console."""
        return (self.now_ns - (self.setup.began_ns or self.started_ns)) / 1e9

    @property
    def starting(self) -> bool:
        """Whether the processes start and the hand model loads, as far as patience goes."""
        return self.now_ns - self.started_ns < PATIENCE_S * 1e9 and not self.fault


def fold(state: SessionState, latest: Latest, now_ns: int) -> SessionState:
    """The state with what has newly arrived; the rest stays."""
    return replace(
        state,
        now_ns=now_ns,
        snapshot=latest.snapshot or state.snapshot,
        report=latest.report or state.report,
        preview=latest.preview or state.preview,
        audit=latest.audit or state.audit,
        guardian=latest.guardian or state.guardian,
        processes=latest.processes,
        link=latest.link or state.link,
        stop_sent_ns=latest.stop_sent_ns,
        press_note=state.press_note if latest.report is None else note(state.press_note, latest.report, now_ns),
    )


READABLE_NS = 5_000_000_000


def note(before: PressNote, report: TriggerReport, now_ns: int) -> PressNote:
    """The note after one more report; cleared by a press that succeeds, or after READABLE_NS."""
    if report.incarnation != before.incarnation:
        return PressNote(incarnation=report.incarnation, cancel_count=report.cancel_count)
    if report.cancel_count > before.cancel_count:
        return replace(
            before, reason=report.cancel_reason, cancelled=True, since_ns=now_ns, cancel_count=report.cancel_count
        )
    if report.press_hint and not report.pressed:
        return replace(before, reason=report.press_hint, cancelled=False, since_ns=now_ns)
    if report.pressed or now_ns - before.since_ns > READABLE_NS:
        return replace(before, reason=None, cancelled=False)
    return before
