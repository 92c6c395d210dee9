"""The hops of a command, a STOP or an event around one record, from its trail alone."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Any, TypeVar

from logs import records as r
from logs.errors import AuditError, AuditFault
from logs.explain.checks import Check, checks_of
from logs.read import records
from logs.records import Record
from logs.show import EVENTS

B = TypeVar("B")


class Hop(Enum):
    """Steps of a command, a STOP or an event, in their order."""

    CAPTURED = "captured"  # the first frame of the vote
    RECOGNISED = "recognised"
    HINTED = "hinted"
    PRESSED = "pressed"
    CANCELLED = "cancelled"
    RELEASED = "released"
    ACCEPTED = "accepted"
    REFUSED = "refused"
    PLANNED = "planned"
    COMMANDED = "commanded"  # the first joint command
    CLOSING = "closing"  # the walk's last step, which gesture 6 asked for
    MOVED = "moved"
    ENDED = "ended"
    SENT = "sent"
    RECEIVED = "received"
    RAISED = "raised"
    CLEARED = "cleared"
    RECORDED = "recorded"  # any other record


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """One hop. at_ns: monotonic, None where the trail does not hold it; record: the one that tells of it."""

    hop: Hop
    at_ns: int | None
    record: Record | None = None
    checks: tuple[Check, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Explanation:
    """The hops around one record, in their order."""

    about: Record
    steps: tuple[Step, ...] = field(default=())


def explain(found: list[Record], sequence: int) -> Explanation:
    """Why record `sequence` came about. Raises AuditError when the trail has no such record."""
    about = next((record for record in found if record.sequence == sequence), None)
    if about is None:
        last = found[-1].sequence if found else 0
        raise AuditError(AuditFault.NO_RECORD, sequence=sequence, last=last)
    steps = list(_Thread(found, about).steps())
    if all(step.record is not about for step in steps):
        steps.append(_step(Hop.RECORDED, about.monotonic_ns, about))
    return Explanation(about=about, steps=tuple(_in_time(steps)))


def _in_time(steps: Iterable[Step]) -> list[Step]:
    """As they happened; a hop without a moment stays behind the one before it."""
    placed: list[tuple[int, Step]] = []
    for step in steps:
        placed.append((step.at_ns or (placed[-1][0] if placed else 0), step))
    return [step for _, step in sorted(placed, key=lambda one: one[0])]


def explain_file(path: Path, sequence: int) -> Explanation:
    """The same from a file."""
    return explain(records(path), sequence)


class _Thread:
    """The records that belong to one."""

    def __init__(self, found: list[Record], about: Record) -> None:
        self._found = found
        self._about = about

    def steps(self) -> Iterator[Step]:
        body = self._about.body
        if isinstance(body, r.Stop):
            yield from self._stop(self._about, body)
        elif isinstance(body, r.EventRaised) and (stop := self._first(r.Stop, lambda one: _raises(one, body))):
            assert isinstance(stop.body, r.Stop)
            yield from self._stop(stop, stop.body)
        elif isinstance(body, r.EventRaised | r.EventCleared):
            yield from self._event(body.event)
        else:
            yield from self._command()

    def _command(self) -> Iterator[Step]:
        answer = self._answer()
        end = self._first(r.ActionEnd, lambda body: body.number == _number(answer), after=answer)
        up = self._button_up(answer)
        press = self._press(up)
        hint = self._about if isinstance(self._about.body, r.Hint) else None
        onset = self._onset(up or press or hint or answer)
        if onset or up or press or hint:
            yield from _recognised(onset)
        for hop, record in ((Hop.HINTED, hint), (Hop.PRESSED, press)):
            if record is not None:
                yield _step(hop, record.body.captured_ns, record)  # type: ignore[union-attr]
        if up is not None:
            hop = Hop.CANCELLED if isinstance(up.body, r.Cancel) else Hop.RELEASED
            yield _step(hop, up.body.captured_ns, up)  # type: ignore[union-attr]
        if answer is not None:
            yield from self._answered(answer, end)

    def _answered(self, answer: Record, end: Record | None) -> Iterator[Step]:
        if requested_ns := getattr(answer.body, "requested_ns", 0):
            yield _step(Hop.SENT, requested_ns, answer)
        if isinstance(answer.body, r.Refusal):
            if answer.body.raised_ns:
                moment, event = answer.body.raised_ns, answer.body.event
                raised = self._first(r.EventRaised, lambda one: (one.raised_ns, one.event) == (moment, event))
                yield _step(Hop.RAISED, moment, raised)
            yield _step(Hop.REFUSED, answer.body.refused_ns, answer)
            return
        assert isinstance(answer.body, r.Command)
        yield _step(Hop.ACCEPTED, answer.body.accepted_ns, answer)
        for plan in self._plans(answer, end):
            yield _step(Hop.PLANNED, plan.monotonic_ns, plan)
        closing = self._closing(answer, end)
        if closing is not None:
            yield _step(Hop.CLOSING, closing.monotonic_ns, closing)
        if end is not None and isinstance(end.body, r.ActionEnd):
            if end.body.first_command_ns:
                yield _step(Hop.COMMANDED, end.body.first_command_ns, end)
            if end.body.first_motion_ns:
                yield _step(Hop.MOVED, end.body.first_motion_ns, end)
            yield _step(Hop.ENDED, end.body.ended_ns, end)

    def _answer(self) -> Record | None:
        """The command or refusal that this record led to, or comes from."""
        about, body = self._about, self._about.body
        if isinstance(body, r.Command | r.Refusal):
            return about
        if isinstance(body, r.Release):
            return self._answer_to(about)
        if isinstance(body, r.Press):
            up = self._button_up(None)
            return self._answer_to(up) if up is not None and isinstance(up.body, r.Release) else None
        number = body.command if isinstance(body, r.PlanChecked) else getattr(body, "number", 0)
        if not isinstance(body, r.PlanChecked | r.ActionEnd | r.Transition):
            return None
        earlier = [one for one in self._of(r.Command) if one.sequence < about.sequence]
        named = [one for one in earlier if isinstance(one.body, r.Command) and one.body.number == number]
        return next(reversed(named or (earlier if isinstance(body, r.PlanChecked) and not number else [])), None)

    def _answer_to(self, release: Record) -> Record | None:
        moment = release.body.captured_ns  # type: ignore[union-attr]
        answered = self._first(r.Command, lambda body: body.released_ns == moment)
        return answered or self._first(r.Refusal, lambda body: body.released_ns == moment)

    def _button_up(self, answer: Record | None) -> Record | None:
        about, body = self._about, self._about.body
        if isinstance(body, r.Release | r.Cancel):
            return about
        if isinstance(body, r.Press):
            later = [one for one in (*self._of(r.Release), *self._of(r.Cancel)) if one.sequence > about.sequence]
            return min(later, key=lambda one: one.sequence, default=None)
        moment = getattr(answer.body, "released_ns", 0) if answer is not None else 0
        return self._first(r.Release, lambda one: one.captured_ns == moment) if moment else None

    def _press(self, up: Record | None) -> Record | None:
        if isinstance(self._about.body, r.Press):
            return self._about
        if up is None:
            return None
        pressed_ns = getattr(up.body, "pressed_ns", 0)
        earlier = [one for one in self._of(r.Press) if one.sequence < up.sequence]
        exact = [one for one in earlier if pressed_ns and one.body.captured_ns == pressed_ns]  # type: ignore[union-attr]
        return next(reversed(exact or ([] if pressed_ns else earlier)), None)

    def _onset(self, of: Record | None) -> Record | None:
        if isinstance(self._about.body, r.GestureOnset):
            return self._about
        moment = getattr(of.body, "recognised_ns", 0) if of is not None else 0
        if not moment:
            return None
        return self._first(r.GestureOnset, lambda body: moment in (body.recognised_ns, body.captured_ns))

    def _closing(self, answer: Record, end: Record | None) -> Record | None:
        """Where a walk took up its end: that command has no joint command of its own."""
        if end is None or not isinstance(end.body, r.ActionEnd) or end.body.first_command_ns:
            return None
        action = answer.body.action  # type: ignore[union-attr]
        taken_up = self._first(r.GaitChanged, lambda one: one.running == action, after=answer)
        return taken_up if taken_up is not None and taken_up.sequence < end.sequence else None

    def _plans(self, answer: Record, end: Record | None) -> list[Record]:
        """Those that name the command; in a trail from before they did, those between it and its end."""
        number = _number(answer)
        until = end.sequence if end is not None else self._found[-1].sequence + 1
        between = [one for one in self._of(r.PlanChecked) if answer.sequence < one.sequence < until]
        return [one for one in between if getattr(one.body, "command", 0) in (0, number)]

    def _stop(self, record: Record, body: r.Stop) -> Iterator[Step]:
        yield _step(Hop.SENT, body.sent_ns, record)
        yield _step(Hop.RECEIVED, body.seen_ns, record)
        raised = self._first(r.EventRaised, lambda one: _raises(body, one))
        if raised is not None:
            yield _step(Hop.RAISED, body.seen_ns, raised)
        # Older trails hold the moment it was seen in both.
        yield _step(Hop.COMMANDED, body.command_ns if body.command_ns != body.seen_ns else 0, record)
        end = self._first(r.ActionEnd, lambda one: one.ended_ns == body.seen_ns)
        if end is not None and body.seen_ns:
            yield _step(Hop.ENDED, body.seen_ns, end)

    def _event(self, event: str) -> Iterator[Step]:
        until = self._about.sequence
        raised = next((one for one in reversed(self._named(r.EventRaised, event)) if one.sequence <= until), None)
        if raised is not None and isinstance(raised.body, r.EventRaised):
            yield _step(Hop.RAISED, raised.body.raised_ns or raised.monotonic_ns, raised)
            for one in self._named(r.Refusal, event):
                since_ns = getattr(one.body, "raised_ns", 0)
                if since_ns and since_ns == raised.body.raised_ns:
                    yield _step(Hop.REFUSED, getattr(one.body, "refused_ns", 0), one)
        since = raised.sequence if raised is not None else until - 1
        cleared = next((one for one in self._named(r.EventCleared, event) if one.sequence > since), None)
        if cleared is not None:
            yield _step(Hop.CLEARED, cleared.monotonic_ns, cleared)

    def _named(self, kind: type, event: str) -> list[Record]:
        return [one for one in self._of(kind) if getattr(one.body, "event", "") == event]

    def _of(self, kind: type) -> list[Record]:
        return [record for record in self._found if isinstance(record.body, kind)]

    def _first(self, kind: type[B], matches: Any, *, after: Record | None = None) -> Record | None:
        since = after.sequence if after is not None else -1
        return next((one for one in self._of(kind) if one.sequence > since and matches(one.body)), None)


def _recognised(onset: Record | None) -> Iterator[Step]:
    body = onset.body if onset is not None else None
    votes_ns = body.vote_ns if isinstance(body, r.GestureOnset) else ()
    yield _step(Hop.CAPTURED, votes_ns[0] if votes_ns else 0, None)
    if isinstance(body, r.GestureOnset):
        yield _step(Hop.RECOGNISED, body.captured_ns, onset)


def _raises(stop: r.Stop, event: r.EventRaised) -> bool:
    names = ("voice-stop",) if stop.by == "voice" else ("stop", "stop-again")
    return EVENTS.get(event.event, event.event) in names and stop.seen_ns == event.raised_ns != 0


def _number(answer: Record | None) -> int:
    return answer.body.number if answer is not None and isinstance(answer.body, r.Command) else -1


def _step(hop: Hop, at_ns: int, record: Record | None) -> Step:
    tells = record is not None and hop not in {Hop.COMMANDED, Hop.MOVED, Hop.SENT}  # told once a record
    return Step(hop=hop, at_ns=at_ns or None, record=record, checks=checks_of(record.body) if record and tells else ())
