"""The scenario, every transition of Table 1 once; what each of its steps gave, and the figures of many."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, Protocol

import msgspec
import numpy as np

from app.ipc.snapshot import ActionReport
from app.ipc.states import Action, GaitState
from kgdfa.gesture import Gesture
from logs.reason import Reason


class AttemptFault(Enum):
    """Why an attempt failed."""

    NOT_ALLOWED = "not allowed"
    NO_REPORT = "no report"
    NO_HAND = "no hand"
    NOT_RECOGNISED = "not recognised"
    NO_ACTION = "no action"
    NOT_PRESSED = "not pressed"
    NOT_NEAR_ENOUGH = "not near enough"
    ENDED_EARLY = "ended early"


@dataclass(frozen=True, slots=True, kw_only=True)
class Attempt:
    """One gesture signed, pressed, and what the legs did. `report` is control's own account, None: no action."""

    gesture: Gesture
    recognised: bool
    pressed: bool
    presses: int = 1  # made until the action began; a wearer whose press did nothing makes another
    start: GaitState
    end: GaitState
    ok: bool
    reason: Reason | None
    report: ActionReport | None
    by_key: bool = False  # the therapist's: the patient's vocabulary lacks the gesture
    interrupted: bool = False  # an interlock held or ended it; the sign and the press were understood

    @property
    def response_from_recognition_ms(self) -> float | None:
        """Capture of the frame that made the gesture known, to the first changed joint command."""
        return self._since("recognised_ns", "first_command_ns")

    @property
    def response_from_release_ms(self) -> float | None:
        """Capture of the frame that released, to the first changed joint command."""
        return self._since("released_ns", "first_command_ns")

    @property
    def visible_motion_ms(self) -> float | None:
        """Capture of the frame that released, to the first joint moved by 0.5°."""
        return self._since("released_ns", "first_motion_ns")

    @property
    def visible_from_recognition_ms(self) -> float | None:
        """Capture of the frame that made the gesture known, to the first joint moved by 0.5°."""
        return self._since("recognised_ns", "first_motion_ns")

    @property
    def tracking_rms_deg(self) -> float | None:
        """How far the joints were from their targets, RMS over the action."""
        return None if self.report is None else math.degrees(self.report.tracking_rms_rad)

    def row(self) -> dict[str, Any]:
        """As the demo's JSON has it."""
        return {
            "gesture": self.gesture.value,
            "from": self.start.value,
            "to": self.end.value,
            "ok": self.ok,
            "recognised": self.recognised,
            "pressed": self.pressed,
            "presses": self.presses,
            "by_key": self.by_key,
            "response_from_recognition_ms": _rounded(self.response_from_recognition_ms),
            "response_from_release_ms": _rounded(self.response_from_release_ms),
            "visible_motion_ms": _rounded(self.visible_motion_ms),
            "tracking_rms_deg": _rounded(self.tracking_rms_deg, 3),
            "interrupted": self.interrupted,
            "reason": msgspec.to_builtins(self.reason),
        }

    def _since(self, first: str, last: str) -> float | None:
        if self.report is None:
            return None
        start = getattr(self.report, first)
        end = moment_of_command(self.report) if last == "first_command_ns" else getattr(self.report, last)
        return (end - start) / 1e6 if start and end else None


def moment_of_command(report: ActionReport) -> int:
    """When control acted. The end of a walk is latched at once and carried out with the next step: its latching."""
    return report.first_command_ns or (report.accepted_ns if report.action is Action.WALK_END else 0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Spread:
    """Mean, median and 99th percentile of a figure, and of how many values."""

    mean: float
    p50: float
    p99: float
    n: int


def spread(values: Iterable[float | None]) -> Spread | None:
    """The spread of those values that exist; None when none does."""
    known = [value for value in values if value is not None]
    if not known:
        return None
    p50, p99 = np.percentile(known, (50, 99))
    return Spread(mean=float(np.mean(known)), p50=float(p50), p99=float(p99), n=len(known))


def success(attempts: Sequence[Attempt]) -> float:
    """The share of attempts in which exactly what was signed happened."""
    return sum(attempt.ok for attempt in attempts) / len(attempts) if attempts else 0.0


def _rounded(value: float | None, digits: int = 1) -> float | None:
    return None if value is None else round(value, digits)


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
        if not attempts[-1].ok and not attempts[-1].interrupted:
            return False
    return False
