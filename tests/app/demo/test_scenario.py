"""The scenario asks for every action once, each where the gait machine grants it."""

from __future__ import annotations

from app.control.gait.machine import Change, Gait, Latched, Started, ask, changed
from app.demo.scenario import ALL_TWELVE
from app.ipc.states import ACTION_OF, Action, GaitState


def test_course_asks_for_every_action_once() -> None:
    assert sorted(ACTION_OF[step.gesture].name for step in ALL_TWELVE) == sorted(action.name for action in Action)


def test_the_gait_machine_grants_the_whole_course() -> None:
    gait = Gait()
    for step in ALL_TWELVE:
        assert step.start in (gait.state, GaitState.LEFT_FORWARD)
        answer = ask(gait, ACTION_OF[step.gesture])
        assert isinstance(answer, Started | Latched), step
        gait = changed(answer.gait, Change.COMPLETED)
        while gait.running is not None and not step.steps:
            gait = changed(gait, Change.COMPLETED)
        assert gait.state is step.end, step
