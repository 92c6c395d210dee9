"""A gesture outside the patient's vocabulary never commands; keys and STOP do not ask for it."""

from __future__ import annotations

from dataclasses import replace

import pytest

from app.control.inputs import Settings
from app.ipc.states import ACTION_OF, GESTURE_OF, Action, Effect, GaitState, RequestRefusal, Source
from kgdfa.gesture import Gesture
from logs import records
from logs.reason import reason
from tests.app.control.moments import GRANTED, RESTS, A, K, moving, now, records_of, request, resting, standing
from tests.app.control.rig import SETTINGS


def without(*gestures: Gesture) -> Settings:
    return replace(SETTINGS, vocabulary=frozenset(Gesture) - set(gestures))


@pytest.mark.parametrize("gesture", Gesture)
@pytest.mark.parametrize("state", RESTS)
def test_in_no_state_does_it_command_and_it_is_refused_once(state: GaitState, gesture: Gesture) -> None:
    rig = resting(state)
    rig.settings = without(gesture)
    before = now(rig).refusal_count
    rig.release(gesture)
    rig.tick(200)
    assert now(rig).running is None
    assert not records_of(rig, records.Command)
    assert now(rig).refusal == reason(RequestRefusal.NOT_IN_VOCABULARY, gesture=gesture)
    assert now(rig).refusal_count == before + 1
    (refusal,) = records_of(rig, records.Refusal)
    assert (refusal.gesture, refusal.action) == (gesture.value, ACTION_OF[gesture].value)
    assert refusal.reason == now(rig).refusal


@pytest.mark.parametrize("action", [action for action in Action if action in GRANTED[GaitState.STANDING]])
def test_the_key_of_the_same_action_acts(action: Action) -> None:
    rig = standing()
    rig.settings = without(GESTURE_OF[action])
    request(rig, action, Source.THERAPIST)
    rig.tick(20)
    assert now(rig).gait.running is action


@pytest.mark.parametrize("action", [action for action in Action if action in GRANTED[GaitState.STANDING]])
def test_the_others_act_as_ever(action: Action) -> None:
    rig = standing()
    rig.settings = without(*(set(Gesture) - {GESTURE_OF[action]}))
    rig.release(GESTURE_OF[action])
    rig.tick(20)
    assert now(rig).gait.running is action


def test_while_the_legs_move_it_changes_nothing_and_stop_holds() -> None:
    rig = moving(A.WALK)
    rig.settings = without(Gesture.SIX)
    rig.release(Gesture.SIX)
    rig.tick(20)
    assert now(rig).gait.running is A.WALK
    assert not now(rig).gait.closing
    rig.send(K.STOP)
    rig.tick(2)
    assert now(rig).effect is Effect.HOLD
