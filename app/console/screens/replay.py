"""The replay of a session's recording: what the therapist saw at any moment, and why it was decided."""

from __future__ import annotations

import time
from pathlib import Path
from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType

from app.console.live import Clock
from app.console.screens.base import ConsoleScreen
from app.console.widgets.panel import Panel
from app.console.widgets.replay import replay_status, time_bar
from app.console.widgets.replay_view import ReplayView
from app.playback.film import FPS
from app.playback.moment import Moment, moment
from app.playback.session import Playback, moment_ns
from app.playback.view import Legs
from logs.records import Record

DRAWN_S = 1 / 12
SPEEDS = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0)
SECONDS_NS = 1_000_000_000


class ReplayScreen(ConsoleScreen):
    """One recording; nothing moves while it is open."""

    HELP_PAGE = "replay"
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape", "dismiss", "replay.close", id="replay.close"),
        Binding("enter", "play", "replay.play", id="replay.play"),
        Binding("left", "step(-1)", "replay.left", id="replay.left"),
        Binding("right", "step(1)", "replay.right", id="replay.right"),
        Binding("n", "jump(1)", "replay.next", id="replay.next"),
        Binding("p", "jump(-1)", "replay.previous", id="replay.previous"),
        Binding("v", "page", "replay.page", id="replay.page"),
        Binding("plus,equals_sign", "speed(1)", "replay.faster", id="replay.faster"),
        Binding("minus", "speed(-1)", "replay.slower", id="replay.slower"),
        Binding("r", "record", "replay.record", id="replay.record", show=False),
        Binding("pageup", "skip(-5)", "replay.skip_back", id="replay.skip_back", show=False),
        Binding("pagedown", "skip(5)", "replay.skip_on", id="replay.skip_on", show=False),
        Binding("up", "scroll_why(-1)", "replay.up", id="replay.up", show=False),
        Binding("down", "scroll_why(1)", "replay.down", id="replay.down", show=False),
        Binding("home", "go(0)", "replay.begin", id="replay.begin", show=False),
        Binding("end", "go(-1)", "replay.end", id="replay.end", show=False),
    ]
    CSS = "ReplayScreen #replay-status, ReplayScreen #time-bar { height: 1; background: $surface; }"

    def __init__(self, playback: Playback, legs: Legs, at_ns: int, now: Clock = time.monotonic_ns) -> None:
        """at_ns: the moment to begin with; now: the clock that playing follows."""
        super().__init__()
        self._playback = playback
        self._legs = legs
        self._now = now
        self._opened_ns = self.at_ns = min(max(at_ns, playback.begin_ns), playback.end_ns)
        self.playing = False
        self.speed = 1.0
        self.moment: Moment | None = None  # as it is drawn
        self._drawn_ns = now()

    def compose(self) -> ComposeResult:
        yield Panel(id="replay-status")
        yield Panel(id="time-bar")
        yield ReplayView(self._playback, self._legs)
        yield from self.compose_bottom()

    def on_mount(self) -> None:
        """Draw the moment, and go on while it plays."""
        super().on_mount()
        self.every(DRAWN_S, self._beat)
        self.fill()

    def on_resize(self) -> None:
        """Other panels fit."""
        if self.composed:
            self.fill()

    def fill(self) -> None:
        """The panels that fit, at the moment."""
        self.query_one(ReplayView).fit_terminal(self.app.size)
        self.call_after_refresh(self.show_moment)

    def on_unmount(self) -> None:
        """Release the file."""
        self._playback.close()

    def _beat(self) -> None:
        """Play on by the time that has passed."""
        now_ns = self._now()
        passed_ns, self._drawn_ns = now_ns - self._drawn_ns, now_ns
        if not self.playing:
            return
        self.at_ns = min(self.at_ns + round(passed_ns * self.speed), self._playback.end_ns)
        self.playing = self.at_ns < self._playback.end_ns
        self.show_moment()

    def show_moment(self) -> None:
        """Draw everything at the moment."""
        if not (self.is_attached and self.composed):  # closed meanwhile, or in another language in a moment
            return
        with self.notify_errors():
            playback, at_ns = self._playback, self.at_ns
            self.moment = moment(playback, at_ns)
            width = self.size.width
            status = replay_status(playback, at_ns, self.speed, playing=self.playing, width=width)
            self.query_one("#replay-status", Panel).lines = (status,)
            self.query_one("#time-bar", Panel).lines = (time_bar(playback, at_ns, max(width, 1)),)
            self.query_one(ReplayView).show(self.moment)

    def go_to(self, at_ns: int) -> None:
        """Show this moment, and stay there."""
        self.playing = False
        self.at_ns = min(max(at_ns, self._playback.begin_ns), self._playback.end_ns)
        self.show_moment()

    def action_play(self) -> None:
        """Play, or stay; at the end from the beginning."""
        if not self.playing and self.at_ns >= self._playback.end_ns:
            self.at_ns = self._playback.begin_ns
        self.playing, self._drawn_ns = not self.playing, self._now()
        self.show_moment()

    def action_step(self, frames: int) -> None:
        """On or back by a film's frame."""
        self.go_to(self.at_ns + frames * SECONDS_NS // FPS)

    def action_skip(self, seconds: int) -> None:
        """On or back by seconds."""
        self.go_to(self.at_ns + seconds * SECONDS_NS)

    def action_jump(self, direction: int) -> None:
        """To what happens next, or happened before."""
        landmarks = self._playback.landmarks
        found = landmarks.next_after(self.at_ns) if direction > 0 else landmarks.newest(self.at_ns - 1)
        if found is not None:
            self.go_to(moment_ns(found))

    def action_record(self) -> None:
        """To the record that was under the trail's cursor."""
        self.go_to(self._opened_ns)

    def action_go(self, end: int) -> None:
        """To the beginning (0) or the end (-1)."""
        self.go_to(self._playback.begin_ns if end == 0 else self._playback.end_ns)

    def action_speed(self, direction: int) -> None:
        """Faster or slower."""
        place = SPEEDS.index(self.speed) + direction
        self.speed = SPEEDS[min(max(place, 0), len(SPEEDS) - 1)]
        self.show_moment()

    def action_page(self) -> None:
        """What the therapist saw, or curves and reasons, where there is no room for both."""
        self.query_one(ReplayView).turn_page()
        self.call_after_refresh(self.show_moment)

    def action_scroll_why(self, rows: int) -> None:
        """More of the reasons."""
        self.query_one(ReplayView).scroll_reasons(3 * rows)


def replay_of(path: Path, record: Record | None) -> tuple[Playback, Legs, int]:
    """A recording, its wearer and the moment of a record: takes some tenths of a second. Raises AppError."""
    playback = Playback(path)
    return playback, Legs(playback, playback.wearer()), moment_ns(record) if record else playback.begin_ns
