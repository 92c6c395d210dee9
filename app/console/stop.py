"""STOP from the keyboard: sent from the terminal's input thread, so that a busy event loop can't delay it.

The first press is sent at once. A key held down repeats by itself, and a second STOP lets the legs go soft; so a
press that follows within a second waits for a moment of silence, which a repeating key never leaves. Of a double click
the first one counts.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from textual import events
from textual.geometry import Region
from textual.message import Message

# Terminals begin to repeat a held key after 0.2-0.7 s and then go on at 15-50 Hz; hands tap no faster than 7 Hz.
REPEAT_BEGINS_NS = 1_000_000_000
REPEAT_GAP_NS = 120_000_000
DOUBLE_CLICK_NS = 500_000_000  # the usual limit of desktops


class Press(Enum):
    """What to do with one arrival of the STOP key, or a click."""

    SEND = "send"
    WAIT = "wait"  # a second press, or the first repetition: silence will tell
    DROP = "drop"  # one of many: what waited was a repetition too


@dataclass(frozen=True, slots=True, kw_only=True)
class StopKeyState:
    """The key's recent past."""

    last_ns: int | None = None
    waits: bool = False  # the last one was neither the first nor known to be deliberate


def press(state: StopKeyState, now_ns: int) -> tuple[StopKeyState, Press]:
    """The state after an arrival of the key, and what to do with it."""
    gap_ns = None if state.last_ns is None else now_ns - state.last_ns
    if gap_ns is None or gap_ns >= REPEAT_BEGINS_NS:
        return StopKeyState(last_ns=now_ns), Press.SEND
    if gap_ns < REPEAT_GAP_NS and state.waits:
        return StopKeyState(last_ns=now_ns, waits=True), Press.DROP
    return StopKeyState(last_ns=now_ns, waits=True), Press.WAIT


def click(state: StopKeyState, now_ns: int) -> tuple[StopKeyState, Press]:
    """As `press`, after a click on the bar: one so soon after another, or after the key, belongs to it."""
    if state.last_ns is not None and now_ns - state.last_ns < DOUBLE_CLICK_NS:
        return state, Press.DROP
    return StopKeyState(last_ns=now_ns), Press.SEND


class StopSwitch:
    """Turns presses into STOPs. Every method may be called from any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._state = StopKeyState()
        self._timer: threading.Timer | None = None
        self._send: Callable[[], object] | None = None
        self.keys: frozenset[str] = frozenset({"space"})
        self.region = Region()  # of the STOP bar on the screen
        self.sent_ns = 0
        self.left_on = False  # the last session ended, and nobody has seen its drives off

    @property
    def live(self) -> bool:
        """Whether there is anything to stop."""
        return self._send is not None

    def connect(self, send: Callable[[], object] | None) -> None:
        """Say where STOP goes; None: no session."""
        with self._lock:
            self._send = send
            self._state = StopKeyState()
            self.sent_ns = 0

    def press_key(self) -> bool:
        """The STOP key has arrived; False when no session listens."""
        with self._lock:
            if self._send is None:
                return False
            if self._timer is not None:
                self._timer.cancel()
                self._timer = None
            self._state, decision = press(self._state, time.monotonic_ns())
            if decision is Press.WAIT:
                self._timer = threading.Timer(REPEAT_GAP_NS / 1e9, self.stop)
                self._timer.daemon = True
                self._timer.start()
        if decision is Press.SEND:
            self.stop()
        return True

    def click(self) -> bool:
        """The bar was clicked; False when no session listens."""
        with self._lock:
            if self._send is None:
                return False
            self._state, decision = click(self._state, time.monotonic_ns())
        if decision is Press.SEND:
            self.stop()
        return True

    def stop(self) -> None:
        """Send STOP now: a first one, or a confirmed second one."""
        send = self._send
        if send is None:
            return
        send()
        self.sent_ns = time.monotonic_ns()

    def takes(self, message: Message) -> bool:
        """Whether this input was STOP; called in the terminal's input thread, before anything else sees it."""
        if isinstance(message, events.Key) and message.key in self.keys:
            return self.press_key()
        clicked = isinstance(message, events.MouseDown) and self.region.contains(message.screen_x, message.screen_y)
        return clicked and self.click()
