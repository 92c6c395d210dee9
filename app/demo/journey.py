"""A course from its first leg to its last, and the way back into it where an interlock interrupted."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from app.demo.course import Leg
from app.demo.trial import Trial
from app.ipc.states import GaitState
from kgdfa.gesture import Gesture

INTERRUPTIONS = 3  # of one course; more than that is no mishap any more
BACK_TO_STANDING = Leg(gesture=Gesture.ZERO, start=GaitState.BETWEEN, end=GaitState.STANDING)


class Runner(Protocol):
    """What signs and presses, and can bring held legs back: `app.demo.runner.CourseRunner`."""

    @property
    def standing(self) -> bool:
        """Whether the legs stand, ready for the next action."""
        ...

    def run(self, leg: Leg) -> Trial:
        """One trial."""
        ...

    def relax(self) -> None:
        """The hand rests."""
        ...

    def recover(self) -> bool:
        """Look and acknowledge; whether the legs may be brought back."""
        ...


def run_course(runner: Runner, course: Sequence[Leg]) -> list[Trial]:
    """Every leg in order, the hand at rest in between.

    Where an interlock interrupted, the legs are brought back and the course goes on from where the wearer last stood;
    it ends early at a gesture that was not understood, and after `INTERRUPTIONS`.
    """
    trials: list[Trial] = []
    number = 0
    while number < len(course):
        trials.append(runner.run(course[number]))
        runner.relax()
        if trials[-1].ok:
            number += 1
        elif trials[-1].interrupted and _back(runner, trials):
            number = resume_at(course, number)
        else:
            break
    return trials


def resume_at(course: Sequence[Leg], interrupted: int) -> int:
    """The leg from which to go on once the wearer stands again: the last that begins standing, up to this one.

    Before there is one, gesture 0 has just done what was interrupted: the first that begins standing.
    """
    standing = [number for number, leg in enumerate(course) if leg.start is GaitState.STANDING]
    return max((number for number in standing if number <= interrupted), default=standing[0])


def _back(runner: Runner, trials: list[Trial]) -> bool:
    """Bring interrupted legs back to standing, as a trial of its own; whether they stand."""
    while sum(trial.interrupted for trial in trials) <= INTERRUPTIONS and runner.recover():
        if runner.standing:
            return True
        trials.append(runner.run(BACK_TO_STANDING))
        runner.relax()
    return False
