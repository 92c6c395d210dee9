"""What came of quick pushes, frame by frame, and its tables."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum, auto
from typing import Any

import msgspec
from rich.table import Table

from app.demo.scenario import spread
from app.evaluate.harness import percent, table
from app.text.catalogue import render, tr
from kgdfa.button_state import PressCancel, PressHint
from kgdfa.gesture import Gesture
from logs.reason import Reason


class PushFault(Enum):
    """Why a push did not command just its own gesture."""

    WRONG_COMMAND = auto()
    NOT_RECOGNISED = auto()  # explanation
    CANCELLED = auto()  # reason
    NOT_WITHDRAWN = auto()
    HINT = auto()  # hint
    NOT_NEAR = auto()


class ButtonPhase(Enum):
    """What the button waits for."""

    WAITING = auto()  # for a hand outside
    READY = auto()
    PRESSED = auto()


@dataclass(frozen=True, slots=True, kw_only=True)
class PushFrame:
    """One frame of a push. at_ms: since the hand began to move; None: not measured. code: hint or end of the press."""

    at_ms: float
    true_m: float
    shown_m: float | None
    safe_m: float | None
    verdict: Gesture | None
    voted: Gesture | None
    phase: ButtonPhase
    code: PressHint | PressCancel | None

    def as_json(self) -> dict[str, Any]:
        """As `--json` writes it, centimetres."""
        lengths = {"true": self.true_m, "shown": self.shown_m, "safe": self.safe_m}
        gestures = {"verdict": self.verdict, "voted": self.voted}
        return {
            "at_ms": round(self.at_ms, 1),
            **{f"{name}_cm": None if one is None else round(100 * one, 1) for name, one in lengths.items()},
            **{name: one.value if one else None for name, one in gestures.items()},
            "phase": self.phase.name,
            "code": self.code.name if self.code else None,
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class Push:
    """What came of one push. lost: frames of it without a hand; refused: with a hand, without a distance.

    commanded: every gesture that went out from the rest before this push to its end; fault: None when it is right.
    command_s: from the recognition of the gesture to the frame that commanded it; None without a command.
    """

    seed: int
    gesture: Gesture
    click_s: float
    commanded: tuple[Gesture, ...]
    fault: Reason | None
    lost: int
    refused: int
    nearest_m: float
    command_s: float | None
    frames: tuple[PushFrame, ...]

    @property
    def ok(self) -> bool:
        """Whether exactly its own gesture was commanded."""
        return self.commanded == (self.gesture,)

    @property
    def unrequested(self) -> int:
        """Commands of other gestures, and second ones of its own."""
        return len(self.commanded) - (self.gesture in self.commanded)

    def as_json(self) -> dict[str, Any]:
        """As `--json` writes it; the frames of those that failed."""
        return {
            "seed": self.seed,
            "gesture": self.gesture.value,
            "click_s": round(self.click_s, 3),
            "commanded": [one.value for one in self.commanded],
            "fault": msgspec.to_builtins(self.fault),
            "lost_frames": self.lost,
            "refused_frames": self.refused,
            "nearest_cm": round(100 * self.nearest_m, 1) if math.isfinite(self.nearest_m) else None,
            "command_s": None if self.command_s is None else round(self.command_s, 4),
            "frames": [] if self.ok else [frame.as_json() for frame in self.frames],
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class PushRun:
    """Every push made; `interrupted` when the operator ended them."""

    pushes: tuple[Push, ...]
    interrupted: bool = False

    @property
    def unrequested(self) -> int:
        """Commands that nobody requested."""
        return sum(push.unrequested for push in self.pushes)

    def as_json(self) -> dict[str, Any]:
        """As `--json` writes it."""
        command = spread(push.command_s for push in self.pushes)
        return {
            "trials": len(self.pushes),
            "success": round(sum(push.ok for push in self.pushes) / len(self.pushes), 4) if self.pushes else None,
            "unintended": self.unrequested,
            "recognition_to_command_s": None if command is None else msgspec.to_builtins(command),
            "interrupted": self.interrupted,
            "pushes": [push.as_json() for push in self.pushes],
        }


def shown(run: PushRun) -> Iterator[Table | str]:
    """What failed, frame by frame; by hand and by gesture; and all of them in a sentence."""
    for push in run.pushes:
        if not push.ok:
            yield _frames_table(push)
    yield _failed_table(run.pushes)
    yield table("pushes.hands", "hand pushes commanded percent", _rows(run.pushes, lambda push: push.seed))
    columns = "gesture pushes commanded percent recognition_to_command_s"
    yield table("pushes", columns, _rows(run.pushes, lambda push: push.gesture.value, timed=True))
    if run.interrupted:
        yield tr("evaluate.pushes.interrupted")
    if run.pushes:
        right = sum(push.ok for push in run.pushes)
        share = percent(right / len(run.pushes), 2)
        made = {"right": right, "pushes": len(run.pushes), "share": share, "unrequested": run.unrequested}
        yield tr("evaluate.pushes.summary", **made)


def _rows(
    pushes: Sequence[Push], key: Callable[[Push], object], *, timed: bool = False
) -> Iterator[tuple[object, ...]]:
    """A row for each key: pushes, commands, percent, and mean time to the command."""
    for one in dict.fromkeys(map(key, pushes)):
        of = [push for push in pushes if key(push) == one]
        right, times = sum(push.ok for push in of), spread(push.command_s for push in of)
        time = f"{times.mean:.3f}" if times else "–"
        yield (one, len(of), right, f"{100 * right / len(of):.1f}", *([time] if timed else []))


def _failed_table(pushes: Sequence[Push]) -> Table:
    """Each push that did not command just its own gesture, and why."""
    made = table("pushes.failed", "hand gesture click_s frames_lost refused nearest_cm", left=2)
    made.add_column(tr("evaluate.column.why"))
    for push in pushes:
        if push.fault is not None:
            figures = (f"{push.click_s:.2f}", str(push.lost), str(push.refused), f"{100 * push.nearest_m:.1f}")
            made.add_row(str(push.seed), push.gesture.value, *figures, render(push.fault))
    return made


def _frames_table(push: Push) -> Table:
    """One push, frame by frame."""
    columns, gesture = "ms true_cm shown_cm safe_cm verdict voted", push.gesture.value
    made = table("pushes.frames", columns, left=0, hand=push.seed, gesture=gesture, click_s=f"{push.click_s:.2f}")
    made.add_column(tr("evaluate.column.button"))
    made.add_column(tr("evaluate.column.why"))
    for frame in push.frames:
        lengths = (None if one is None else f"{100 * one:.1f}" for one in (frame.true_m, frame.shown_m, frame.safe_m))
        gestures = (one.value if one else None for one in (frame.verdict, frame.voted))
        cells = [cell or "–" for cell in (*lengths, *gestures)]
        made.add_row(f"{frame.at_ms:.0f}", *cells, render(frame.phase), render(frame.code) if frame.code else "")
    return made
