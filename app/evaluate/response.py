"""Table 7: the closed loop, signed and pressed by digital hands of several people, beside the paper's figures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from rich.table import Table

from app.config import Config
from app.demo.course import ALL_TWELVE, ANOTHER_ROUND, Leg
from app.demo.session import SessionResult, demo_config, run_session
from app.demo.trial import Spread, Trial, spread, success
from app.paths import Home
from kgdfa.hand import Gesture

# Table 7: success %, mean response s, of 3 people × 50 trials a gesture
PAPER: dict[Gesture, tuple[float, float]] = {
    Gesture.ZERO: (89.33, 0.49),
    Gesture.ONE: (92.67, 0.50),
    Gesture.TWO: (93.33, 0.53),
    Gesture.THREE: (93.33, 0.68),
    Gesture.FOUR: (94.00, 0.51),
    Gesture.FIVE: (97.33, 0.44),
    Gesture.SIX: (95.33, 0.46),
    Gesture.SEVEN: (82.67, 0.89),
    Gesture.EIGHT: (87.33, 0.78),
    Gesture.NINE: (80.67, 0.99),
    Gesture.LOVE: (94.00, 0.66),
    Gesture.ROCK: (96.67, 0.45),
}
# A quick press is a short one: the hand rests at 27 cm, near the 25 cm of the paper's same-side hand.
APPROACH_M = 0.09
PAPER_OVERALL = "94.11 % / 0.615 s reported; its rows average 91.39 % / 0.615 s"


@dataclass(frozen=True, slots=True, kw_only=True)
class ResponseResult:
    """All sessions together."""

    sessions: tuple[SessionResult, ...]
    asked: dict[Gesture, int]

    @property
    def trials(self) -> tuple[Trial, ...]:
        """Every trial of every session."""
        return tuple(trial for session in self.sessions for trial in session.trials)

    @property
    def unintended(self) -> int:
        """Actions nobody asked for, in all sessions."""
        return sum(session.unintended for session in self.sessions)

    def of(self, gesture: Gesture) -> tuple[Trial, ...]:
        """The trials of one gesture."""
        return tuple(trial for trial in self.trials if trial.gesture is gesture)

    def as_json(self) -> dict[str, Any]:
        """As `--json` writes it; times in seconds, from recognition and from release."""
        return {
            **_figures(self.trials, sum(self.asked.values())),
            "unintended": self.unintended,
            "audit_verified": all(session.audit_verified for session in self.sessions),
            "sessions": len(self.sessions),
            "per_gesture": {g.value: _figures(self.of(g), n) for g, n in self.asked.items()},
        }


def evaluate_response(
    home: Home, base: Config, *, trials: int, seeds: Sequence[int], click_s: float, watch: Callable[[str], None]
) -> ResponseResult:
    """Run `trials` of every gesture over as many hands as there are seeds.

    A session powers up once; gesture 0 gets its trials by one session each, the other eleven by rounds within.
    """
    sessions, asked = [], dict.fromkeys(Gesture, 0)
    for number, course in enumerate(plan_sessions(trials)):
        for leg in course:
            asked[leg.gesture] += 1
        config = demo_config(base, seed=seeds[number % len(seeds)], joints=base.joints)
        sessions.append(
            run_session(home, config, course, click_s=click_s, presses=1, approach_m=APPROACH_M, watch=watch)
        )
    return ResponseResult(sessions=tuple(sessions), asked=asked)


def plan_sessions(trials: int) -> list[tuple[Leg, ...]]:
    """One power-up and one round of all twelve a session."""
    return [(ALL_TWELVE[0], *ANOTHER_ROUND) for _ in range(trials)]


def response_table(result: ResponseResult) -> Table:
    """Ours beside the paper's, a row a gesture."""
    table = Table("gesture", "trials", title="Table 7: the whole system")
    for heading in ("success %", "paper", "recognition → command s", "→ visible s", "paper", "release → command ms"):
        table.add_column(heading, justify="right")
    for gesture, (paper_success, paper_response) in PAPER.items():
        trials, asked = result.of(gesture), result.asked[gesture]
        done = 100 * sum(trial.ok for trial in trials) / asked if asked else 0.0
        table.add_row(
            gesture.value,
            str(asked),
            f"{done:.2f}",
            f"{paper_success:.2f}",
            _seconds(spread(t.response_from_recognition_ms for t in trials)),
            _seconds(spread(t.visible_from_recognition_ms for t in trials)),
            f"{paper_response:.2f}",
            _median(spread(t.response_from_release_ms for t in trials)),
        )
    return table


def _figures(trials: Sequence[Trial], asked: int) -> dict[str, Any]:
    recognition = spread(trial.response_from_recognition_ms for trial in trials)
    visible = spread(trial.visible_from_recognition_ms for trial in trials)
    release = spread(trial.response_from_release_ms for trial in trials)
    return {
        "trials": asked,
        "success": round(success(trials) * len(trials) / asked, 4) if asked else None,
        "response_s": None if recognition is None else round(recognition.mean / 1e3, 4),
        "visible_s": None if visible is None else round(visible.mean / 1e3, 4),
        "release_to_command_ms": None
        if release is None
        else {"p50": round(release.p50, 1), "p99": round(release.p99, 1)},
    }


def _seconds(figure: Spread | None) -> str:
    return "–" if figure is None else f"{figure.mean / 1e3:.3f}"


def _median(figure: Spread | None) -> str:
    return "–" if figure is None else f"{figure.p50:.0f} (p99 {figure.p99:.0f})"
