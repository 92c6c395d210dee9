"""A session under the real console: `rleex run` in a pseudo terminal of 80×24, led by keys and in use meanwhile.

Between the keys that lead the legs a busy therapist types: help, checks, themes, the digital hand's signs and clicks.
"""

from __future__ import annotations

import os
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import cycle
from pathlib import Path

from app.console.keys import GESTURE_KEYS
from app.ipc.messages import OperatorKind
from app.ipc.states import ACTION_OF, Action
from app.system.config import load_config
from app.system.hand_model import find_model
from app.system.paths import find_home
from testing.session import PATIENCE_S, WatchedSession
from tools.bench_console import Terminal

ESCAPE = b"\x1b"
KEYS = {
    OperatorKind.CONFIRM_PATIENT: b"cy",
    OperatorKind.ACKNOWLEDGE: b"ky",
    OperatorKind.TORQUE_OFF: b"oy",
}
ACTION_KEYS = {ACTION_OF[gesture]: b"t" + key.encode() for key, gesture in GESTURE_KEYS.items()}
BETWEEN_KEYS_S = 0.25  # as a person types; long enough for a dialog to open
# One a second: help and out, checks and out, the hand signs, clicks, moves and rests, the next theme.
IDLE_KEYS = (b"\x1bOP", ESCAPE, b"s", ESCAPE, b"5", b"\r", b"\x1b[C", b"\x1b[D", b"h", b"\x1bOQ")
IDLE_PERIOD_S = 1.0


class ConsoleSession(WatchedSession):
    """Its words are keys. A thread takes what the console draws, as fast as a terminal does."""

    def __init__(self, terminal: Terminal, links: Path) -> None:
        super().__init__(links)
        self._terminal = terminal
        self._idle_keys = cycle(IDLE_KEYS)
        self._typed_s = time.monotonic()
        self.keys = 0
        self._ending = threading.Event()
        self._drawing = threading.Thread(target=self._draw, daemon=True)
        self._drawing.start()

    def send(self, kind: OperatorKind, action: Action | None = None) -> None:
        """Leave whatever dialog is open, and type the word."""
        keys = KEYS[kind] if action is None else ACTION_KEYS[action]
        for key in (ESCAPE, *(bytes([key]) for key in keys)):
            self._type(key)
            self._ending.wait(BETWEEN_KEYS_S)

    def look(self, wait_s: float = 0.02) -> None:
        """Take the newest of everything, and type on."""
        super().look(wait_s)
        if time.monotonic() - self._typed_s >= IDLE_PERIOD_S:
            self._type(next(self._idle_keys))

    def end(self) -> None:
        """Look and draw no more."""
        self._ending.set()
        self._drawing.join()
        self.close_links()

    def _type(self, key: bytes) -> None:
        os.write(self._terminal.master, key)
        self._typed_s = time.monotonic()
        self.keys += 1

    def _draw(self) -> None:
        while not self._ending.is_set():
            self._terminal.idle(0.1)


@contextmanager
def console_session(home: Path) -> Iterator[ConsoleSession]:
    """A console with its session, both ended whatever happens."""
    model = find_model(find_home(), load_config(find_home().config))
    (home / "config.toml").write_text(f'model = "{model}"\n', encoding="utf-8")
    with tempfile.TemporaryDirectory(prefix="bench-") as sockets:
        terminal = Terminal(home, 80, 24, os.environ | {"TMPDIR": sockets})
        try:
            terminal.wait(b"STOP")
            session = ConsoleSession(terminal, _links_in(Path(sockets), terminal))
            try:
                session.until(lambda _: True, "control's first word")
                yield session
            finally:
                session.end()
        finally:
            terminal.close()


def _links_in(folder: Path, terminal: Terminal) -> Path:
    """Where the session's sockets are. Raises TimeoutError."""
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        terminal.idle(0.05)
        for links in folder.glob("rleex-*"):
            return links
    raise TimeoutError("the console began no session")
