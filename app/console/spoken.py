"""A session for who does not look at it: a line of text for each change, and when the terminal's bell rings. Pure."""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum

from app.console.guidance import next_step
from app.console.state import SessionState
from app.console.widgets.gait import commanded_by
from app.console.widgets.gesture import why_nothing
from app.ipc.messages import TriggerReport
from app.ipc.snapshot import ActiveEvent, ControlSnapshot
from app.ipc.states import Effect, Outcome
from app.system.config import SoundsConfig
from app.text.catalogue import render, tr

# Said by lines of their own, or by none: they come and go with every push, or with an event.
_NOT_GUIDED = {"arm", "keys_only", "moving", "withdraw", "push", "sign"}


def changes(before: SessionState | None, now: SessionState) -> tuple[str, ...]:
    """What a screen reader says after `before`, a stop first; all that is so, where there was nothing before."""
    was = before.snapshot if before is not None else None
    return (*_guidance(before, now), *_control(was, now), *_hand(before, now))


def _guidance(before: SessionState | None, now: SessionState) -> list[str]:
    name, _ = next_step(now)
    if name in _NOT_GUIDED or (before is not None and next_step(before)[0] == name):
        return []
    return [tr(f"watch.{name}", end="Ctrl-C", checks="s")]


def _control(was: ControlSnapshot | None, state: SessionState) -> list[str]:
    now = state.snapshot
    if now is None:
        return []
    lines = _events(was.events if was else (), now)
    if was is not None and was.effect >= Effect.HOLD > now.effect:
        lines.append(tr("plain.acknowledged"))
    if was is None or was.armed is not now.armed:
        lines.append(tr("plain.armed" if now.armed else "plain.not_armed"))
    lines += _action(was, now)
    if was is None or was.state is not now.state:
        lines.append(tr("plain.state", state=now.state))
    if now.action is None and now.armed and (was is None or (was.allowed, was.armed) != (now.allowed, now.armed)):
        each = tuple(f"{commanded_by(action, now)} {tr(action)}" for action in now.allowed)
        lines.append(tr("plain.allowed", actions=each) if each else tr("plain.nothing_allowed"))
    if now.refusal is not None and was is not None and now.refusal_count > was.refusal_count:
        lines.append(tr("events.refused", reason=render(now.refusal)))
    return lines


def _events(was: tuple[ActiveEvent, ...], now: ControlSnapshot) -> list[str]:
    known = {event.event for event in was}
    active = {event.event for event in now.events}
    begun = sorted((each for each in now.events if each.event not in known), key=lambda each: -each.effect)
    lines = [f"{tr(each.effect)}: {render(each.reason)}" for each in begun]
    over = [each for each in was if each.event not in active and each.effect < Effect.HOLD]  # else it was acknowledged
    return lines + [tr("plain.over", reason=render(each.reason)) for each in over]


def _action(was: ControlSnapshot | None, now: ControlSnapshot) -> list[str]:
    before = was.action if was is not None else None
    if now.action is before:
        return []
    lines = []
    if before is not None:
        outcome = next((one.outcome for one in reversed(now.reports) if one.action is before), Outcome.COMPLETED)
        if outcome is not Outcome.RUNNING:
            lines.append(tr("plain.ended", action=before, outcome=outcome))
    if now.action is not None:
        lines.append(tr("plain.begun", action=now.action))
    return lines


def _hand(before: SessionState | None, state: SessionState) -> list[str]:
    now, was = state.report, before.report if before is not None else None
    if now is None:
        return []
    lines = _button(was, now)
    if now.gesture is not None and (was is None or was.gesture is not now.gesture):
        lines.append(tr("plain.gesture", gesture=now.gesture))
    if now.camera_fault is not None and (was is None or was.camera_fault is None):
        lines.append(render(now.camera_fault))
    if now.hand_refusal is not None and (was is None or was.hand_refusal != now.hand_refusal):
        lines.append(render(now.hand_refusal))
    why = why_nothing(state.press_note)
    if why and (before is None or why != why_nothing(before.press_note)):
        lines.append(why)
    return lines


def _button(was: TriggerReport | None, now: TriggerReport) -> list[str]:
    if was is None or was.incarnation != now.incarnation:
        return []
    if now.release_count > was.release_count and now.released_gesture is not None:
        return [tr("plain.released", gesture=now.released_gesture)]
    return [tr("plain.pressed")] if now.pressed and not was.pressed else []


class Sound(Enum):
    """What may be heard; the value is its switch in the configuration."""

    PRESS = "press"
    RELEASE = "release"
    REFUSAL = "refusal"
    STOP = "stop"


def switched_on(config: SoundsConfig) -> frozenset[Sound]:
    """The sounds that the configuration wants."""
    return frozenset(sound for sound in Sound if getattr(config, sound.value))


def sounds_of(before: SessionState | None, now: SessionState) -> frozenset[Sound]:
    """What happened since `before`."""
    return frozenset() if before is None else frozenset((*_hand_sounds(before, now), *_control_sounds(before, now)))


def _hand_sounds(before: SessionState, state: SessionState) -> Iterator[Sound]:
    was, now = before.report, state.report
    if was is not None and now is not None and was.incarnation == now.incarnation:
        if now.pressed and not was.pressed:
            yield Sound.PRESS
        if now.release_count > was.release_count:
            yield Sound.RELEASE
        if now.cancel_count > was.cancel_count:
            yield Sound.REFUSAL


def _control_sounds(before: SessionState, state: SessionState) -> Iterator[Sound]:
    was, now = before.snapshot, state.snapshot
    if was is not None and now is not None:
        if now.refusal_count > was.refusal_count:
            yield Sound.REFUSAL
        if now.effect >= Effect.HOLD and now.effect > was.effect:
            yield Sound.STOP
    if before.snapshot_fresh and not state.snapshot_fresh:
        yield Sound.STOP
