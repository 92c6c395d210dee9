"""STOP and holds again: the event that a STOP raises, what its effect ends, and that it stays until acknowledged."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from msgspec.structs import replace

from app.control.events.row import Latch
from app.control.events.table import ORDER, ROW
from app.control.gait.machine import Change, Gait
from app.control.operator_commands import presses_after
from app.ipc.states import Effect, Event, Outcome, StopSource
from app.replay.difference import Difference, difference, differences
from logs import records as r
from logs.records import Record

KEY_STOPS = (Event.STOP.value, Event.STOP_AGAIN.value)
STOPS = (*KEY_STOPS, Event.VOICE_STOP.value)
ENDS = {Change.INTERRUPTED.value, Change.ABANDONED.value, Change.POWER_LOST.value}
Raised = Mapping[str, r.EventRaised]


class StopReplay:
    """Takes control's records in their order, beside the gait and the events raised before each."""

    def __init__(self) -> None:
        self._presses = 0  # of the key, since the last acknowledgement
        self._press_ns = 0  # when the one heard last was sent
        self._voice_stopped = False  # by voice, since then
        self._states: dict[int, tuple[str, str]] = {}  # moment of a STOP → its event, the gait state then
        self._acknowledged: set[str] = set()  # events that are still raised
        self._holds: Record | None = None  # an effect that must end what runs, in the next records
        self._ended = False  # its gait is, its action not yet

    def take(self, record: Record, gait: Gait, raised: Raised) -> Iterator[Difference]:
        """What differs in one more record."""
        body = record.body
        yield from self._follows(record)
        if isinstance(body, r.Command | r.Refusal | r.EffectChanged):
            yield from self._in_force(record, body, raised)
        if isinstance(body, r.EventRaised):
            self._acknowledged.discard(body.event)
            if body.event in STOPS:
                self._states[body.raised_ns] = body.event, gait.state.value
        elif isinstance(body, r.Acknowledgement):
            self._acknowledged.update(body.events)
            left = raised.keys() - set(body.events)  # by an acknowledgement that does not cover them
            self._presses = self._presses if left & set(KEY_STOPS) else 0
            self._voice_stopped = self._voice_stopped and Event.VOICE_STOP.value in left
        elif isinstance(body, r.EffectChanged):
            stronger = Effect[body.to_effect.upper()] >= Effect.HOLD
            self._holds, self._ended = (record if stronger and gait.running else None), False
        elif isinstance(body, r.Stop):
            yield from self._stop(record, body, gait)
        elif isinstance(body, r.ActionEnd):
            yield from self._action_end(record, body, raised)

    def end(self) -> Iterator[Difference]:
        """What an effect should have ended."""
        if self._holds is not None:
            yield difference(self._holds, "decision", None, "action-end" if self._ended else "gait")
            self._holds = None

    def _follows(self, record: Record) -> Iterator[Difference]:
        """An effect ends what runs at once: its gait, the state's transition, its action."""
        body = record.body
        if self._holds is None or isinstance(body, r.ClockStep | r.Transition):
            return
        if isinstance(body, r.GaitChanged) and body.change in ENDS:
            self._ended = True
        elif not (isinstance(body, r.ActionEnd) and self._ended):
            yield from self.end()

    def _action_end(self, record: Record, body: r.ActionEnd, raised: Raised) -> Iterator[Difference]:
        if self._holds is None:
            return
        assert isinstance(self._holds.body, r.EffectChanged)
        strongest = next((raised[name] for name in self._holds.body.in_force if name in raised), None)
        why = body.reason if strongest is None else strongest.text
        yield from differences(record, replace(body, outcome=Outcome.STOPPED.value, reason=why))
        self._holds = None

    def _stop(self, record: Record, body: r.Stop, gait: Gait) -> Iterator[Difference]:
        raises, effect = self._raised_by(body)
        event, state = self._states.get(body.seen_ns, ("", gait.state.value))
        if not event and raises:
            yield difference(record, "event", None, raises)
        yield from differences(record, replace(body, effect=effect.name.lower(), state=state))

    def _raised_by(self, body: r.Stop) -> tuple[str, Effect]:
        """The event that this STOP raises, and its effect; the word said again, a third press or a late one: none."""
        if body.by == StopSource.VOICE.value:
            again, self._voice_stopped = self._voice_stopped, True
            return "" if again else Event.VOICE_STOP.value, Effect.HOLD
        before, self._presses = self._presses, presses_after(self._presses, self._press_ns, body.sent_ns)
        self._press_ns = body.sent_ns
        raises = KEY_STOPS[before] if before < min(self._presses, len(KEY_STOPS)) else ""
        return raises, Effect.HOLD if self._presses == 1 else Effect.DAMP

    def _in_force(
        self, record: Record, body: r.Command | r.Refusal | r.EffectChanged, raised: Raised
    ) -> Iterator[Difference]:
        """Strongest first; what only an acknowledgement ends is among them."""
        stays = {name for name in raised if name not in self._acknowledged and ROW[Event(name)].latch is Latch.ALWAYS}
        again = sorted({*body.in_force, *stays}, key=lambda name: (-ROW[Event(name)].effect, ORDER[Event(name)]))
        if tuple(again) != body.in_force:
            yield difference(record, "in_force", body.in_force, tuple(again))
