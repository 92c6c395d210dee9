"""Compare: the session's camera beside a second one that only looks, or beside its own depth; a ruler; a table."""

from __future__ import annotations

import time
from pathlib import Path
from typing import ClassVar

import msgspec
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal
from textual.widgets import Input

from app.console.screens.base import ConsoleScreen
from app.console.state import SessionState
from app.console.widgets.gesture import gauge
from app.console.widgets.panel import Lines, Panel, plain
from app.console.widgets.picture import Picture
from app.ipc.messages import Preview, TriggerReport
from app.perception.comparison import Comparison, comparison_record
from app.perception.look import CameraSample, Looker, parse_camera, refuse_same_device
from app.text.catalogue import render, tr
from kgdfa.distance import DistanceSource
from logs.reason import Reason

POLL_S = 0.1
SHOWN_ROWS = 4
LONGEST_CM = 200.0


def sample_of(report: TriggerReport, lost: int) -> CameraSample:
    """What the session's own camera measured, as a camera that only looks gives it."""
    return CameraSample(
        camera=report.camera,
        captured_ns=report.captured_ns,
        frames=report.sequence,
        lost=lost,
        latency_ms=(report.sent_ns - report.captured_ns) / 1e6,
        hand=report.hand,
        distance_m=report.distance_m,
        safe_m=report.safe_distance_m,
        pressed=report.pressed,
        presses=report.release_count + report.cancel_count + report.pressed,
        by_depth=report.distance_source is DistanceSource.DEPTH,
        why=report.camera_fault or report.depth_fault,
    )


def camera_lines(comparison: Comparison, which: int, width: int) -> Lines:
    """One camera's column."""
    sample, fault = comparison.newest[which], comparison.faults[which]
    if fault is not None:
        return (plain(render(fault), "$warning"),)
    if sample is None:
        return (plain(tr("compare.opening"), "$text-muted"),)
    total, known = comparison.total(which), sample.distance_m is not None
    shown = f"{(sample.distance_m or 0) * 100:.1f} cm" if known else tr("compare.no_measurement")
    why = f"  {render(sample.why)}" if sample.why else ""
    word = tr("button.pressed") if sample.pressed else tr("button.released")
    return (
        (
            (shown, "bold"),
            (
                f"  {tr(DistanceSource.DEPTH if sample.by_depth else DistanceSource.MONOCULAR)}" if known else why,
                "$text-muted",
            ),
        ),
        plain(gauge(sample.safe_m, 0.0, comparison.threshold_m, width)),
        plain(f"{'◉' if sample.pressed else '○'} {word}", "bold $success" if sample.pressed else "bold $error"),
        plain(tr("compare.truth", true=total.presses[True], false=total.presses[False], unknown=total.presses[None])),
        plain(tr("compare.rates", fps=total.fps, latency_ms=total.latency_ms, lost=total.lost_share)),
    )


def own_depth_lines(report: TriggerReport, width: int) -> Lines:
    """The session's own depth, beside its keypoints."""
    if report.depth_distance_m is None and report.depth_fault is None:
        return (plain(tr("compare.no_depth"), "$text-muted"),)
    shown = (
        tr("compare.no_measurement") if report.depth_distance_m is None else f"{report.depth_distance_m * 100:.1f} cm"
    )
    return (
        plain(shown, "bold"),
        plain(gauge(report.depth_distance_m, 0.0, report.threshold_m, width)),
        plain(render(report.depth_fault) if report.depth_fault else "", "$warning"),
    )


def table_lines(comparison: Comparison) -> Lines:
    """The newest rows: what each camera gave at each value of the ruler."""
    rows = [*comparison.rows()][-SHOWN_ROWS:]
    return tuple(
        plain(
            tr(
                "compare.row",
                ruler=_cm(one.ruler_m),
                camera=one.camera[:18],
                distance=_cm(one.distance_m),
                error="–" if one.error is None else f"{one.error:+.1%}",
                other="–" if one.from_other_m is None else f"{100 * one.from_other_m:+.1f}",
                frames=one.frames,
            )
        )
        for one in rows
    )


def _cm(metres: float | None) -> str:
    return "–" if metres is None else f"{100 * metres:.1f}"


class CompareScreen(ConsoleScreen):
    """Opened over a session, which goes on beneath."""

    HELP_PAGE = "compare"
    AUTO_FOCUS = ""
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape,v", "back", "bind.cancel"),
        Binding("2", "focus_field('#second')", "bind.compare.second"),
        Binding("r", "focus_field('#ruler')", "bind.compare.ruler"),
    ]

    def __init__(self) -> None:
        super().__init__()
        self._sequence = -1
        self._lost = 0
        self._looker: Looker | None = None
        self._comparison = Comparison(threshold_m=0.0)

    def compose(self) -> ComposeResult:
        yield Panel(id="status")
        with Horizontal(id="pictures"):
            yield Picture(id="picture")
            yield Picture(id="other")
        with Horizontal(id="compared"):
            yield Input(placeholder=tr("compare.second"), id="second", compact=True)
            yield Input(placeholder=tr("compare.ruler"), id="ruler", compact=True)
        with Horizontal(id="columns"):
            yield Panel(id="monocular", title=tr("compare.first"))
            yield Panel(id="depth", title=tr("compare.depth"))
        yield Panel(id="running")
        yield from self.compose_bottom()

    def on_mount(self) -> None:
        """Without a second camera there is one picture."""
        self.query_one("#other").display = False
        self.query_one("#running").display = False
        self.set_interval(POLL_S, self._receive)

    def on_unmount(self) -> None:
        """The second camera is nobody's any more."""
        self._end_looker()

    def show_session(self, state: SessionState | None) -> None:
        super().show_session(state)
        if state is None:
            return
        self.query_one("#status", Panel).lines = (plain(tr("compare.text"), "$text-muted"),)
        self.query_one("#picture", Picture).show(state)
        if state.report is not None and state.report.sequence != self._sequence:
            self._take(state.report)

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """A second camera's name, or the ruler's centimetres."""
        self.set_focus(None)
        if event.input.id == "ruler":
            self._set_ruler(event.value)
        else:
            self._open(event.value.strip())

    def action_focus_field(self, field: str) -> None:
        """Type into it."""
        self.query_one(field).focus()

    def action_back(self) -> None:
        """To the session; what was compared is kept."""
        self._end_comparison()
        self.dismiss()

    def _open(self, source: str) -> None:
        """A second camera in place of an earlier one; an empty name: none."""
        self._end_comparison()
        self.query_one("#depth", Panel).border_title = tr("compare.depth")
        with self.notify_errors():
            if source:
                self._begin(source)
        for part in ("#other", "#running"):
            self.query_one(part).display = self._looker is not None

    def _begin(self, source: str) -> None:
        """Compare with this camera. Raises CodedError when there is none of this name."""
        setup = self.console_app.live_setup()
        camera, used = parse_camera(source, setup.config.camera)
        refuse_same_device(setup.config.camera, camera)
        self._comparison = Comparison(threshold_m=setup.profile.press_threshold_m)
        self._looker = Looker(
            msgspec.structs.replace(
                setup,
                config=msgspec.structs.replace(setup.config, camera=camera),
                profile=msgspec.structs.replace(setup.profile, distance_source=used),
            )
        )
        self.query_one("#depth", Panel).border_title = source

    def _set_ruler(self, typed: str) -> None:
        try:
            cm = float(typed.replace(",", ".")) if typed.strip() else 0.0
        except ValueError:
            cm = -1.0
        if 0 <= cm <= LONGEST_CM:
            self._comparison.ruler_m = cm / 100 if cm else None
        else:
            self.notify(tr("compare.no_ruler", longest=LONGEST_CM), severity="error", markup=False)

    def _receive(self) -> None:
        if self._looker is None:
            return
        for message in self._looker.receive():
            if isinstance(message, Preview):
                self.query_one("#other", Picture).show_preview(message)
            elif isinstance(message, Reason):
                self._comparison.faults[1] = message
            else:
                self._comparison.take(1, message)
        panel = self.query_one("#depth", Panel)
        panel.lines = camera_lines(self._comparison, 1, max(10, panel.content_size.width))
        self.query_one("#running", Panel).lines = table_lines(self._comparison)

    def _take(self, report: TriggerReport) -> None:
        if self._sequence >= 0 and not report.hand:
            self._lost += max(0, report.sequence - self._sequence)
        self._sequence = report.sequence
        self._comparison.threshold_m = report.threshold_m
        self._comparison.take(0, sample_of(report, self._lost))
        first, second = (self.query_one(f"#{name}", Panel) for name in ("monocular", "depth"))
        width = max(10, first.content_size.width)
        first.lines = camera_lines(self._comparison, 0, width)
        if self._looker is None:
            second.lines = own_depth_lines(report, width)

    def _keep(self) -> None:
        """As a file, and in the trail. Raises OSError when the disk refuses."""
        setup = self.console_app.live_setup()
        folder = Path(setup.home) / "comparisons"
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / f"{setup.session}-{time.strftime('%H%M%S', time.gmtime())}.csv"
        path.write_text(self._comparison.as_csv(), encoding="utf-8")
        self.console_app.trail.emit(comparison_record(self._comparison, path.name))
        self.notify(tr("compare.kept", path=path), markup=False)

    def _end_comparison(self) -> None:
        """Keep what was compared; the second camera is let go."""
        if self._looker is not None:
            with self.notify_errors():
                self._keep()
        self._end_looker()

    def _end_looker(self) -> None:
        looker, self._looker = self._looker, None
        if looker is not None:
            looker.close()
