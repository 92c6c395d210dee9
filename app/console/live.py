"""The running session as the application holds it: host, folded state, STOP, guided tests, garbage collection."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from importlib import import_module
from typing import Protocol

import msgspec

from app.console.state import SessionState, fold
from app.console.stop import StopSwitch
from app.ipc.messages import HandCommand, OperatorKind, PerceptionCommand
from app.ipc.states import Action
from app.outcomes.guided import GuidedRefusal, GuidedRun, GuidedStop, GuidedTest, advance, begin, refusal_of, result_of
from app.outcomes.guided import stop as stopped
from app.session.latest import Latest
from app.system.authority import Authority
from app.system.config import SessionSetup
from app.system.operators import Permission
from app.system.paths import Home
from app.system.vocabulary import status_now
from app.voice.watch import VoiceStop
from logs.errors import AuditError
from logs.reason import reason
from logs.records import GuidedTestResult, Record, Recording

Clock = Callable[[], int]


class LiveSession:
    """One session from start to end; an observer's has no switch. `start` and `close` may take seconds: in a thread."""

    def __init__(self, host: Host, switch: StopSwitch | None, clock: Clock = time.monotonic_ns) -> None:
        self.host = host
        self._switch = switch
        self._clock = clock
        self.hand = HandCommand(press=False)  # what all commands together made of the digital hand
        self._consent: bool | None = None  # to pictures; None: nobody has said
        self._consented_incarnation = 0  # of perception, when it was sent; 0: none had reported yet
        now_ns = clock()
        vocabulary = status_now(host.setup.profile, host.setup.config)
        self.state = SessionState(setup=host.setup, started_ns=now_ns, now_ns=now_ns, vocabulary=vocabulary)
        self.ending = False
        self.closed = False
        self.left = False  # for another console: this one ends
        self._connect(lambda: host.send(OperatorKind.STOP))
        self._voice: VoiceStop | None = None
        config = host.setup.config.voice
        if config.on and switch is not None:  # an observer commands nobody, and neither does its microphone
            self._voice = VoiceStop(config, lambda: host.send(OperatorKind.VOICE_STOP))

    @property
    def pictures_agreed(self) -> bool:
        """Whether the patient has agreed to pictures, asked here or before the session was taken over."""
        return bool(self._consent)

    def start(self) -> None:
        """Start the processes; collections of garbage, which stop the heartbeat too, come rarely from now on."""
        reduce_gc()
        gc.collect()  # it stops all threads for 0.2 s: now, before there is a control that awaits the heartbeat
        taken_over = self.host.setup.host_pid
        self.host.start()
        if taken_over and self._consent is None:
            self._consent = recorded_consent(self.host.setup)
        if self._voice is not None:
            self._voice.start()

    def assign(self, authority: Authority) -> None:
        """To who takes it over. Raises AppError when they may not move legs."""
        authority.require(Permission.OPERATE)
        setup = msgspec.structs.replace(self.host.setup, operator=authority.name, role=authority.role_name)
        self.host.setup = setup
        self.state = replace(self.state, setup=setup)

    def failed(self, why: str) -> None:
        """The processes could not be started."""
        self.state = replace(self.state, fault=why)

    def tick(self) -> SessionState:
        """Take what has arrived."""
        self.state = fold(self.state, self.host.poll(), self._clock())
        self._keep_consent()
        if self._voice is not None:
            self.state = replace(self.state, voice=self._voice.state)
        return self.state

    def move_hand(self, command: HandCommand) -> None:
        """Move the digital hand."""
        self.hand = both(self.hand, command)
        self.host.send_to_perception(command)

    def record_pictures(self, consent: bool) -> None:
        """Tell perception whether pictures are agreed to; one that is restarted is told again."""
        self._consent = consent
        self._consented_incarnation = 0 if self.state.report is None else self.state.report.incarnation
        self.host.send_to_perception(PerceptionCommand(record_pictures=consent))

    def input_alive(self) -> None:
        """STOP can be given: whoever takes it runs. From any thread."""
        if not self.closed:
            self.host.heartbeat()

    def console_lost(self) -> None:
        """The console ends, and waits for nobody: no further heartbeat, so the legs are held. From any thread."""
        self.ending = self.left = True
        if not self.closed:
            self.host.silence()

    def at_rest(self) -> None:
        """Control has ended: nothing can move, and the STOP key is a key again."""
        self._connect(None)

    def close(self) -> None:
        """Bring the legs to rest and end the processes: nothing is left for STOP to do once this has begun."""
        if not self.closed:
            self._end()
            self.host.close()
            restore_gc()

    def leave(self) -> None:
        """Leave the session, held, to the console that takes it over."""
        if not self.closed:
            self._end()
            self.host.silence()
            self.host.leave()

    def _keep_consent(self) -> None:
        report = self.state.report
        if report is None:
            return
        if self._consent is None and report.pictures_recorded:  # given before this console took over
            self._consent, self._consented_incarnation = True, report.incarnation
        if self._consent and report.incarnation != self._consented_incarnation:
            self.record_pictures(self._consent)

    def _end(self) -> None:
        """For this console: neither key nor voice stops any more."""
        self.closed = True
        self._connect(None)
        if self._voice is not None:
            self._voice.close()

    def _connect(self, send: Callable[[], object] | None) -> None:
        if self._switch is not None:
            self._switch.connect(send)


def recorded_consent(setup: SessionSetup) -> bool | None:
    """To pictures, by the session's trail, as the recording decides; None: nobody has said, or it can't be read."""
    from logs.read import read  # not before the first paint

    consent = None
    with suppress(AuditError):
        for record in read(Home(setup.home).logs / f"{setup.session}.jsonl"):
            if isinstance(record, Record) and isinstance(record.body, Recording):
                consent = record.body.on and record.body.consent
    return consent


def both(before: HandCommand, command: HandCommand) -> HandCommand:
    """One command that leads where the two lead: a hand that is opened later is where this one is."""
    shaped = command if command.gesture or command.pose else before
    withdrawn = command.click_s is not None or command.move_z_m != 0.0
    return HandCommand(
        gesture=shaped.gesture,
        pose=shaped.pose,
        press=False if withdrawn else before.press if command.press is None else command.press,
        move_x_m=before.move_x_m + command.move_x_m,
        move_y_m=before.move_y_m + command.move_y_m,
        move_z_m=before.move_z_m + command.move_z_m,
    )


class GuidedTests:
    """At most one runs, and each result goes into the trail once. Observes control; nothing here reaches it."""

    def __init__(self, emit: Callable[[GuidedTestResult], object]) -> None:
        self.run: GuidedRun | None = None  # the one that runs
        self.results: list[GuidedTestResult] = []  # of this session, oldest first
        self._emit = emit

    def begin(self, test: GuidedTest, state: SessionState) -> GuidedRefusal | None:
        """Begin a test, if none runs; or why it can't begin."""
        refused = refusal_of(test, state.snapshot, fresh=state.snapshot_fresh)
        if refused is None and self.run is None and state.snapshot is not None:
            self.run = begin(test, state.snapshot, state.now_ns)
        return refused

    def update(self, state: SessionState) -> GuidedTestResult | None:
        """Take the session's newest state; the result, if the test has just ended."""
        if self.run is None:
            return None
        return self._settle(advance(self.run, state.snapshot, fresh=state.snapshot_fresh))

    def stop(self, why: GuidedStop) -> GuidedTestResult | None:
        """End the one that runs, not completed; None: none runs."""
        return None if self.run is None else self._settle(stopped(self.run, reason(why)))

    def clear(self) -> None:
        """Another session begins."""
        self.run, self.results = None, []

    def _settle(self, run: GuidedRun) -> GuidedTestResult | None:
        if not run.ended:
            self.run = run
            return None
        self.run, result = None, result_of(run)
        self.results.append(result)
        self._emit(result)
        return result


class Host(Protocol):
    """Processes and links of one session. `send` may be called from any thread."""

    setup: SessionSetup

    @property
    def commands(self) -> bool:
        """Whether the session is this console's to end."""

    def start(self) -> None:
        """Start the processes, or take running ones over; may take a second."""

    def close(self) -> None:
        """Bring the legs to rest and the processes to their end; harmless when done twice."""

    def leave(self) -> None:
        """Leave the session to itself."""

    def send(self, kind: OperatorKind, action: Action | None = None, *, input_ns: int | None = None) -> int:
        """The operator's word to control, given then; its sequence comes back in the snapshot."""

    def heartbeat(self) -> None:
        """STOP can be given."""

    def silence(self) -> None:
        """STOP can't be given any more."""

    def send_to_perception(self, command: HandCommand | PerceptionCommand) -> None:
        """Move the digital hand, or change what the picture looks like."""

    def poll(self) -> Latest:
        """The newest of each stream, without waiting."""


HostFactory = Callable[[SessionSetup], Host]


# numpy with the drawing of pictures; the messages of the palette.
_LATER = ("app.console.widgets.halfblock", "textual.fuzzy")
# Young, middle, old: a full collection stops all threads, so it comes fourteen times more rarely than by default; at
# seventy times, the cycles of drawn lines pile up (`tools/bench_control.py --console` prints the memory's growth).
_RARELY = (5_000, 20, 10)
_AS_USUAL = gc.get_threshold()


def reduce_gc() -> None:
    """Look for garbage fourteen times more rarely. Undone by `restore_gc`."""
    gc.set_threshold(*_RARELY)


def gc_freeze() -> None:
    """Leave all that exists by now out of every later collection of garbage.

    A full one would otherwise stop all threads for 0.1 to 0.2 s every few seconds, the heartbeat and STOP among
    them; so would one made here, beside a running control. Undone by `restore_gc`.
    """
    gc.freeze()


def restore_gc() -> None:
    """The session has ended: all may be collected again, as often as before."""
    gc.unfreeze()
    gc.set_threshold(*_AS_USUAL)


def preload_modules() -> None:
    """Load all that a key may need; takes up to a second."""
    for name in _LATER:
        import_module(name)
