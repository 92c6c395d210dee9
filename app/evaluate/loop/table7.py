"""Table 7 beside the paper's figures: what came of every attempt, how fast, and why some failed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any

import msgspec
from rich.table import Table

from app.demo.scenario import Attempt, Spread, spread, success
from app.demo.session import SessionResult
from app.evaluate.harness import table
from app.text.catalogue import render, tr
from kgdfa.gesture import Gesture
from logs.reason import Reason

# Table 7: success %, mean response s, of 3 people × 50 attempts a gesture
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
# Its rows average less than it reports.
PAPER_OVERALL = {"paper_success": 0.9411, "paper_average": 0.9139, "paper_response_s": 0.615}


@dataclass(frozen=True, slots=True, kw_only=True)
class ResponseResult:
    """All sessions together; `interrupted` when the operator ended them, `gave_up` when no round could be made."""

    sessions: tuple[SessionResult, ...]
    programs: tuple[str, ...] = ()  # SHA-256 of the program's files, of each version that made some of them
    interrupted: bool = False
    gave_up: Reason | None = None

    @property
    def attempts(self) -> tuple[Attempt, ...]:
        """Every attempt of every session."""
        return tuple(chain.from_iterable(session.attempts for session in self.sessions))

    @property
    def unintended(self) -> int:
        """Unintended actions, in all sessions."""
        return sum(session.unintended for session in self.sessions)

    def of(self, gesture: Gesture) -> tuple[Attempt, ...]:
        """The attempts of one gesture."""
        return tuple(attempt for attempt in self.attempts if attempt.gesture is gesture)

    def failures(self) -> Counter[tuple[str, str]]:
        """How often which gesture failed for which reason."""
        return Counter(
            (attempt.gesture.value, render(attempt.reason) if attempt.reason else "–")
            for attempt in self.attempts
            if not attempt.ok
        )

    def as_json(self) -> dict[str, Any]:
        """As `--json` writes it; times in seconds, from recognition and from release."""
        return {
            **_figures(self.attempts),
            "unintended": self.unintended,
            "audit_verified": all(session.audit_verified for session in self.sessions),
            "sessions": len(self.sessions),
            "programs": self.programs,
            "interrupted": self.interrupted,
            "gave_up": msgspec.to_builtins(self.gave_up),
            "per_gesture": {gesture.value: _figures(self.of(gesture)) for gesture in PAPER},
            "failures": [
                {"gesture": gesture, "reason": why, "times": times}
                for (gesture, why), times in self.failures().most_common()
            ],
        }


def response_table(result: ResponseResult) -> Table:
    """Ours beside the paper's, a row a gesture."""
    rows = []
    for gesture, (paper_success, paper_response) in PAPER.items():
        attempts = result.of(gesture)
        rows.append(
            (
                gesture.value,
                len(attempts),
                f"{100 * success(attempts):.2f}" if attempts else "–",
                f"{paper_success:.2f}",
                _seconds(spread(t.response_from_recognition_ms for t in attempts)),
                _seconds(spread(t.visible_from_recognition_ms for t in attempts)),
                f"{paper_response:.2f}",
                _median(spread(t.response_from_release_ms for t in attempts)),
            )
        )
    columns = "gesture attempts success paper recognition_to_command_s to_visible_s paper release_to_command_ms"
    return table("response", columns, rows, left=2)


def failure_table(result: ResponseResult) -> Table:
    """Why attempts failed, the commonest first."""
    made = table("response.failures", "gesture times why", left=3)
    for (gesture, why), times in result.failures().most_common():
        made.add_row(gesture, str(times), why)
    return made


def shown(result: ResponseResult) -> Iterator[Table | str]:
    """Both tables and the summary."""
    yield response_table(result)
    if result.failures():
        yield failure_table(result)
    if result.interrupted:
        yield tr("evaluate.response.interrupted")
    if result.gave_up is not None:
        yield render(result.gave_up)
    figures = result.as_json()
    if figures["success"] is not None:
        release_ms = figures["release_to_command_ms"] or dict.fromkeys(("p50", "p99"))
        measured = {"response_s": figures["response_s"], "visible_s": figures["visible_s"], **release_ms}
        yield tr(
            "evaluate.response.summary",
            success=figures["success"],
            attempts=figures["trials"],
            unintended=figures["unintended"],
            **{name: "–" if value is None else value for name, value in measured.items()},
            **PAPER_OVERALL,
        )


def _figures(attempts: Sequence[Attempt]) -> dict[str, Any]:
    recognition = spread(attempt.response_from_recognition_ms for attempt in attempts)
    visible = spread(attempt.visible_from_recognition_ms for attempt in attempts)
    release = spread(attempt.response_from_release_ms for attempt in attempts)
    return {
        "trials": len(attempts),
        "success": round(success(attempts), 4) if attempts else None,
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
