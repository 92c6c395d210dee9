"""An interrupted scenario goes on from where the wearer last stood; one that is not understood ends."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from app.control.gait.machine import Change, Gait, Latched, Started, ask, changed
from app.demo.scenario import ALL_TWELVE, INTERRUPTIONS, Attempt, Step, run_scenario
from app.ipc.states import ACTION_OF, GaitState
from logs.reason import reason_of
from tests.app.demo.sessions import session_of

Fate = Callable[[int, Step], str]  # of the attempt with that number: "" done, "held", "misread"


class Walker:
    """Legs that obey the real gait machine, and are held or misread as a test decides."""

    def __init__(self, fate: Fate, *, acknowledges: bool = True) -> None:
        self.gait, self.fate, self.acknowledges, self.made = Gait(), fate, acknowledges, 0

    @property
    def standing(self) -> bool:
        return self.gait.state is GaitState.STANDING

    def run(self, step: Step) -> Attempt:
        start = self.gait.state
        answer = ask(self.gait, ACTION_OF[step.gesture])
        assert isinstance(answer, Started | Latched), f"{step} from {start}"
        what = self.fate(self.made, step)
        self.made += 1
        if what == "held":
            self.gait = changed(answer.gait, Change.INTERRUPTED)
        elif what == "":
            self.gait = changed(answer.gait, Change.COMPLETED)
            while self.gait.running is not None and not step.steps:
                self.gait = changed(self.gait, Change.COMPLETED)
        return Attempt(
            gesture=step.gesture,
            recognised=what != "misread",
            pressed=what != "misread",
            start=start,
            end=self.gait.state,
            ok=what == "",
            reason=reason_of(OSError(what)) if what else None,
            report=None,
            interrupted=what == "held",
        )

    def relax(self) -> None:
        pass

    def recover(self) -> bool:
        return self.acknowledges


@pytest.mark.parametrize("victim", range(len(ALL_TWELVE)))
def test_wherever_the_legs_are_held_once_the_course_is_carried_out(victim: int) -> None:
    result = session_of(run_scenario(Walker(lambda made, _: "held" if made == victim else ""), ALL_TWELVE))
    assert result.passed(ALL_TWELVE)
    (interrupted,) = result.interruptions
    assert interrupted.gesture is ALL_TWELVE[victim].gesture
    assert [row["gesture"] for row in result.as_json(ALL_TWELVE)["actions"]] == [
        step.gesture.value for step in ALL_TWELVE
    ]


def test_legs_that_are_held_again_and_again_end_the_course() -> None:
    result = session_of(run_scenario(Walker(lambda made, _: "held" if made > 2 else ""), ALL_TWELVE))
    assert not result.passed(ALL_TWELVE)
    assert len(result.interruptions) == INTERRUPTIONS + 1


def test_a_gesture_that_is_not_understood_ends_the_course() -> None:
    attempts = run_scenario(Walker(lambda made, _: "misread" if made == 3 else ""), ALL_TWELVE)
    assert len(attempts) == 4
    assert not session_of(attempts).passed(ALL_TWELVE)


def test_legs_that_stay_held_end_the_course() -> None:
    attempts = run_scenario(Walker(lambda made, _: "held" if made == 3 else "", acknowledges=False), ALL_TWELVE)
    assert len(attempts) == 4


def test_legs_that_cannot_be_brought_back_end_the_course() -> None:
    attempts = run_scenario(Walker(lambda made, _: "held" if made == 3 else "misread" if made > 3 else ""), ALL_TWELVE)
    assert len(attempts) == 5
    assert not session_of(attempts).passed(ALL_TWELVE)


def test_what_was_carried_out_unasked_is_no_success() -> None:
    result = session_of(run_scenario(Walker(lambda *_: ""), ALL_TWELVE))
    assert result.passed(ALL_TWELVE)
    assert not replace(result, unintended=1).passed(ALL_TWELVE)
    assert not replace(result, audit_verified=False).passed(ALL_TWELVE)
