"""When the terminal's bell rings: for a press, a release, a refusal, a stop, as far as each is switched on. Pure."""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum

from app.console.state import SessionState
from app.ipc.states import Effect
from app.system.config import SoundsConfig


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
    return frozenset() if before is None else frozenset((*_hand(before, now), *_control(before, now)))


def _hand(before: SessionState, state: SessionState) -> Iterator[Sound]:
    was, now = before.report, state.report
    if was is not None and now is not None and was.incarnation == now.incarnation:
        if now.pressed and not was.pressed:
            yield Sound.PRESS
        if now.release_count > was.release_count:
            yield Sound.RELEASE
        if now.cancel_count > was.cancel_count:
            yield Sound.REFUSAL


def _control(before: SessionState, state: SessionState) -> Iterator[Sound]:
    was, now = before.snapshot, state.snapshot
    if was is not None and now is not None:
        if now.refusal_count > was.refusal_count:
            yield Sound.REFUSAL
        if now.effect >= Effect.HOLD and now.effect > was.effect:
            yield Sound.STOP
    if before.snapshot_fresh and not state.snapshot_fresh:
        yield Sound.STOP
