"""What the compare screen shows of two cameras: a column each, and the running table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from app.console.widgets.gesture import gauge
from app.console.widgets.panel import Lines, cells, fitted, padded, plain, wrapped
from app.ipc.messages import TriggerReport
from app.perception.comparison import SHORTENED, SHOWN, Comparison
from app.perception.look import CameraSample
from app.text.catalogue import render, tr
from kgdfa.distance import DistanceSource

CAMERA = SHOWN.index("camera")
LEAST_CAMERA = 8  # cells of a camera's name
GAP = 2


@dataclass(slots=True)
class FrameCount:
    """The frames of the session's own camera, counted as a camera that only looks counts its own."""

    frames: int = 0
    lost: int = 0  # without a hand, after the first with one
    had_hand: bool = False
    newest: TriggerReport | None = None  # of a frame

    def take(self, report: TriggerReport) -> CameraSample | None:
        """The sample of a frame; None: perception had none to report, as between those of a slow camera."""
        before = self.newest
        if before is not None and report.captured_ns <= before.captured_ns:
            return None
        self.newest = report
        passed = 1 if before is None else _passed(before, report)
        hand = report.hand or report.hand_refusal is not None
        self.had_hand = self.had_hand or hand
        self.frames += passed
        self.lost += passed * (self.had_hand and not hand)
        return _sample(report, self.frames, self.lost)


def _passed(before: TriggerReport, now: TriggerReport) -> int:
    """Frames from one on to the other: of the reports between, which the console may have missed, some had none."""
    by_rate = round(now.fps * (now.captured_ns - before.captured_ns) / 1e9)
    return max(1, min(by_rate, now.sequence - before.sequence))


def _sample(report: TriggerReport, frames: int, lost: int) -> CameraSample:
    return CameraSample(
        camera=report.camera,
        captured_ns=report.captured_ns,
        frames=frames,
        lost=lost,
        latency_ms=(report.sent_ns - report.captured_ns) / 1e6,
        distance_m=report.distance_m,
        safe_m=report.safe_distance_m,
        pressed=report.pressed,
        presses=report.release_count + report.cancel_count + report.pressed,
        by_depth=report.distance_source is DistanceSource.DEPTH,
        why=report.hand_refusal or report.depth_fault,
    )


def camera_lines(comparison: Comparison, which: int, width: int) -> Lines:
    """One camera's column, five lines."""
    sample, fault = comparison.newest[which], comparison.faults[which]
    if fault is not None:
        return (plain(render(fault), "$warning"),)
    if sample is None:
        return (plain(tr("compare.opening"), "$text-muted"),)
    total = comparison.total(which)
    word = tr("button.pressed") if sample.pressed else tr("button.released")
    button = plain(
        f"{'◉' if sample.pressed else '○'} {word}", "bold $success" if sample.pressed else "bold $foreground-muted"
    )
    counted = (
        plain(tr("compare.truth", true=total.presses[True], false=total.presses[False], unknown=total.presses[None])),
        plain(tr("compare.rates", fps=total.fps, latency_ms=total.latency_ms, lost=total.lost_share)),
    )
    if sample.distance_m is None:
        why = wrapped(render(sample.why), width)[:2] if sample.why else ("",)
        reasons = tuple(plain(part, "$warning") for part in why)
        return (plain(tr("compare.no_measurement"), "bold"), *reasons, *(button,)[: 3 - len(reasons)], *counted)
    source = DistanceSource.DEPTH if sample.by_depth else DistanceSource.MONOCULAR
    parts = ((f"{sample.distance_m * 100:.1f} cm", "bold"), (f"  {tr(source)}", "$text-muted"))
    return (
        fitted((*parts, _against(comparison.ruler_m, sample.distance_m)), width),
        plain(gauge(sample.safe_m, 0.0, comparison.threshold_m, width)),
        button,
        *counted,
    )


def no_image_lines() -> Lines:
    """In place of figures that are none of now."""
    return (plain(tr("picture.stale"), "$warning"),)


def own_depth_lines(report: TriggerReport, ruler_m: float | None, width: int) -> Lines:
    """The session's own depth, beside its keypoints."""
    depth_m, fault = report.depth_distance_m, report.depth_fault
    if depth_m is None:
        shown = (tr("compare.no_measurement"), "bold") if fault else (tr("compare.no_depth"), "$text-muted")
        return ((shown,), *(plain(part, "$warning") for part in wrapped(render(fault) if fault else "", width)))
    return (
        fitted(((f"{depth_m * 100:.1f} cm", "bold"), _against(ruler_m, depth_m)), width),
        plain(gauge(depth_m, 0.0, report.threshold_m, width)),
    )


def _against(ruler_m: float | None, distance_m: float) -> tuple[str, str]:
    return ("" if ruler_m is None else f"  {tr('compare.against', error=distance_m / ruler_m - 1)}", "")


def table_lines(comparison: Comparison, width: int, height: int) -> Lines:
    """Headings, and a row for each camera and value of the ruler: all, or those about the ruler's value now."""
    rows = [*comparison.rows()]
    now = [place for place, one in enumerate(rows) if one.ruler_m == comparison.ruler_m]
    first = max(0, min(len(rows), (now[-1] if now else len(rows) - 1) + 1) - max(1, height - 1))
    shown = [one.shown() for one in rows[first : first + max(1, height - 1)]]
    full, short = ([_heading(name, short=short) for name in SHOWN] for short in (False, True))
    headings = full if _least_width(full, shown) <= width else short
    return tuple(
        plain(text, "$text-muted" if place == 0 else "") for place, text in enumerate(_aligned(headings, shown, width))
    )


def _heading(name: str, *, short: bool) -> str:
    return tr(f"compare.short.{name}" if short and name in SHORTENED else f"compare.column.{name}")


def _widths(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> list[int]:
    return [max(map(cells, column)) for column in zip(headings, *rows, strict=True)]


def _least_width(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> int:
    return sum(_widths(headings, rows)) + GAP * (len(SHOWN) - 1)


def _aligned(headings: Sequence[str], rows: Sequence[Sequence[str]], width: int) -> list[str]:
    """Figures to the right, under their headings; a camera's name is cut before a figure is."""
    widths = _widths(headings, rows)
    widths[CAMERA] = max(LEAST_CAMERA, widths[CAMERA] - max(0, _least_width(headings, rows) - width))
    lines = []
    for row in (headings, *rows):
        parts = [" " * (wide - cells(text)) + text for text, wide in zip(row, widths, strict=True)]
        parts[CAMERA] = padded(row[CAMERA], widths[CAMERA])
        lines.append((" " * GAP).join(parts))
    return lines
