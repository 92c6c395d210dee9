"""The terminal: STOP out of its input first, its output from a thread of its own, and the end of either."""

from __future__ import annotations

import asyncio
import fcntl
import os
import select
import signal
import struct
import sys
import termios
import threading
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from textual import events
from textual._xterm_parser import XTermParser
from textual.app import App
from textual.driver import Driver
from textual.drivers import linux_driver
from textual.drivers.linux_driver import LinuxDriver
from textual.message import Message

from app.console.charset import substitutes_for
from app.console.input_time import stamp
from app.console.pixels import QUESTION, Answers, PixelTerminal
from app.console.stop import StopSwitch
from app.console.terminal_output import TerminalOutput
from app.system.scheduling import set_scheduling

FULL = 4095  # bytes that a terminal gives at a time (N_TTY_BUF_SIZE); the turn leaves what waits behind them
WIDEST, HIGHEST = 600, 200  # cells; the largest screens with the smallest letters have less
# As Textual's driver writes them when it stops: paste, wrap, mouse, keyboard protocol, screen, cursor, focus.
RESTORE = (
    "\x1b[?2026l\x1b[?2004l\x1b[?7h\x1b[?2048l\x1b[?1000l\x1b[?1003l\x1b[?1015l\x1b[?1006l"
    "\x1b[<u\x1b[?1049l\x1b[?25h\x1b[?1004l"
)
PAINT = "\x1b[?1049h\x1b[?7l\x1b[?25l\x1b[?2004h"  # screen, wrap, cursor, paste: as a shell changes them
_CLOSED = select.POLLHUP | select.POLLERR | select.POLLNVAL


@dataclass(frozen=True, slots=True, kw_only=True)
class TerminalEvents:
    """What the driver reports; each is called from one of its threads."""

    switch: Callable[[], StopSwitch]
    input_alive: Callable[[], object]  # the input thread runs: STOP can be given
    lost: Callable[[], object]  # input or output has ended
    repaint: Callable[[], object]  # frames were dropped, and the terminal reads again
    attached: Callable[[TerminalDriver], object]
    pixels: Callable[[PixelTerminal], object] | None  # the terminal shows pixels; None: do not ask


class InputLoop(threading.Event):
    """The driver's exit event, which its input thread asks at every turn: every 0.1 s without input.

    So it can tell since when what is read next has waited: a process that stood still reads it seconds late.
    """

    def __init__(self, fileno: int, alive: Callable[[], object]) -> None:
        super().__init__()
        self._alive = alive
        self._poller = select.poll()
        self._poller.register(fileno, select.POLLIN)
        self.thread: int | None = None
        self._fileno = fileno
        self._turn_ns = self.input_ns = time.monotonic_ns()  # what is read in this turn was given since `input_ns`
        self._full = False  # in the turn before

    @property
    def asked(self) -> bool:
        """Whether the driver was asked to end its input."""
        return super().is_set()

    def is_set(self) -> bool:
        """Whether to end: asked to, or the terminal has hung up."""
        if self.asked or threading.get_ident() != self.thread:
            return self.asked
        before_ns, self._turn_ns = self._turn_ns, time.monotonic_ns()
        found = [events for _, events in self._poller.poll(0)]
        if any(events & _CLOSED for events in found):
            return True
        before_ns, self._full = self.input_ns if self._full else before_ns, self._waiting() >= FULL
        self.input_ns = before_ns if found else self._turn_ns  # the turn before read all there was then, or was full
        self._alive()
        return False

    def _waiting(self) -> int:
        try:
            return int.from_bytes(fcntl.ioctl(self._fileno, termios.FIONREAD, bytes(4)), sys.byteorder)
        except OSError:  # no terminal, nor a pipe
            return 0


def with_stop(base: type[Driver], switch: Callable[[], StopSwitch]) -> type[Driver]:
    """A driver with STOP taken out of the input before the event loop gets it."""

    class StopDriver(base):  # type: ignore[misc, valid-type]  # the base is known at run time only
        def process_message(self, message: Message) -> None:
            if not switch().takes(message):
                super().process_message(message)

    return StopDriver


def believed(columns: int, rows: int) -> tuple[int, int]:
    """The size that is drawn for a terminal that says this: one that lies would keep the event loop drawing."""
    return min(columns, WIDEST), min(rows, HIGHEST)


def parser_without(answers: Answers) -> type[XTermParser]:
    """A parser of the terminal's input that never sees its answers."""

    class AnswersParser(XTermParser):
        def feed(self, data: str) -> Iterable[Message]:
            rest = answers.take(data) if data else data
            if rest or not data:  # nothing at all means the end
                yield from super().feed(rest)

    return AnswersParser


def _cell_px(fileno: int) -> tuple[int, int]:
    """A cell's width and height as the kernel knows them; zeros where it does not."""
    try:
        size = fcntl.ioctl(fileno, termios.TIOCGWINSZ, bytes(8))
    except OSError:
        return 0, 0
    rows, columns, width_px, height_px = struct.unpack("HHHH", size)
    return width_px // max(1, columns), height_px // max(1, rows)


class TerminalDriver(LinuxDriver):
    """The driver of a terminal; its application has `terminal_events`."""

    def __init__(
        self, app: App[Any], *, debug: bool = False, mouse: bool = True, size: tuple[int, int] | None = None
    ) -> None:
        super().__init__(app, debug=debug, mouse=mouse, size=size)
        self._size = size or self._get_terminal_size()  # until the first resize; else rich asks the terminal
        self._events: TerminalEvents = app.terminal_events  # type: ignore[attr-defined]
        self._input_loop = InputLoop(self.fileno, self._events.input_alive)
        self.exit_event = self._input_loop
        self._output: TerminalOutput | None = None
        self._setting_modes = False  # sequences that set modes of the terminal are never dropped
        self._suspended = False
        self._input_modes: list[Any] | None = None  # of the terminal, while the application mode is on
        self._events.attached(self)

    def process_message(self, message: Message) -> None:
        """STOP is taken here, in the input thread."""
        if isinstance(message, events.Resize) and believed(*message.size) != message.size:  # said by the terminal
            message = events.Resize.from_dimensions(believed(*message.size), message.pixel_size)
        stamp(message, self._input_loop.input_ns)
        if not self._events.switch().takes(message):
            super().process_message(message)

    def _get_terminal_size(self) -> tuple[int, int]:
        """As the system says it."""
        return believed(*super()._get_terminal_size())

    def start_application_mode(self) -> None:
        """As the base, with an output that does not block."""
        assert sys.__stderr__ is not None
        self._output = TerminalOutput(
            sys.__stderr__.fileno(),
            lost=self._events.lost,
            repaint=self._events.repaint,
            substitutes=substitutes_for(os.environ),
        )
        self._setting_modes = True
        super().start_application_mode()  # type: ignore[no-untyped-call]
        if self._events.pixels is not None:
            self.write(QUESTION)
        self._setting_modes = False
        with suppress(termios.error):  # no terminal
            self._input_modes = termios.tcgetattr(self.fileno)

    def stop_application_mode(self) -> None:
        """As the base; no sequence is dropped from here on."""
        self._setting_modes = True
        super().stop_application_mode()

    def suspend_application_mode(self) -> None:
        """As the base."""
        self._suspended = True
        super().suspend_application_mode()

    def resume_application_mode(self) -> None:
        """As the base, once it was suspended; else take the terminal back from the shell.

        The base comes here at every SIGCONT. After a SIGSTOP, which nobody can catch, application mode still runs: a
        second input thread would leave the first in a read that blocks, and no heartbeat would be sent.
        """
        if self._suspended:
            self._suspended = False
            super().resume_application_mode()
            return
        if self._input_modes is not None:
            with suppress(termios.error):
                termios.tcsetattr(self.fileno, termios.TCSANOW, self._input_modes)  # what waits to be read is kept
        with suppress(RuntimeError):  # no event loop yet, or none any more
            asyncio.get_running_loop().call_soon_threadsafe(self._paint_again)

    def _paint_again(self) -> None:
        self.write(PAINT, droppable=False)
        self._events.repaint()

    def write(self, data: str, *, droppable: bool = True) -> None:
        """Queue it; never blocks."""
        if self._output is not None:
            self._output.write(data, droppable=droppable and not self._setting_modes)

    def close(self) -> None:
        """Write what is queued, for a moment."""
        output, self._output = self._output, None
        if output is not None:
            output.close()
        super().close()

    def run_input_thread(self) -> None:
        """As the base, and report when the input ends unasked."""
        if self.input_tty:  # a file at its end is ready all the time
            set_scheduling("heartbeat")  # STOP comes through here
        self._input_loop.thread = threading.get_ident()
        if self._events.pixels is not None:
            # The base makes its parser itself, by this name.
            linux_driver.XTermParser = parser_without(Answers(self._events.pixels, _cell_px(self.fileno)))  # type: ignore[attr-defined]
        try:
            with suppress(OSError):  # EIO: hung up while it was read
                super().run_input_thread()
        finally:
            if not self._input_loop.asked:
                self._events.lost()

    def restore(self) -> None:
        """Restore modes and screen, as far as the terminal takes it in a moment. From any thread but the main one."""
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTTOU})  # in the background, it would stop us
        output, self._output = self._output, None
        if output is None:  # it is restored
            return
        if self.attrs_before is not None:
            with suppress(termios.error):
                termios.tcsetattr(self.fileno, termios.TCSANOW, self.attrs_before)
        output.write(RESTORE, droppable=False)
        output.close()
