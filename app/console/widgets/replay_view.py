"""A moment of a recording in the session's own panels, with the hand's keypoints, curves over time, and the reasons."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import ClassVar

from rich.text import Text
from textual.app import ComposeResult
from textual.containers import Container, VerticalScroll
from textual.geometry import Size
from textual.widgets import Static

from app.console.state import SessionState
from app.console.widgets.curves import draw_joints, joint_fault
from app.console.widgets.figure import View, draw
from app.console.widgets.gait import gait_lines
from app.console.widgets.gesture import distance_lines, gesture_lines
from app.console.widgets.panel import DrawnPanel, Lines, Panel, plain
from app.console.widgets.replay import curves_of, draw_picture, draw_skeleton, note_at, push_of
from app.console.widgets.status import event_lines
from app.console.widgets.wearer import goal_of
from app.ipc.snapshot import coming
from app.ipc.streams import LinkDirectory
from app.playback.film import WINDOW_NS
from app.playback.moment import Moment, joints_over, reports_between
from app.playback.session import Playback, moment_ns
from app.playback.view import Legs, clock
from app.system.config import Config, SessionSetup
from app.text.catalogue import tr
from app.text.recorded import render_recorded
from logs.explain.hops import explain
from logs.explain.text import lines as explained

ACROSS_COLUMNS = 130  # from here on there is room for three beside each other
ROWS_FOR_ALL = 44  # with fewer, and not across, two pages take turns
LANDMARKS_NS = 60_000_000_000


class ReplayView(Container):
    """Everything of one moment. In small terminals a page of what the therapist saw, and one of curves and reasons."""

    SCOPED_CSS: ClassVar[bool] = False  # the screen's breakpoints stand outside
    DEFAULT_CSS = """
    ReplayView {
        layout: grid; height: 1fr; grid-size: 2 3; grid-columns: 1fr 1fr; grid-rows: 1fr 1fr 1fr; grid-gutter: 0 1;
    }
    ReplayView > * { width: 100%; height: 100%; }
    ReplayView #why { scrollbar-size: 1 1; }
    ReplayView.-first, ReplayView.-second { grid-size: 2 2; grid-rows: 1fr 1fr; }
    ReplayView.-first #curves, ReplayView.-first #why { display: none; }
    ReplayView.-second { grid-size: 2 1; grid-rows: 1fr; }
    ReplayView.-second #skeleton, ReplayView.-second #figure { display: none; }
    ReplayView.-second #hand-now, ReplayView.-second #legs-now { display: none; }
    ReplayView.-across { grid-size: 3 2; grid-columns: 4fr 4fr 5fr; grid-rows: 6fr 5fr; }
    .-tall ReplayView #skeleton, .-tall ReplayView #curves, .-tall ReplayView #why {
        border: round $secondary; border-title-color: $primary; padding: 0 1;
    }
    """

    def __init__(self, playback: Playback, legs: Legs) -> None:
        super().__init__(id="replay")
        self._playback = playback
        self._legs = legs
        self._setup = SessionSetup(
            session=playback.name,
            home=Path(),
            links=LinkDirectory(path=Path(), public=b"", secret=b""),
            config=Config(),
            profile=playback.profile(),
            operator="",
        )
        self._why: tuple[int, tuple[str, ...]] = (-1, ())

    @property
    def reasons(self) -> tuple[str, ...]:
        """When the newest record came about, and why."""
        return self._why[1]

    def compose(self) -> ComposeResult:
        yield DrawnPanel(id="skeleton", title=tr("replay.hand"))
        yield DrawnPanel(id="figure", title=tr("panel.figure"))
        yield DrawnPanel(id="curves", title=tr("panel.joints"))
        with Container(id="hand-now"):
            yield Panel(id="gesture", title=tr("panel.gesture"))
            yield DrawnPanel(id="distance", title=tr("panel.distance"))
        with Container(id="legs-now"):
            yield DrawnPanel(id="gait", title=tr("panel.gait"))
            yield Panel(id="events", title=tr("panel.events"))
        with VerticalScroll(id="why", can_focus=False) as why:
            why.border_title = tr("replay.why")
            yield Static("", id="why-text", markup=False)

    def fit_terminal(self, size: Size) -> None:
        """What fits into a terminal of this size."""
        across = size.width >= ACROSS_COLUMNS
        paged = size.height < ROWS_FOR_ALL and not across
        self.set_class(across, "-across")
        self.set_class(paged and not self.has_class("-second"), "-first")
        self.set_class(paged and self.has_class("-second"), "-second")
        order = ("skeleton", "figure", "curves", "hand-now", "legs-now", "why")
        if not across:
            order = ("skeleton", "figure", "hand-now", "legs-now", "curves", "why")
        for before, after in pairwise(order):
            self.move_child(self.query_one(f"#{after}"), after=self.query_one(f"#{before}"))

    def turn_page(self) -> None:
        """The other page, where there are two."""
        if self.has_class("-first") or self.has_class("-second"):
            self.toggle_class("-first", "-second")

    def show(self, now: Moment) -> None:
        """Draw it."""
        self._draw(now)
        self._explain(now.at_ns)

    def scroll_reasons(self, rows: int) -> None:
        """More of the reasons."""
        self.query_one("#why", VerticalScroll).scroll_relative(y=rows, animate=False)

    def _draw(self, now: Moment) -> None:
        playback, at_ns = self._playback, now.at_ns
        landmarks = playback.landmarks.between(at_ns - LANDMARKS_NS, at_ns)
        state = SessionState(
            setup=self._setup,
            started_ns=playback.begin_ns,
            now_ns=at_ns,
            snapshot=now.snapshot,
            report=now.report,
            press_note=note_at(landmarks, at_ns),
        )
        hand = draw_picture(now.picture_jpeg, *self._room("skeleton")) if now.picture_jpeg else None
        self._lines("skeleton", hand or draw_skeleton(now.hand_m, *self._room("skeleton")))
        self._lines("figure", self._figure(now))
        gesture = self.query_one("#gesture", Panel)
        gesture.lines = gesture_lines(state, gesture.content_size.width)
        push = push_of(reports_between(playback, at_ns - WINDOW_NS, at_ns), landmarks)
        width, height = self._room("distance")
        self._lines("distance", distance_lines(state, max(width, 10), height, push))
        self._lines("gait", gait_lines(state, *self._room("gait")))
        panel = self.query_one("#events", Panel)
        panel.lines = event_lines(state)
        panel.set_class(not panel.lines, "-quiet")
        self._lines("curves", self._curves(now))

    def _curves(self, now: Moment) -> Lines:
        if now.snapshot is None:
            return (plain(tr("joints.waiting"), "$foreground-muted"),)
        curves = curves_of(*joints_over(self._playback, now.at_ns - WINDOW_NS, now.at_ns), now.at_ns)
        return draw_joints(now.snapshot, curves, self._legs.wearer.joints, *self._room("curves"))

    def _figure(self, now: Moment) -> Lines:
        pose, wearer, snapshot = self._legs.at(now), self._legs.wearer, now.snapshot
        if pose is None or snapshot is None:
            return (plain(tr("joints.waiting"), "$foreground-muted"),)
        goal = goal_of(wearer, coming(snapshot, now.report), snapshot)
        pairs = zip(snapshot.joints, wearer.joints, strict=True)
        view = View(
            body=wearer.body,
            pose=pose,
            ghost=self._legs.footing.pose(wearer, goal) if goal is not None else None,
            scene=self._legs.footing.scene,
            torque=tuple(abs(joint.torque_nm) / device.max_torque_nm for joint, device in pairs),
            alarm=tuple(bool(joint_fault(joint)) for joint in snapshot.joints),
        )
        return draw(view, *self._room("figure"))

    def _explain(self, at_ns: int) -> None:
        """Why the newest record came about, as `rleex audit explain` says it."""
        record = self._playback.landmarks.newest(at_ns)
        number = record.sequence if record is not None else -1
        if number == self._why[0]:
            return
        text: tuple[str, ...] = ()
        if record is not None:
            when = clock(self._playback.seconds(moment_ns(record)))
            text = (when, *explained(explain(self._playback.records, record.sequence), render_recorded))
        self._why = (number, text)
        self.query_one("#why-text", Static).update(Text("\n".join(text) or tr("replay.nothing_yet")))
        self.query_one("#why", VerticalScroll).scroll_home(animate=False)

    def _room(self, panel: str) -> tuple[int, int]:
        size = self.query_one(f"#{panel}", DrawnPanel).content_size
        return size.width, size.height

    def _lines(self, panel: str, lines: Lines) -> None:
        self.query_one(f"#{panel}", DrawnPanel).lines = lines
