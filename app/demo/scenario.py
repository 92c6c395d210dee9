"""The scenario: which gesture is signed in which state, and where it must lead. Every transition of Table 1, once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from app.demo.attempt import Attempt
from app.ipc.states import GaitState
from kgdfa.gesture import Gesture


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """One step of the scenario. `steps` is how many steps a walk takes before the next gesture is signed."""

    gesture: Gesture
    start: GaitState
    end: GaitState
    steps: int = 0


STANDING = GaitState.STANDING
ALL_TWELVE: tuple[Step, ...] = (
    Step(gesture=Gesture.ZERO, start=GaitState.UNPOWERED, end=STANDING),
    Step(gesture=Gesture.LOVE, start=STANDING, end=GaitState.SITTING),
    Step(gesture=Gesture.ROCK, start=GaitState.SITTING, end=STANDING),
    Step(gesture=Gesture.ONE, start=STANDING, end=GaitState.RIGHT_FORWARD),
    Step(gesture=Gesture.TWO, start=GaitState.RIGHT_FORWARD, end=GaitState.LEFT_FORWARD),
    Step(gesture=Gesture.THREE, start=GaitState.LEFT_FORWARD, end=GaitState.RIGHT_FORWARD),
    Step(gesture=Gesture.FOUR, start=GaitState.RIGHT_FORWARD, end=STANDING),
    Step(gesture=Gesture.FIVE, start=STANDING, end=GaitState.LEFT_FORWARD, steps=3),
    Step(gesture=Gesture.SIX, start=GaitState.LEFT_FORWARD, end=STANDING),
    Step(gesture=Gesture.SEVEN, start=STANDING, end=STANDING),
    Step(gesture=Gesture.EIGHT, start=STANDING, end=STANDING),
    Step(gesture=Gesture.NINE, start=STANDING, end=STANDING),
)


INTERRUPTIONS = 3  # of one scenario; more than that is no mishap any more
BACK_TO_STANDING = Step(gesture=Gesture.ZERO, start=GaitState.BETWEEN, end=GaitState.STANDING)


class Runner(Protocol):
    """What signs and presses: `app.demo.runner.ScenarioRunner`."""

    def run(self, step: Step) -> Attempt:
        """One attempt."""
        ...

    def relax(self) -> None:
        """The hand rests."""
        ...


class RecoveringRunner(Runner, Protocol):
    """One that can bring held legs back."""

    @property
    def standing(self) -> bool:
        """Whether the legs stand, ready for the next action."""
        ...

    def recover(self) -> bool:
        """Check and acknowledge; whether the legs may be brought back."""
        ...


def run_scenario(runner: RecoveringRunner, scenario: Sequence[Step]) -> list[Attempt]:
    """Every step in order, the hand at rest in between.

    Where an interlock interrupted, the legs are brought back and the scenario goes on from where the wearer last stood;
    it ends early at a gesture that was not understood, and after `INTERRUPTIONS`.
    """
    attempts: list[Attempt] = []
    number = 0
    while number < len(scenario):
        attempts.append(runner.run(scenario[number]))
        runner.relax()
        if attempts[-1].ok:
            number += 1
        elif attempts[-1].interrupted and _back(runner, attempts):
            number = resume_at(scenario, number)
        else:
            break
    return attempts


def resume_at(scenario: Sequence[Step], interrupted: int) -> int:
    """The step from which to go on once the wearer stands again: the last that begins standing, up to this one.

    Before there is one, gesture 0 has just done what was interrupted: the first that begins standing.
    """
    standing = [number for number, step in enumerate(scenario) if step.start is GaitState.STANDING]
    return max((number for number in standing if number <= interrupted), default=standing[0])


def _back(runner: RecoveringRunner, attempts: list[Attempt]) -> bool:
    """Bring interrupted legs back to standing, as an attempt of its own; whether they stand."""
    while sum(attempt.interrupted for attempt in attempts) <= INTERRUPTIONS and runner.recover():
        if runner.standing:
            return True
        attempts.append(runner.run(BACK_TO_STANDING))
        runner.relax()
    return False
