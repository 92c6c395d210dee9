"""The word stops as the first STOP does, and never more; its source is on record."""

from __future__ import annotations

import pytest

from app.control.running_action import Stage
from app.ipc.messages import OperatorKind
from app.ipc.states import Action, Effect, Event, GaitState
from logs import records
from tests.app.control.moments import HOLD_TICKS, RESTS, K, S, moving, now, records_of, resting
from tests.app.control.rig import Rig
from tests.app.control.test_step_stop import MOVEMENTS


def stops(rig: Rig) -> list[tuple[str, str]]:
    """Source and effect of each STOP on record."""
    return [(one.by, one.effect) for one in records_of(rig, records.Stop)]


@pytest.mark.parametrize(("state", "action"), MOVEMENTS)
def test_the_word_holds_every_movement_however_often_it_is_said(state: GaitState, action: Action) -> None:
    rig = resting(state)
    rig.send(K.ACT, action)
    rig.run_until(lambda m: m.running is not None and m.running.stage is Stage.MOVING)
    rig.tick(30)
    for _ in range(5):
        rig.send(K.VOICE_STOP)
        rig.tick(3)
        assert now(rig).effect is Effect.HOLD
        assert now(rig).gait.running is None
    rig.tick(HOLD_TICKS)
    assert now(rig).motion.settled
    assert stops(rig) == [("voice", "hold")] * 5


@pytest.mark.parametrize("state", RESTS)
def test_at_rest_it_starts_nothing(state: GaitState) -> None:
    rig = resting(state)
    before = rig.command.position_rad.copy()
    for _ in range(3):
        rig.send(K.VOICE_STOP)
        rig.tick(100)
    assert now(rig).gait.state is state
    assert rig.command.position_rad.tolist() == before.tolist()


@pytest.mark.parametrize(
    ("kinds", "effect"),
    [
        ((K.VOICE_STOP, K.STOP), Effect.HOLD),
        ((K.STOP, K.VOICE_STOP), Effect.HOLD),
        ((K.VOICE_STOP, K.STOP, K.STOP), Effect.DAMP),
        ((K.STOP, K.VOICE_STOP, K.STOP), Effect.DAMP),
    ],
)
def test_only_the_keys_are_counted(kinds: tuple[OperatorKind, ...], effect: Effect) -> None:
    rig = moving()
    for kind in kinds:
        rig.send(kind)
        rig.tick(3)
    assert now(rig).effect is effect


def test_the_next_acknowledgement_ends_it_and_a_word_after_that_stops_again() -> None:
    rig = moving()
    rig.send(K.VOICE_STOP)
    rig.tick(HOLD_TICKS)
    rig.send(K.ACKNOWLEDGE)
    rig.tick(2)
    assert now(rig).effect < Effect.HOLD
    rig.send(K.VOICE_STOP)
    rig.tick(2)
    assert now(rig).effect is Effect.HOLD
    assert Event.VOICE_STOP in {one.event for one in now(rig).events}
    assert S.UNPOWERED is not now(rig).gait.state
