"""The push as a trace: the distance that decides, over the last seconds, with its threshold and what came of it."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from enum import Enum
from itertools import pairwise

from app.console.widgets.canvas import Canvas
from app.console.widgets.panel import Lines, cells, wrapped
from app.ipc.messages import TriggerReport
from app.text.catalogue import tr

SHOWN_S = 6.0
GAP_S = 0.4  # without a distance for so long the trace is broken
TRACE_ROWS = 3  # with fewer there is a gauge instead
NEAR_TOP, FAR_TOP_M = 2.2, 0.70  # the scale's end: so many thresholds, or the paper's farthest while the hand is there
BAND_SD = 2.0


class MarkKind(Enum):
    """What happened, and its sign."""

    PRESSED = "▼"
    RELEASED = "▲"
    NOTHING = "✗"


_STYLES = {MarkKind.PRESSED: "bold $success", MarkKind.RELEASED: "bold $success", MarkKind.NOTHING: "bold $warning"}


@dataclass(frozen=True, slots=True)
class Sample:
    """One report's distance; None: no hand."""

    at_ns: int
    safe_m: float | None
    best_m: float | None
    sd_m: float
    pressed: bool


@dataclass(frozen=True, slots=True)
class Mark:
    """A press, a release with its gesture, or why a push gave nothing."""

    at_ns: int
    kind: MarkKind
    text: str = ""


class Push:
    """The reports of the last seconds and what they changed."""

    def __init__(self) -> None:
        self.samples: deque[Sample] = deque(maxlen=400)
        self.marks: deque[Mark] = deque(maxlen=20)
        self._before: TriggerReport | None = None
        self._why = ""

    def take(self, report: TriggerReport, why: str) -> None:
        """A report, once; `why` a push gave nothing, as it is known with it."""
        before = self._before
        if before is not None and _number(report) == _number(before):
            return
        at_ns = report.captured_ns
        self.samples.append(
            Sample(at_ns, report.safe_distance_m, report.distance_m, report.distance_sd_m, report.pressed)
        )
        if before is not None and before.incarnation == report.incarnation:
            if report.pressed and not before.pressed:
                self.marks.append(Mark(at_ns, MarkKind.PRESSED))
            if report.release_count > before.release_count:
                gesture = tr(report.released_gesture) if report.released_gesture else ""
                self.marks.append(Mark(report.released_ns or at_ns, MarkKind.RELEASED, gesture))
        if why and why != self._why:
            self.marks.append(Mark(at_ns, MarkKind.NOTHING, why))
        self._before, self._why = report, why


def _number(report: TriggerReport) -> tuple[int, int, int]:
    return report.incarnation, report.sequence, report.captured_ns


def draw_push(push: Push, now_ns: int, threshold_m: float, width: int, rows: int) -> Lines:
    """The trace, newest on the right, far on top: solid the distance that decides, dotted its uncertainty."""
    return _Trace(push, now_ns, threshold_m, width, rows).lines() if width >= 8 else ()


class _Trace:
    """Metres and seconds to dots."""

    def __init__(self, push: Push, now_ns: int, threshold_m: float, width: int, rows: int) -> None:
        self._push = push
        self._canvas = Canvas(width, rows)
        self._dot_ns = SHOWN_S * 1e9 / self._canvas.width
        self._now = int(now_ns / self._dot_ns)  # whole dots: it changes only when something moves
        self._samples = [each for each in push.samples if self._x(each.at_ns) >= 0]
        near_top_m = NEAR_TOP * threshold_m
        farthest_m = max((each.safe_m for each in self._samples if each.safe_m is not None), default=0.0)
        self._top_m = near_top_m if farthest_m < near_top_m else max(FAR_TOP_M, near_top_m)
        self._threshold_m = threshold_m
        self._label = f"{threshold_m * 100:.1f}".removesuffix(".0") + " cm"

    def lines(self) -> Lines:
        """Threshold, band, trace, signs, the threshold's figure, a reason, in this order of covering."""
        canvas, limit = self._canvas, self._y(self._threshold_m)
        canvas.pen = "$warning"
        canvas.line(0, limit, canvas.width - 1, limit, every=3)
        self._band()
        self._line()
        shown = [(self._x(mark.at_ns) // 2, mark) for mark in self._push.marks if self._x(mark.at_ns) >= 0]
        self._signs(shown)
        if canvas.columns >= 4 * cells(self._label):
            canvas.text(0, limit // 4, f"{self._label} ", "$warning")
        self._reason(shown)
        return canvas.lines()

    def _band(self) -> None:
        self._canvas.pen = "$foreground-muted"
        for each in self._samples:
            if each.best_m is not None:
                x = self._x(each.at_ns)
                low, high = self._y(each.best_m + BAND_SD * each.sd_m), self._y(each.best_m - BAND_SD * each.sd_m)
                for y in range(low + x % 2, high + 1, 2):
                    self._canvas.dot(x, y)

    def _line(self) -> None:
        canvas = self._canvas
        for a, b in pairwise(self._samples):
            if a.safe_m is not None and b.safe_m is not None and b.at_ns - a.at_ns < GAP_S * 1e9:
                canvas.pen = "bold $success" if b.pressed else "bold $primary"
                y0, y1 = self._y(a.safe_m), self._y(b.safe_m)
                canvas.line(self._x(a.at_ns), y0, self._x(b.at_ns), y1)

    def _signs(self, shown: list[tuple[int, Mark]]) -> None:
        """Each where it happened."""
        for column, mark in shown:
            row = self._row(mark)
            self._canvas.text(column, row, mark.kind.value, _STYLES[mark.kind])
            if mark.kind is MarkKind.RELEASED and mark.text:
                self._write(column, row, mark.text, _STYLES[mark.kind], rows=1)

    def _reason(self, shown: list[tuple[int, Mark]]) -> None:
        """The newest one, at its sign."""
        nothing = [(column, mark) for column, mark in shown if mark.kind is MarkKind.NOTHING]
        for column, mark in nothing[-1:]:
            self._write(column, self._row(mark), mark.text, "$warning", rows=self._canvas.rows)

    def _write(self, column: int, row: int, text: str, style: str, *, rows: int) -> None:
        """Right of the sign, or left of it, or else over the whole width, from the row above."""
        width, long = self._canvas.columns, cells(text)
        if column + 2 + long <= width:
            self._put(column + 1, row, f" {text}", style)
        elif long + 1 <= column:
            self._put(column - 1 - long, row, f"{text} ", style)
        else:
            parts = wrapped(text, width)[:rows]
            first = row - len(parts) if row >= len(parts) else min(row + 1, self._canvas.rows - len(parts))
            for at, part in enumerate(parts):
                self._put(0, max(0, first) + at, part, style)

    def _put(self, column: int, row: int, text: str, style: str) -> None:
        """In place of the whole figure of the threshold where it would cover a part of it."""
        if row == self._y(self._threshold_m) // 4 and column <= cells(self._label):
            self._canvas.text(0, row, " " * cells(self._label))
        self._canvas.text(column, row, text, style)

    def _row(self, mark: Mark) -> int:
        """Where the trace was then; on the threshold's row if there was no distance."""
        near = min(self._samples, key=lambda each: abs(each.at_ns - mark.at_ns), default=None)
        return self._y(self._threshold_m if near is None or near.safe_m is None else near.safe_m) // 4

    def _x(self, at_ns: int) -> int:
        return min(self._canvas.width - 1, self._canvas.width - 1 - (self._now - int(at_ns / self._dot_ns)))

    def _y(self, metres: float) -> int:
        share = min(max(metres / self._top_m, 0.0), 1.0)
        return round((1.0 - share) * (self._canvas.height - 1))
