"""Table 7: the closed loop, signed and pressed by digital hands of several people, beside the paper's figures.

Each hand has sessions of several rounds. Before a round the therapist takes the power from the standing legs, so that
gesture 0 powers them anew. An attempt that does nothing counts as failed and is made again, until the round can go on.
What 150 attempts a gesture take is hours: each session is kept as it ends, and a run goes on from what is kept.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import msgspec
import numpy as np

from app.demo.scenario import ALL_TWELVE, Attempt, Runner, Step
from app.demo.session import SessionResult, demo_config, demo_patient, run_session
from app.evaluate.harness import EvaluateFault, keep_line, kept_lines
from app.evaluate.loop.table7 import ResponseResult
from app.ipc.states import ACTION_OF, Action
from app.system.config import Config
from app.system.errors import AppError
from app.system.paths import Home
from app.system.program import PROGRAM, program_identity
from logs.reading.errors import CodedError
from logs.reason import Reason, reason, reason_of
from profiles.schema import Profile

# A quick press is a short one: the hand rests at 27 cm, near the 25 cm of the paper's same-side hand.
APPROACH_M = 0.09
# The paper's 20 cm, of the hand itself: the button's distance reads an upright hand an eighth too far, to be safe.
THRESHOLD_M = 0.225
ATTEMPTS = 5  # at one transition, before the session is given up
ROUNDS_A_SESSION = 5  # some seven minutes, which are lost where the power fails
FRUITLESS_SESSIONS = 3  # one after the other without a round: then something is broken

Watch = Callable[[str], None]


class RoundRunner(Runner, Protocol):
    """One that can begin another round. click_s: of the next push, there and back."""

    click_s: float

    @property
    def allowed(self) -> tuple[Action, ...]:
        """What the legs may do now."""
        ...

    def power_off(self) -> bool:
        """Whether the power is off."""
        ...


@dataclass(slots=True)
class Rounds:
    """One hand's rounds that are still to be made; `run_attempts` makes them while the session lasts.

    click_s: the duration of each push is drawn from this range.
    """

    left: int
    click_s: tuple[float, float] = (0.3, 0.3)
    draw: np.random.Generator = field(default_factory=np.random.default_rng)
    interrupted: bool = field(default=False)

    def run_attempts(self, runner: RoundRunner, scenario: Sequence[Step]) -> list[Attempt]:
        """Rounds of the scenario until none is left, one can't go on, or the operator interrupts."""
        attempts: list[Attempt] = []
        try:
            while self.left:
                attempts.extend(self._round(runner, scenario))
                if not (attempts[-1].ok and attempts[-1].gesture is scenario[-1].gesture):
                    break
                self.left -= 1
                if self.left and not runner.power_off():
                    break
        except KeyboardInterrupt:
            self.interrupted = True
        return attempts

    def _round(self, runner: RoundRunner, scenario: Sequence[Step]) -> Iterator[Attempt]:
        """Every attempt of one round; ends early where a transition can't be made."""
        for leg in scenario:
            for _ in range(ATTEMPTS):
                runner.click_s = self.draw.uniform(*self.click_s)
                attempt = runner.run(leg)
                yield attempt
                runner.relax()
                if attempt.ok or ACTION_OF[leg.gesture] not in runner.allowed:
                    break
            if not attempt.ok:
                return


def run_rounds(home: Home, config: Config, rounds: Rounds, watch: Watch) -> SessionResult:
    """A session of real processes that makes those rounds."""
    return run_session(
        home,
        config,
        ALL_TWELVE,
        click_s=rounds.click_s[1],
        presses=1,
        approach_m=APPROACH_M,
        watch=watch,
        patient=wearer(config.camera.seed),
        run_attempts=rounds.run_attempts,
    )


class KeptSession(msgspec.Struct, frozen=True, kw_only=True):
    """A session that ended, a line of the file that keeps them. program: SHA-256 of the program's files."""

    seed: int
    click_s: tuple[float, float]
    rounds: int
    program: str
    result: SessionResult


def evaluate_response(
    home: Home,
    base: Config,
    *,
    attempts: int,
    seeds: Sequence[int],
    click_s: tuple[float, float],
    watch: Watch,
    keep: Path | None = None,
    run: Callable[[Home, Config, Rounds, Watch], SessionResult] = run_rounds,
) -> ResponseResult:
    """At least `attempts` of every gesture, shared among the hands of the seeds; pushes take from click_s[0] to [1].

    It ends with what there is on Ctrl-C, when sessions one after the other can't make a round, and when one after the
    first can't be run or kept. keep: the file with the sessions that were made, to go on from. Raises AppError,
    InputError and OSError for one that can't be used, and what the first session raises.
    """
    sessions = list(_kept(keep, seeds, click_s))
    try:
        for seed, count in shared(attempts, seeds):
            config, fruitless = demo_config(base, seed=seed, joints=base.joints), 0
            while left := max(0, count - sum(one.rounds for one in sessions if one.seed == seed)):
                drawn = sum(one.seed == seed for one in sessions)
                wanted = min(left, ROUNDS_A_SESSION)
                rounds = Rounds(wanted, click_s, np.random.default_rng([seed, drawn, 0x70757368]))
                made = run(home, config, rounds, watch)
                done, program = wanted - rounds.left, program_identity()[PROGRAM]
                sessions.append(KeptSession(seed=seed, click_s=click_s, rounds=done, program=program, result=made))
                keep_line(sessions[-1], keep)
                fruitless = 0 if done else fruitless + 1
                if rounds.interrupted:
                    return _result(sessions, interrupted=True)
                if fruitless == FRUITLESS_SESSIONS:
                    return _result(sessions, gave_up=_no_round(seed, made))
    except KeyboardInterrupt:  # while a session starts or ends
        return _result(sessions, interrupted=True)
    except (CodedError, OSError) as error:
        if not sessions:
            raise
        return _result(sessions, gave_up=reason_of(error))
    return _result(sessions)


def _result(
    sessions: Sequence[KeptSession], *, interrupted: bool = False, gave_up: Reason | None = None
) -> ResponseResult:
    programs = tuple(dict.fromkeys(one.program for one in sessions))
    made = tuple(one.result for one in sessions)
    return ResponseResult(sessions=made, programs=programs, interrupted=interrupted, gave_up=gave_up)


def _kept(keep: Path | None, seeds: Sequence[int], click_s: tuple[float, float]) -> tuple[KeptSession, ...]:
    kept = kept_lines(keep, KeptSession)
    if any(one.seed not in seeds or one.click_s != click_s for one in kept):
        raise AppError(EvaluateFault.PROGRESS_OF_OTHERS, file=keep)
    return kept


def shared(attempts: int, seeds: Sequence[int]) -> Iterator[tuple[int, int]]:
    """Each hand with how many of the attempts it makes, as even as can be."""
    for number, seed in enumerate(seeds):
        yield seed, attempts // len(seeds) + (number < attempts % len(seeds))


def wearer(seed: int) -> Profile:
    """The demo patient with that hand, whose button is where the paper has it."""
    return msgspec.structs.replace(demo_patient(seed), press_threshold_m=THRESHOLD_M)


def _no_round(seed: int, session: SessionResult) -> Reason:
    last = (session.attempts[-1].reason if session.attempts else None) or "–"
    return reason(EvaluateFault.NO_ROUND, seed=seed, sessions=FRUITLESS_SESSIONS, reason=last, session=session.session)
