"""A program in a pseudo terminal, driven as a person would: keys go in as bytes, its screen comes out as bytes."""

from __future__ import annotations

import fcntl
import os
import pty
import re
import select
import struct
import subprocess
import termios
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from app.system.config import load_config
from app.system.hand_model import set_up_model
from app.system.paths import find_home

LIMIT_S = 60.0
_ESCAPES = re.compile(rb"\x1b\[[0-9;?]*[ -/]*[@-~]|\x1b[()][0-9A-B]|\x1b[=>]")


def configure(home: Path, more: str = "") -> None:
    """The configuration of a home: this machine's hand model, fetched first if it must be, and more in TOML."""
    real = find_home()
    model = set_up_model(real, load_config(real.config))
    (home / "config.toml").write_text(f'model = "{model}"\n{more}', encoding="utf-8")


class PtyProgram:
    """A running program and the newest that it wrote."""

    def __init__(self, command: Sequence[str], environment: Mapping[str, str], columns: int, rows: int) -> None:
        self.master, slave = pty.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
        environment = {**environment, "TERM": "xterm-256color", "COLORTERM": "truecolor"}
        self.started_s = time.monotonic()
        self.child = subprocess.Popen(command, stdin=slave, stdout=slave, stderr=slave, env=environment)
        os.close(slave)
        self._observed = b""

    def wait(self, text: bytes, limit_s: float = LIMIT_S) -> float:
        """Seconds until this text has come since the last key. Raises TimeoutError."""
        begun = time.monotonic()
        while text not in self.seen():
            if time.monotonic() - begun > limit_s:
                raise TimeoutError(f"{text!r} did not appear")
            self._read(0.05)
        return time.monotonic() - begun

    def seen(self) -> bytes:
        """What has come since the last key, without escape sequences."""
        return _ESCAPES.sub(b"", self._observed)

    def press(self, key: bytes) -> None:
        """Forget what was seen, send a key."""
        self._read(0.0)
        self._observed = b""
        os.write(self.master, key)

    def idle(self, seconds: float) -> None:
        """Let it draw."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self._read(0.05)
            self._observed = b""

    def close(self, key: bytes = b"\x03") -> None:
        """Press the key that ends it, and wait for the end; one that stays is ended."""
        os.write(self.master, key)
        end = time.monotonic() + LIMIT_S
        while self.child.poll() is None:
            self._read(0.1)
            if time.monotonic() > end:
                self.child.kill()
        os.close(self.master)

    def _read(self, timeout_s: float) -> None:
        readable, _, _ = select.select([self.master], [], [], timeout_s)
        if readable:
            try:
                self._observed += os.read(self.master, 1 << 20)
            except OSError:
                self._observed += b""  # it has gone
