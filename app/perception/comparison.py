"""Two cameras side by side: what each measured, counted for each value of a ruler that was typed in. Pure."""

from __future__ import annotations

import csv
import io
import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

from app.perception.look import CameraSample
from logs.reason import Reason
from logs.records import CameraComparison

Ruler = float | None  # the true distance, metres; None: nobody has measured it
COLUMNS = (
    "ruler_cm", "camera", "frames", "fps", "latency_ms", "lost_percent", "distance_cm", "error_percent",
    "from_other_cm", "presses_true", "presses_false", "presses_unknown",
)  # fmt: skip

ABOUT_NS = 500_000_000  # of a press: what the other camera measures so much sooner or later is of the same push
TOGETHER_NS = 50_000_000  # samples no farther apart in time are of one place of the hand: half a period at 10 Hz
RECENT = 300  # samples: ABOUT_NS on both sides, at any camera's rate
SHOWN = ("ruler", "camera", "distance", "error", "other", "fps", "latency", "lost", "true", "false")
SHORTENED = frozenset({"other", "true", "false"})  # of those, whose headings are sentences where there is room

SUMS = ("frames", "lost", "samples", "measured", "sum_m", "sum_latency_ms", "seconds", "apart", "sum_apart_m")


@dataclass(slots=True)
class Tally:
    """One camera at one value of the ruler. Presses: true, false, and where nobody knows the true distance."""

    ruler_m: Ruler
    camera: str
    frames: int = 0
    lost: int = 0
    samples: int = 0
    measured: int = 0
    sum_m: float = 0.0
    sum_latency_ms: float = 0.0
    apart: int = 0  # pairs of samples of one moment in which both measured
    sum_apart_m: float = 0.0
    presses: dict[bool | None, int] = field(default_factory=lambda: {True: 0, False: 0, None: 0})
    seconds: float = 0.0

    @property
    def fps(self) -> float:
        """Frames per second as measured."""
        return self.frames / self.seconds if self.seconds else 0.0

    @property
    def latency_ms(self) -> float:
        """From capture to the measured distance, mean."""
        return self.sum_latency_ms / self.samples if self.samples else 0.0

    @property
    def lost_share(self) -> float:
        """Frames without keypoints."""
        return self.lost / self.frames if self.frames else 0.0

    @property
    def distance_m(self) -> float | None:
        """Mean."""
        return self.sum_m / self.measured if self.measured else None

    @property
    def error(self) -> float | None:
        """Of the mean distance against the ruler, as a share of it."""
        if self.distance_m is None or self.ruler_m is None:
            return None
        return self.distance_m / self.ruler_m - 1

    @property
    def from_other_m(self) -> float | None:
        """How much farther it reads than the other camera, mean."""
        return self.sum_apart_m / self.apart if self.apart else None

    def shown(self) -> list[str]:
        """As a person reads it, for SHOWN; – where nothing was measured."""
        return [
            _cm(self.ruler_m),
            self.camera,
            _cm(self.distance_m),
            "–" if self.error is None else f"{self.error:+.1%}",
            _cm(self.from_other_m, "+.1f"),
            f"{self.fps:.1f}",
            f"{self.latency_ms:.0f}",
            f"{self.lost_share:.0%}",
            str(self.presses[True]),
            str(self.presses[False]),
        ]

    def row(self) -> dict[str, Any]:
        """As the CSV has it, for COLUMNS."""
        values = (
            _hundredfold(self.ruler_m), self.camera, self.frames, round(self.fps, 1), round(self.latency_ms, 1),
            round(100 * self.lost_share, 1), _hundredfold(self.distance_m), _hundredfold(self.error),
            _hundredfold(self.from_other_m), self.presses[True], self.presses[False], self.presses[None],
        )  # fmt: skip
        return dict(zip(COLUMNS, values, strict=True))


@dataclass(slots=True)
class _Press:
    """One that waits for what the other camera measures about its time; it lasts from begun_ns to ended_ns so far."""

    which: int
    begun_ns: int
    ended_ns: int
    count: int
    tally: Tally


@dataclass(slots=True)
class Comparison:
    """The running table. threshold_m: nearer is a true press."""

    threshold_m: float
    ruler_m: Ruler = None
    newest: list[CameraSample | None] = field(default_factory=lambda: [None, None])
    faults: list[Reason | None] = field(default_factory=lambda: [None, None])  # why a camera gives no picture
    _before: list[CameraSample | None] = field(default_factory=lambda: [None, None])
    _recent: tuple[deque[CameraSample], deque[CameraSample]] = field(
        default_factory=lambda: (deque(maxlen=RECENT), deque(maxlen=RECENT))
    )
    _waiting: list[_Press] = field(default_factory=list)
    _tallies: dict[tuple[Ruler, int], Tally] = field(default_factory=dict)

    def take(self, which: int, sample: CameraSample) -> None:
        """One more sample of the first (0) or second (1) camera."""
        before, self.newest[which], self.faults[which] = self._before[which], sample, None
        self._before[which] = sample
        self._recent[which].append(sample)
        tally = self._tallies.setdefault((self.ruler_m, which), Tally(self.ruler_m, sample.camera))
        tally.samples += 1
        tally.sum_latency_ms += sample.latency_ms
        if sample.distance_m is not None:
            tally.measured += 1
            tally.sum_m += sample.distance_m
            self._compare(which, sample.captured_ns, sample.distance_m)
        if before is None or sample.frames <= before.frames:
            return
        tally.frames += sample.frames - before.frames
        tally.lost += max(0, sample.lost - before.lost)
        tally.seconds += (sample.captured_ns - before.captured_ns) / 1e9
        now_ns = sample.captured_ns
        for press in self._waiting:
            if press.which == which and sample.pressed:
                press.ended_ns = now_ns
        if sample.presses > before.presses:
            self._waiting.append(_Press(which, now_ns, now_ns, sample.presses - before.presses, tally))
        self._classify_presses(now_ns - ABOUT_NS)

    def _compare(self, which: int, at_ns: int, distance_m: float) -> None:
        """With the other camera's sample nearest in time, for both: the one with the longer latency comes second."""
        others = self._recent[1 - which]
        other = min(others, key=lambda one: abs(one.captured_ns - at_ns), default=None)
        if other is None or other.distance_m is None or abs(other.captured_ns - at_ns) > TOGETHER_NS:
            return
        apart_m = distance_m - other.distance_m
        for side, signed_m in ((which, apart_m), (1 - which, -apart_m)):
            if tally := self._tallies.get((self.ruler_m, side)):
                tally.apart += 1
                tally.sum_apart_m += signed_m

    def finish(self) -> None:
        """No more samples come: settle every press by what there is."""
        self._classify_presses(None)

    def _classify_presses(self, until_ns: int | None) -> None:
        """The presses up to this time, or all: what the other camera measured about then has come."""
        for press in self._waiting.copy():
            if press.tally.ruler_m is not None or until_ns is None or press.ended_ns <= until_ns:
                press.tally.presses[self._is_true(press)] += press.count
                self._waiting.remove(press)

    def _is_true(self, press: _Press) -> bool | None:
        """By the ruler, else by what the other camera measured; None: nothing while pressed, as a D435i so near.

        Near a moment sooner or later counts, too: a slow camera may see a quick push late, and only in a frame.
        """
        if press.tally.ruler_m is not None:
            return press.tally.ruler_m < self.threshold_m
        others = [
            (one.captured_ns, one.distance_m < self.threshold_m)
            for one in self._recent[1 - press.which]
            if one.distance_m is not None and press.begun_ns - ABOUT_NS <= one.captured_ns <= press.ended_ns + ABOUT_NS
        ]
        if any(near for _, near in others):
            return True
        return False if any(press.begun_ns <= at_ns <= press.ended_ns for at_ns, _ in others) else None

    def rows(self) -> Iterator[Tally]:
        """By ruler, nearest first and what was not measured last; the first camera above the second."""
        order = sorted(self._tallies, key=lambda key: (math.inf if key[0] is None else key[0], key[1]))
        return (self._named(self._tallies[key], key[1]) for key in order)

    def _named(self, tally: Tally, which: int) -> Tally:
        """Two cameras of one name are told apart by a number."""
        first = self.newest[0]
        twin = which == 1 and first is not None and first.camera == tally.camera
        return replace(tally, camera=f"{tally.camera} (2)") if twin else tally

    def total(self, which: int) -> Tally:
        """One camera over all values of the ruler."""
        parts = [one for (_, side), one in self._tallies.items() if side == which]
        total = Tally(None, parts[0].camera if parts else "")
        for part in parts:
            for name in SUMS:
                setattr(total, name, getattr(total, name) + getattr(part, name))
            for known, count in part.presses.items():
                total.presses[known] += count
        return self._named(total, which)

    def as_csv(self) -> str:
        """Every row, when no more samples come."""
        self.finish()
        text = io.StringIO()
        writer = csv.DictWriter(text, COLUMNS)
        writer.writeheader()
        writer.writerows(one.row() for one in self.rows())
        return text.getvalue()


def comparison_record(comparison: Comparison, path: str) -> CameraComparison:
    """For the trail, when the comparison ends; path: of the table."""
    comparison.finish()
    both = [comparison.total(which) for which in (0, 1)]
    return CameraComparison(
        cameras=tuple(one.camera for one in both),
        frames=tuple(one.frames for one in both),
        fps=tuple(one.fps for one in both),
        latency_ms=tuple(one.latency_ms for one in both),
        lost=tuple(one.lost_share for one in both),
        distance_m=tuple(one.distance_m for one in both),
        from_other_m=tuple(one.from_other_m for one in both),
        presses_true=tuple(one.presses[True] for one in both),
        presses_false=tuple(one.presses[False] for one in both),
        rulers_m=tuple(sorted({one.ruler_m for one in comparison.rows() if one.ruler_m is not None})),
        path=path,
    )


def _cm(metres: float | None, style: str = ".1f") -> str:
    return "–" if metres is None else format(100 * metres, style)


def _hundredfold(value: float | None) -> float | None:
    return None if value is None else round(100 * value, 1)
