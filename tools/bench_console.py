"""What the console costs, with the real processes running: first paint, key to reaction, CPU, memory.

`python tools/bench_console.py [--seconds 30] [--json FILE]`. It drives `rleex run` in a pseudo terminal of 80×24 as a
person would: keys go in as bytes, reactions are bytes that come out and hold the words that the key must bring.
"""

from __future__ import annotations

import argparse
import fcntl
import json
import os
import pty
import re
import select
import statistics
import struct
import subprocess
import sys
import tempfile
import termios
import time
from pathlib import Path

import psutil
from rich.console import Console
from rich.table import Table

from app.config import load_config
from app.model import set_up_model
from app.paths import find_home

LIMIT_S = 60.0
PRESSES = 40
_ESCAPES = re.compile(rb"\x1b\[[0-9;?]*[ -/]*[@-~]|\x1b[()][0-9A-B]|\x1b[=>]")
# A key that opens a dialog, words that only the dialog shows; Escape closes it.
KEY, WORDS = b"s", b"Before arming"


class Terminal:
    """A console in a pseudo terminal."""

    def __init__(self, home: Path, columns: int, rows: int) -> None:
        self.master, slave = pty.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
        environment = os.environ | {"TERM": "xterm-256color", "COLORTERM": "truecolor"}
        words = [str(Path(sys.executable).with_name("rleex")), "run", "--home", str(home)]
        self.started_s = time.monotonic()
        self.child = subprocess.Popen(words, stdin=slave, stdout=slave, stderr=slave, env=environment)
        os.close(slave)
        self._seen = b""

    def wait(self, words: bytes, limit_s: float = LIMIT_S) -> float:
        """Seconds until these words have come since the last key. Raises TimeoutError."""
        begun = time.monotonic()
        while words not in _ESCAPES.sub(b"", self._seen):
            if time.monotonic() - begun > limit_s:
                raise TimeoutError(f"{words!r} did not appear")
            self._read(0.05)
        return time.monotonic() - begun

    def press(self, key: bytes) -> None:
        """Forget what was seen, send a key."""
        self._read(0.0)
        self._seen = b""
        os.write(self.master, key)

    def idle(self, seconds: float) -> None:
        """Let it draw."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self._read(0.05)
            self._seen = b""

    def close(self) -> None:
        """Ctrl-C, and wait for the end."""
        os.write(self.master, b"\x03")
        while self.child.poll() is None:
            self._read(0.1)
        os.close(self.master)

    def _read(self, timeout_s: float) -> None:
        readable, _, _ = select.select([self.master], [], [], timeout_s)
        if readable:
            try:
                self._seen += os.read(self.master, 1 << 20)
            except OSError:
                self._seen += b""  # the console has gone


def reactions(terminal: Terminal) -> list[float]:
    """Milliseconds from a key to its words, many times."""
    found = []
    for _ in range(PRESSES):
        terminal.press(KEY)
        found.append(terminal.wait(WORDS) * 1000)
        terminal.press(b"\x1b")
        terminal.idle(0.3)
    return found


def measure(home: Path, seconds: float) -> dict[str, float]:
    """All figures of one console of 80×24."""
    terminal = Terminal(home, 80, 24)
    try:
        terminal.wait(b"STOP")
        first_paint_s = time.monotonic() - terminal.started_s
        terminal.wait("▀▀▀▀".encode())
        first_picture_s = time.monotonic() - terminal.started_s
        terminal.idle(3.0)
        console = psutil.Process(terminal.child.pid)
        times = reactions(terminal)
        memory_mb, cpu = console.memory_info().rss / 1e6, _cpu_s(console)
        begun = time.monotonic()
        terminal.idle(seconds)
        share = (_cpu_s(console) - cpu) / (time.monotonic() - begun)
        growth_mb = console.memory_info().rss / 1e6 - memory_mb
    finally:
        terminal.close()
    return {
        "first_paint_s": first_paint_s,
        "first_picture_s": first_picture_s,
        "key_to_reaction_p50_ms": statistics.median(times),
        "key_to_reaction_p95_ms": sorted(times)[int(0.95 * (len(times) - 1))],
        "cpu_percent": 100 * share,
        "memory_mb": memory_mb,
        "memory_growth_mb": growth_mb,
        "seconds": seconds,
    }


def _cpu_s(process: psutil.Process) -> float:
    times = process.cpu_times()
    return float(times.user + times.system)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    real = find_home()
    model = set_up_model(real, load_config(real.config))
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "config.toml").write_text(f'model = "{model}"\n')
        measure(Path(folder), 1.0)  # warm the caches
        found = measure(Path(folder), options.seconds)
    table = Table("figure", "measured", "bound")
    bounds = {"first_paint_s": "1.0", "key_to_reaction_p95_ms": "50", "cpu_percent": "60", "first_picture_s": "3.0"}
    for name, value in found.items():
        table.add_row(name, f"{value:.2f}", bounds.get(name, ""))
    Console().print(table)
    if options.json:
        options.json.write_text(json.dumps(found, indent=2))


if __name__ == "__main__":
    main()
