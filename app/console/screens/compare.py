"""Compare: the session's camera beside a second one that only looks, or beside its own depth; a ruler; a table."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from threading import Thread
from typing import ClassVar

import msgspec
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal
from textual.widgets import Input, Label

from app.console import keys
from app.console.patient_fields import half_width
from app.console.screens.hand_keys import HandKeys
from app.console.state import SessionState
from app.console.widgets.comparison import FrameCount, camera_lines, no_image_lines, own_depth_lines, table_lines
from app.console.widgets.panel import Panel, plain
from app.console.widgets.picture import Picture
from app.ipc.messages import HandCommand, Preview, TriggerReport
from app.perception.camera_names import parse_camera, refuse_same_device
from app.perception.comparison import Comparison, comparison_record
from app.perception.look import Looker, LookFault
from app.system.config import SessionSetup
from app.system.errors import AppError
from app.text.catalogue import tr
from logs.reading.errors import cause_of
from logs.reason import Reason

POLL_S = 0.1
SILENT_S = 2.0  # the second camera's process yields to the session: on a busy machine its images come late and seldom
LONGEST_CM = 200.0
_OWN = {"2", "r"}  # keys of the hand that mean something else here


class CompareScreen(HandKeys):
    """Opened over a session, which goes on beneath.

    What may take long (to open or end a camera's process, to write) is done in threads: the console's heartbeat
    must not wait for it.
    """

    HELP_PAGE = "compare"
    AUTO_FOCUS = ""
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape,v", "back", "bind.cancel"),
        Binding("2", "go_to('#second')", "bind.compare.second", priority=True),
        Binding("r", "go_to('#ruler')", "bind.compare.ruler", priority=True),
        *(binding for binding in keys.HAND if binding.key not in _OWN),
    ]

    def __init__(self) -> None:
        super().__init__()
        self._sequence = -1
        self._count = FrameCount()
        self._looker: Looker | None = None
        self._setup: SessionSetup | None = None  # of the session that is compared
        self._received_s = 0.0  # when the second camera gave something last
        self._source = ""
        self._comparison = Comparison(threshold_m=0.0)
        self._refused = False  # the table could not be written: the next time it is given up
        self._busy = asyncio.Lock()

    def compose(self) -> ComposeResult:
        yield Panel(id="status")
        with Horizontal(id="pictures"):
            yield Picture(id="picture")
            yield Picture(id="other")
        with Horizontal(id="compared"):
            yield Label(tr("compare.second"), markup=False)
            yield Input(placeholder=tr("compare.example"), id="second", compact=True)
            yield Label(tr("compare.ruler"), markup=False)
            yield Input(id="ruler", compact=True)
        with Horizontal(id="columns"):
            yield Panel(id="monocular", title=tr("compare.first"))
            yield Panel(id="depth", title=tr("compare.depth"))
        yield Panel(id="running")
        yield from self.compose_bottom()

    def on_mount(self) -> None:
        """Ask for what the second camera sees, once there is one."""
        self.fill()
        self.every(POLL_S, self._receive)

    def fill(self) -> None:
        """Without a second camera there is one picture."""
        self._show_second()

    def on_unmount(self) -> None:
        """A session that ends beneath ends the comparison, too."""
        self._give_up(lambda *table: Thread(target=_write_if_possible, args=table, name="table", daemon=True).start())

    def discard(self) -> None:
        """The table is written here: a thread would end with the program."""
        self._give_up(_write_if_possible)

    def _give_up(self, write: Callable[[Path, str], object]) -> None:
        if self._looker is not None:
            path, table = self._path(), self._comparison.as_csv()
            self.console_app.trail.emit(comparison_record(self._comparison, path.name))
            write(path, table)
            self._end_looker()

    def follow(self, state: SessionState) -> None:
        self.query_one("#status", Panel).lines = (plain(tr("compare.text"), "$text-muted"),)
        if state.report is None:
            return
        if state.report.sequence != self._sequence:
            self._take(state.report)
        elif not state.report_fresh:
            for name in ("monocular",) if self._looker is not None else ("monocular", "depth"):
                self.query_one(f"#{name}", Panel).lines = no_image_lines()

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """A second camera's name, or the ruler's centimetres."""
        if event.input.id == "ruler" and not self._set_ruler(event.value):
            return  # it stays to be corrected; keys that followed would move the hand
        self.set_focus(None)
        if event.input.id == "second":
            self.run_worker(self._open(event.value.strip()))

    def action_back(self) -> None:
        """To the session; what was compared is kept."""
        self.run_worker(self._leave())

    async def _leave(self) -> None:
        if await self._end_comparison():
            self.dismiss()

    async def _open(self, source: str) -> None:
        """A second camera in place of an earlier one; an empty name: none."""
        if not await self._end_comparison():
            return
        async with self._busy:
            with self.notify_errors():
                if source:
                    await self._begin(source)
        if not self.is_attached:
            self._end_looker()
        elif self.composed:  # else `fill` does it
            self._show_second()

    async def _begin(self, source: str) -> None:
        """Compare with this camera. Raises CodedError when there is none of this name."""
        setup = self._setup = self.console_app.live_setup()
        camera, used = parse_camera(source, setup.config.camera)
        await asyncio.to_thread(refuse_same_device, setup.config.camera, camera)
        self._source = source
        self._comparison = Comparison(threshold_m=setup.profile.press_threshold_m, ruler_m=self._comparison.ruler_m)
        self._count = FrameCount()
        second = msgspec.structs.replace(
            setup,
            config=msgspec.structs.replace(setup.config, camera=camera),
            profile=msgspec.structs.replace(setup.profile, distance_source=used),
        )
        self._looker = await asyncio.to_thread(Looker, second)
        self._received_s = time.monotonic()
        if self.console_app.has_digital_hand:
            self._looker.move_hand(self.console_app.live_session().hand)

    def _move(self, command: HandCommand) -> None:
        super()._move(command)
        if self._looker is not None:
            self._looker.move_hand(command)

    def _show_second(self) -> None:
        """Its picture and the table, where there is one."""
        looks = self._looker is not None
        for part in ("#other", "#running"):
            self.query_one(part).display = looks
        if looks:
            self.query_one("#other", Picture).show_text(tr("picture.waiting"))
        self.query_one("#depth", Panel).border_title = self._source if looks else tr("compare.depth")

    def _set_ruler(self, typed: str) -> bool:
        """Whether it is a distance."""
        try:
            cm = float(half_width(typed).replace(",", ".")) if typed.strip() else 0.0
        except ValueError:
            cm = -1.0
        if not 0 <= cm <= LONGEST_CM:
            self.notify(tr("compare.no_ruler", longest=LONGEST_CM), severity="error", markup=False)
            return False
        self._comparison.ruler_m = cm / 100 if cm else None
        return True

    def _receive(self) -> None:
        if self._looker is None:
            return
        other = self.query_one("#other", Picture)
        for message in self._looker.receive():
            self._received_s = time.monotonic()
            if isinstance(message, Preview):
                other.show_preview(message)
            elif isinstance(message, Reason):
                self._comparison.faults[1] = message
                other.show_text(tr("picture.stale"))
            else:
                self._comparison.take(1, message)
        column, table = self.query_one("#depth", Panel), self.query_one("#running", Panel)
        reported = self._comparison.newest[1] is None or self._comparison.faults[1] is not None
        silent = not reported and time.monotonic() - self._received_s > SILENT_S
        width = max(10, column.content_size.width)
        column.lines = no_image_lines() if silent else camera_lines(self._comparison, 1, width)
        table.lines = table_lines(self._comparison, *table.content_size)

    def _take(self, report: TriggerReport) -> None:
        self._sequence = report.sequence
        self._comparison.threshold_m = report.threshold_m
        if sample := self._count.take(report):
            self._comparison.take(0, sample)
        self._comparison.faults[0] = report.camera_fault
        first, second = (self.query_one(f"#{name}", Panel) for name in ("monocular", "depth"))
        width = max(10, first.content_size.width)
        first.lines = camera_lines(self._comparison, 0, width)
        if self._looker is None:
            second.lines = own_depth_lines(report, self._comparison.ruler_m, width)

    async def _end_comparison(self) -> bool:
        """Keep what was compared and let the second camera go; False: it could not be kept, and stays for now.

        Asked again, the table is given up: the trail still takes the totals.
        """
        async with self._busy:
            looker = self._looker
            if looker is None:
                return True
            path, kept = self._path(), False
            with self.notify_errors():
                await asyncio.to_thread(_write, path, self._comparison.as_csv())
                kept = True
            if self._looker is not looker:  # given up meanwhile
                return True
            if kept:
                self.notify(tr("compare.kept", path=path), markup=False)
            elif not self._refused:
                self._refused = True
                return False
            self._refused = False
            self.console_app.trail.emit(comparison_record(self._comparison, path.name if kept else ""))
            self._end_looker()
            return True

    def _path(self) -> Path:
        """Where the table goes."""
        assert self._setup is not None
        now = time.strftime("%H%M%S", time.gmtime())
        return Path(self._setup.home) / "comparisons" / f"{self._setup.session}-{now}.csv"

    def _end_looker(self) -> None:
        looker, self._looker = self._looker, None
        if looker is not None:
            Thread(target=looker.close, name="end of a camera", daemon=True).start()


def _write(path: Path, table: str) -> None:
    """The whole table or nothing. Raises AppError when the disk refuses."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(table, encoding="utf-8")
    except OSError as error:
        with suppress(OSError):
            path.unlink(missing_ok=True)
        raise AppError(LookFault.NOT_KEPT, path=path, detail=cause_of(error)) from error


def _write_if_possible(path: Path, table: str) -> None:
    """Where nobody is left to be told."""
    with suppress(AppError):
        _write(path, table)
