"""The review screen: a session as lanes over time, one moment in detail, the verifier's finding, comments."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import ClassVar

from rich.text import Text
from textual import on, work
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, VerticalScroll
from textual.message import Message
from textual.widgets import Static

from app.console.review_data import ReviewedSession, comments_on, open_session, write_comment
from app.console.screens.base import ConsoleScreen
from app.console.screens.review_dialogs import ChooseSession, WriteComment, sessions_of
from app.console.widgets.timeline import Timeline, about
from app.system.operators import Permission
from app.system.paths import Home
from app.text.catalogue import render, tr
from app.text.recorded import render_recorded
from logs.errors import AuditError
from logs.findings import Finding, verdict
from logs.keys import by_fingerprint, known_keys, read_anchors
from logs.read import find_session
from logs.reason import Reason, sanitize_terminal, text_of
from logs.records import Comment, Record
from logs.show import line_of
from logs.verify import Evidence, verify


class RecordList(Static):
    """The records around the cursor, as many as there is room for."""

    class Resized(Message):
        """There is other room."""

    def on_resize(self) -> None:
        """Have it filled anew."""
        self.post_message(self.Resized())


class ReviewScreen(ConsoleScreen):
    """One session; without a name it asks which."""

    HELP_PAGE = "review"
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape", "close", "reviewing.close", id="review.close"),
        Binding("left", "move(-1)", "reviewing.left", id="review.left"),
        Binding("right", "move(1)", "reviewing.right", id="review.right"),
        Binding("up", "step(-1)", "reviewing.up", id="review.up"),
        Binding("down", "step(1)", "reviewing.down", id="review.down"),
        Binding("n", "jump(1)", "reviewing.next", id="review.next"),
        Binding("p", "jump(-1)", "reviewing.previous", id="review.previous"),
        Binding("plus,equals_sign", "zoom(0.5)", "reviewing.zoom_in", id="review.zoom_in"),
        Binding("minus", "zoom(2.0)", "reviewing.zoom_out", id="review.zoom_out"),
        Binding("home", "go(0)", "reviewing.begin", id="review.begin"),
        Binding("end", "go(-1)", "reviewing.end", id="review.end"),
        Binding("c", "comment", "reviewing.write", id="review.write"),
        Binding("r", "replay", "reviewing.replay", id="review.replay"),
    ]
    CSS = """
    ReviewScreen #verdict { height: auto; max-height: 6; background: $panel; }
    ReviewScreen #below { height: 1fr; }
    ReviewScreen #records { width: 2fr; height: 100%; text-wrap: nowrap; text-overflow: ellipsis; }
    ReviewScreen #moment { width: 1fr; height: 100%; border-left: solid $secondary; padding: 0 1; }
    ReviewScreen.-narrow #moment { display: none; }
    """

    def __init__(self, home: Home, session: str | None = None) -> None:
        """session: a path, a name or its beginning, or "last"; None: ask."""
        super().__init__()
        self._home = home
        self._name = session
        self.session: ReviewedSession | None = None  # on the screen
        self.index = 0  # of the record at the cursor
        self._comments: dict[int, list[Comment]] = {}
        self._hidden: tuple[Reason, ...] = ()  # why other comments are not shown
        self._finding: Finding | None = None

    def compose(self) -> ComposeResult:
        yield Static("", id="verdict", markup=False)
        yield Timeline()
        with Horizontal(id="below"):
            yield RecordList("", id="records", markup=False)
            with VerticalScroll(id="moment", can_focus=False):
                yield Static("", id="instant", markup=False)
        yield from self.compose_bottom()

    def on_mount(self) -> None:
        """Open the named session, or ask."""
        super().on_mount()
        if self._name is None:
            self._ask()
        else:
            self._open_named(self._name)

    @work(exclusive=True)
    async def _ask(self) -> None:
        found = await asyncio.to_thread(sessions_of, self._home.logs)
        await self.on_top()
        if not found:
            self.notify(tr("reviewing.none"))
            self.call_later(self.action_close)
            return
        self.app.push_screen(ChooseSession(found), self._chosen)

    def _chosen(self, path: Path | None) -> None:
        if path is None:
            self.action_close()
        else:
            self._load(path)

    def _open_named(self, name: str) -> None:
        try:
            self._load(find_session(self._home.logs, name))
        except AuditError as error:
            self.notify(render(error), severity="error", markup=False)
            self.call_later(self.action_close)

    @work(exclusive=True)
    async def _load(self, path: Path) -> None:
        self.query_one("#verdict", Static).update(tr("reviewing.opens", session=sanitize_terminal(path.stem)))
        with self.notify_errors():
            self._finding = None
            session = await asyncio.to_thread(open_session, path)
            evidence = self._evidence()
            self._comments, self._hidden = await asyncio.to_thread(comments_on, session, evidence)
            self.session = session  # last: a key that moved the cursor before it is set would be undone
            self.query_one(Timeline).show(self.session)
            self._go_to(0)
            self.query_one("#verdict", Static).update(f"{sanitize_terminal(path.stem)}: {tr('reviewing.verifying')}")
            (self._finding,) = await asyncio.to_thread(verify, [path], evidence)
            self._show_verdict()

    def fill(self) -> None:
        """The session that is open, at the record that is shown."""
        if self.session is not None:
            self.query_one(Timeline).show(self.session)
            self._go_to(self.index)
            self._show_verdict()

    def _show_verdict(self) -> None:
        if self._finding is not None:
            text = verdict(self._finding, render_recorded)
            for why in self._hidden:
                text.append(f"\n {sanitize_terminal(text_of(why, render_recorded))}", "bold red")
            if self.session is not None and (host := self.session.joints_host):
                elsewhere = tr("outcomes.other_computer", session=self.session.path.stem, host=host)
                text.append(f"\n {sanitize_terminal(elsewhere)}")
            self.query_one("#verdict", Static).update(text)

    def _evidence(self) -> Evidence:
        keys = self._home.keys
        return Evidence(keys=by_fingerprint(known_keys(keys)), anchors=read_anchors(keys))

    def action_close(self) -> None:
        """Leave."""
        self.dismiss(None)

    def action_move(self, columns: int) -> None:
        """Move by columns of the timeline."""
        if self.session is not None:
            at_s = self.session.time(self.index) + columns * self.query_one(Timeline).column_s
            index = self.session.index_at(at_s)
            self._go_to(index if index != self.index else self.index + columns)

    def action_step(self, records: int) -> None:
        """Move by records."""
        self._go_to(self.index + records)

    def action_jump(self, direction: int) -> None:
        """To the next event, STOP, refusal, cancel, acknowledgement or command, or the one before."""
        if self.session is None:
            return
        find = self.session.landmark_after if direction > 0 else self.session.landmark_before
        index = find(self.index)
        if index is not None:
            self._go_to(index)

    def action_go(self, end: int) -> None:
        """To the first record (0) or the last (-1)."""
        if self.session is not None:
            self._go_to(0 if end == 0 else len(self.session) - 1)

    def action_zoom(self, factor: float) -> None:
        """Show more or less time."""
        self.query_one(Timeline).zoom(factor)

    async def action_comment(self) -> None:
        """Write a signed comment on the record at the cursor."""
        if self.session is None or not isinstance(self.session.record(self.index), Record):
            return
        app, index = self.console_app, self.index
        await app.permitted(Permission.REVIEW, lambda: app.push_screen(WriteComment(index), self._commented))

    @work(exclusive=True, group="replay")  # the default group's would end with it: opening, verifying
    async def action_replay(self) -> None:
        """The recording at the record under the cursor, where there is one."""
        if self.session is None:
            return
        from app.console.screens.replay import ReplayScreen, replay_of  # OpenCV and MCAP: only for who asks for it
        from app.system.paths import recording_path

        path = recording_path(self.session.path.parent, self.session.path.stem)
        if not path.exists():
            self.notify(tr("replay.none"), severity="warning", timeout=15)
            return
        record = self.session.record(self.index)
        with self.notify_errors():
            self.notify(tr("reviewing.opens", session=sanitize_terminal(path.name)), timeout=2)
            found = await asyncio.to_thread(replay_of, path, record if isinstance(record, Record) else None)
            await self.on_top()
            self.app.push_screen(ReplayScreen(*found))

    @on(Timeline.Moved)
    def _moved(self, message: Timeline.Moved) -> None:
        if self.session is not None:
            self._go_to(self.session.index_at(message.at_s))

    @on(RecordList.Resized)
    def _fill_list(self) -> None:
        """Fill the list's new height."""
        if self.session is not None:
            self._go_to(self.index)

    async def _commented(self, text: str | None) -> None:
        session = self.session
        if session is None or not text:
            return
        record = session.record(self.index)
        if not isinstance(record, Record):
            return
        with self.notify_errors():
            await asyncio.to_thread(write_comment, self.console_app.authority, session.path, record, text)
            self._comments, self._hidden = await asyncio.to_thread(comments_on, session, self._evidence())
            self._go_to(self.index)
            self._show_verdict()

    def _go_to(self, index: int) -> None:
        if self.session is None:
            return
        self.index = min(max(index, 0), len(self.session) - 1)
        instant = self.session.instant(self.index)
        self.query_one(Timeline).cursor_s = instant.at_s
        self.query_one("#records", Static).update(self._list(self.session))
        self.query_one("#instant", Static).update(about(instant, self._comments.get(self.index, [])))

    def _list(self, session: ReviewedSession) -> Text:
        height = max(self.query_one("#records", Static).size.height, 3)
        before = height // 2
        lines = []
        for index in session.around(self.index, before, height - before - 1):
            line = Text("✎" if index in self._comments else " ", "bold")
            line.append_text(line_of(session.record(index), render_recorded))
            if index == self.index:
                line.stylize("reverse")
            lines.append(line)
        return Text("\n").join(lines)
