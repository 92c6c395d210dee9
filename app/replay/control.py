"""Control's decisions again: answers to requests, the gait machine, events and effects, from what the trail holds."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from typing import Any

from msgspec.structs import replace

from app.control.events.table import ROW, blocks, compared_fields
from app.control.gait.machine import Change, Gait, Ignored, Latched, Refused, Started, changed
from app.control.requests import Untimely, answer_to, outside_vocabulary, untimely_key, untimely_release
from app.ipc.states import ACTION_OF, Action, Effect, Event, GaitState, Source
from app.motion.plan import Phase
from app.replay.difference import Difference, difference, differences
from app.replay.events import event_differences, plan_differences
from app.replay.stops import StopReplay
from kgdfa.gesture import Gesture
from logs import records as r
from logs.reason import Reason, reason
from logs.records import Body, Record

REQUESTS = (r.Command, r.Refusal)
DECISIONS = (
    *REQUESTS, r.PlanChecked, r.GaitChanged, r.Transition, r.EventRaised, r.EffectChanged, r.Stop, r.ActionEnd,
)  # fmt: skip
GESTURES = {one.value for one in Gesture}
VOCABULARY = "vocabulary"  # in a profile's parameters
_NO_EVENT = {"event": "", "raised_ns": 0, "quantity": "", "value": None, "limit": None, "joint": ""}


class ControlReplay:
    """Takes a session's records in their order; what control decides is made again from those before."""

    def __init__(self) -> None:
        self.replayed = 0
        self.not_recorded = 0
        self._limits: r.JointLimits | None = None
        self._vocabulary = frozenset(Gesture)
        self._gait = Gait()
        self._effect = Effect.NOTE
        self._armed_ns = 0
        self._raised: dict[str, r.EventRaised] = {}
        self._commands: dict[int, r.Command] = {}
        self._plans: dict[int, Reason | str | None] = {}  # why the newest plan for a command was refused
        self._expected: deque[Body] = deque()  # that must follow at once
        self._newest: Record | None = None
        self._stops = StopReplay()
        self._releases: dict[int, r.Release] | None = None  # None: perception recorded nothing to compare with
        self._gestures: list[Record] = []  # requests by gesture

    def take(self, record: Record) -> Iterator[Difference]:
        """What differs in one more record."""
        body = record.body
        if isinstance(body, r.Button) and self._releases is None:
            self._releases = {}
        if isinstance(body, r.Release) and self._releases is not None:
            self._releases[body.captured_ns] = body
        if isinstance(body, r.PatientChosen) and VOCABULARY in body.parameters:  # older profiles command with all
            self._vocabulary = frozenset(Gesture(one) for one in body.parameters[VOCABULARY])
        if record.process != "control":
            return
        if isinstance(body, r.JointLimits):
            self._limits = body
        if self._limits is None:
            self.not_recorded += isinstance(body, DECISIONS)
            return
        self.replayed += isinstance(body, DECISIONS)
        yield from self._follows(record)
        yield from self._stops.take(record, self._gait, self._raised)
        yield from _HANDLERS.get(type(body), lambda *_: ())(self, record, body)
        self._newest = record

    def end(self) -> Iterator[Difference]:
        """What should have followed, and requests that no release of perception gave."""
        yield from self._missing()
        yield from self._stops.end()
        for record in self._gestures if self._releases is not None else ():
            body = record.body
            assert isinstance(body, REQUESTS)
            release = (self._releases or {}).get(body.released_ns)
            if release is None or release.gesture not in GESTURES:
                yield difference(record, "released_ns", body.released_ns, None)
                continue
            again = replace(
                body, action=ACTION_OF[Gesture(release.gesture)].value, gesture=release.gesture,
                recognised_ns=release.recognised_ns, pressed_ns=release.pressed_ns if body.pressed_ns else 0,
            )  # fmt: skip
            yield from differences(record, again)

    def _follows(self, record: Record) -> Iterator[Difference]:
        """A granted request changes the gait, and a changed state is a transition, in the next records of control."""
        if not self._expected:
            return
        if type(self._expected[0]) is type(record.body):
            yield from differences(record, self._expected.popleft())
        else:
            yield from self._missing()

    def _missing(self) -> Iterator[Difference]:
        while self._expected and self._newest is not None:
            yield difference(self._newest, "decision", None, type(self._expected.popleft()).__struct_config__.tag)

    # --- requests -------------------------------------------------------------------------------------------------

    def _command(self, record: Record, body: r.Command) -> Iterator[Difference]:
        again = replace(body, number=max(self._commands, default=0) + 1, state=self._gait.state.value)
        yield from differences(record, again)
        untimely, answer = self._untimely(body, body.accepted_ns), self._answer(body)
        if untimely is not None or self._foreign(body) or isinstance(answer, Ignored | Refused):
            yield difference(record, "decision", "command", "refusal")
        else:
            self._expected.append(_gait_record(Change.REQUESTED, body.action, answer.gait))
        self._commands[body.number] = body
        if body.source == Source.GESTURE.value:
            self._gestures.append(record)

    def _refusal(self, record: Record, body: r.Refusal) -> Iterator[Difference]:
        if body.action is None:
            return
        if body.number:  # it had been granted
            event = self._blocker(body)
            if event is None or body.reason != event.text:
                yield from differences(record, replace(body, reason=self._plans.get(body.number), **_NO_EVENT))
            else:
                yield from differences(record, _by_event(body, event))
            return
        again = replace(body, state=self._gait.state.value)
        untimely, answer, event = self._untimely(body, body.refused_ns), self._answer(body), self._blocker(body)
        if body.source == Source.GESTURE.value:
            self._gestures.append(record)
        if untimely is not None:
            code, compared = untimely
            again = replace(again, reason=reason(code), **(_NO_EVENT | compared_fields(compared)))
        elif foreign := self._foreign(body):
            again = replace(again, reason=foreign, **_NO_EVENT)
        elif isinstance(answer, Ignored):
            again = replace(again, reason=answer.reason, **_NO_EVENT)
        elif isinstance(answer, Refused):
            again = _by_event(again, event) if event else replace(again, reason=answer.reason, **_NO_EVENT)
        else:
            yield difference(record, "decision", "refusal", "command")
            return
        yield from differences(record, again)

    def _untimely(self, body: r.Command | r.Refusal, now_ns: int) -> Untimely | None:
        if body.source == Source.THERAPIST.value:
            return untimely_key(body.requested_ns, now_ns)
        # Older trails don't name the press: there the release was compared.
        return untimely_release(body.released_ns, body.pressed_ns or body.released_ns, self._armed_ns, now_ns)

    def _foreign(self, body: r.Command | r.Refusal) -> Reason | None:
        """Why its gesture does not command."""
        by_gesture = body.source == Source.GESTURE.value
        return outside_vocabulary(Action(body.action), self._vocabulary) if by_gesture else None

    def _answer(self, body: r.Command | r.Refusal) -> Started | Latched | Ignored | Refused:
        event = self._blocker(body)
        forbidden = None if event is None else event.text if isinstance(event.text, Reason) else Reason(event.event)
        return answer_to(self._gait, Action(body.action), forbidden, settled=body.settled)

    def _blocker(self, body: r.Command | r.Refusal) -> r.EventRaised | None:
        source = Source(body.source)
        names = (name for name in body.in_force if blocks(ROW[Event(name)], source))
        name = next(names, None)
        return None if name is None else self._raised.get(name)

    # --- gait -----------------------------------------------------------------------------------------------------

    def _gait_changed(self, record: Record, body: r.GaitChanged) -> Iterator[Difference]:
        before = self._gait
        try:
            after = changed(self._gait, Change(body.change), None if body.action is None else Action(body.action))
        except ValueError:
            yield difference(record, "change", body.change, None)
            after = before
        yield from differences(record, _gait_record(Change(body.change), body.action, after))
        self._gait = Gait(
            state=GaitState(body.state),
            running=Action(body.running) if body.running else None,
            phase=Phase(body.phase),
            closing=body.closing,
        )
        if after.state is not before.state:
            action = after.running or before.running
            transition = r.Transition(
                from_state=before.state.value,
                to_state=after.state.value,
                action=action.value if action else None,
                number=max(self._commands, default=0),
            )
            self._expected.append(transition)

    def _plan(self, record: Record, body: r.PlanChecked) -> Iterator[Difference]:
        if not body.ok:
            self._plans[body.command] = body.reason
        assert self._limits is not None
        yield from plan_differences(record, body, self._limits)

    def _action_end(self, record: Record, body: r.ActionEnd) -> Iterator[Difference]:
        command = self._commands.get(body.number)
        if command is None:
            yield difference(record, "number", body.number, None)
            return
        names = ("action", "source", "recognised_ns", "released_ns", "accepted_ns")
        granted = {name: getattr(command, name) for name in names}
        yield from differences(
            record, replace(body, from_state=command.state, to_state=self._gait.state.value, **granted)
        )

    # --- events ---------------------------------------------------------------------------------------------------

    def _event_raised(self, record: Record, body: r.EventRaised) -> Iterator[Difference]:
        assert self._limits is not None
        self._raised[body.event] = body
        yield from event_differences(record, body, self._limits)

    def _event_cleared(self, record: Record, body: r.EventCleared) -> Iterator[Difference]:
        raised = self._raised.pop(body.event, None)
        yield from differences(record, replace(body, effect=raised.effect if raised else ""))

    def _effect_changed(self, record: Record, body: r.EffectChanged) -> Iterator[Difference]:
        unknown = [name for name in body.in_force if name not in self._raised]
        if unknown:
            yield difference(record, "in_force", unknown, None)
        effect = max((ROW[Event(name)].effect for name in body.in_force), default=Effect.NOTE)
        again = replace(body, from_effect=self._effect.name.lower(), to_effect=effect.name.lower())
        yield from differences(record, again)
        self._effect = effect

    def _arming(self, _: Record, body: r.Arming) -> Iterator[Difference]:
        self._armed_ns = body.at_ns if body.armed else 0
        return iter(())

    def _acknowledgement(self, record: Record, body: r.Acknowledgement) -> Iterator[Difference]:
        known = tuple(name for name in body.events if name in self._raised)
        if known and self._armed_ns:
            self._armed_ns = max(self._armed_ns, body.at_ns)  # 0 in older trails: it moved nothing there
        yield from differences(record, replace(body, events=known, accepted=bool(known)))


def _gait_record(change: Change, action: str | None, gait: Gait) -> r.GaitChanged:
    return r.GaitChanged(
        change=change.value,
        action=action if change is Change.REQUESTED else None,
        state=gait.state.value,
        running=gait.running.value if gait.running else None,
        phase=gait.phase.value,
        closing=gait.closing,
    )


def _by_event(body: r.Refusal, event: r.EventRaised) -> r.Refusal:
    return replace(body, reason=event.text, **{name: getattr(event, name) for name in _NO_EVENT})


_HANDLERS: dict[type, Callable[[ControlReplay, Record, Any], Iterator[Difference]]] = {
    r.Command: ControlReplay._command,
    r.Refusal: ControlReplay._refusal,
    r.GaitChanged: ControlReplay._gait_changed,
    r.PlanChecked: ControlReplay._plan,
    r.ActionEnd: ControlReplay._action_end,
    r.EventRaised: ControlReplay._event_raised,
    r.EventCleared: ControlReplay._event_cleared,
    r.EffectChanged: ControlReplay._effect_changed,
    r.Acknowledgement: ControlReplay._acknowledgement,
    r.Arming: ControlReplay._arming,
}
