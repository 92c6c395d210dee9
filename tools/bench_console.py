"""What the console costs, with the real processes running: first paint, key to reaction, loop lag, CPU, memory.

`python tools/bench_console.py [--seconds 30] [--minutes 0] [--json FILE]`. It drives `rleex run` in a pseudo terminal
of 80×24 (`--columns`, `--rows`) as a person would: keys go in as bytes, reactions are bytes that come out and hold the
text that the key must bring. The loop's lag is measured from the first image on (`loop_probe.py`), while keys are
pressed and while not. `--minutes`: afterwards leave it running, sample its memory once a minute, and print the slope.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path

import psutil
from rich.console import Console
from rich.table import Table

from tools.pty_program import PtyProgram, configure

PRESSES = 40
# A key that opens a dialog, text that only the dialog shows; Escape closes it.
KEY, WORDS = b"s", b"Before arming"


class Terminal(PtyProgram):
    """A console in a pseudo terminal."""

    def __init__(self, home: Path, columns: int, rows: int, environment: Mapping[str, str] = os.environ) -> None:
        # Compiled modules are kept, as an installed program's are, whatever this shell says.
        compiled = {"PYTHONDONTWRITEBYTECODE": "", "PYTHONPYCACHEPREFIX": str(home / "compiled")}
        self._lags = home / "lags.txt"
        probe = Path(__file__).with_name("loop_probe.py")
        command = [sys.executable, str(probe), str(self._lags), "run", "--home", str(home)]
        super().__init__(command, {**environment, **compiled}, columns, rows)

    def lags_ms(self, since_s: float, until_s: float) -> list[float]:
        """The event loop's lags between two moments, sorted; known once it has been closed."""
        lines = [line.split() for line in self._lags.read_text().splitlines()]
        return sorted(float(lag_ms) for at_s, lag_ms in lines if since_s <= float(at_s) <= until_s)


def reactions(terminal: Terminal) -> list[float]:
    """Milliseconds from a key to its text, many times."""
    found = []
    for _ in range(PRESSES):
        terminal.press(KEY)
        found.append(terminal.wait(WORDS) * 1000)
        terminal.press(b"\x1b")
        terminal.idle(0.3)
    return found


def slope_mb_per_h(samples_mb: list[float]) -> float:
    """The slope of the line through samples taken once a minute; 0 of fewer than two."""
    if len(samples_mb) < 2:
        return 0.0
    return 60 * statistics.linear_regression(range(len(samples_mb)), samples_mb).slope


def memory_once_a_minute(terminal: Terminal, console: psutil.Process, minutes: int) -> list[float]:
    """The console's own memory in MB, at once and after each minute."""
    samples_mb = [console.memory_full_info().uss / 1e6]
    for minute in range(1, minutes + 1):
        terminal.idle(60.0)
        samples_mb.append(console.memory_full_info().uss / 1e6)
        Console(stderr=True).print(f"minute {minute}: {samples_mb[-1]:.1f} MB")
    return samples_mb


def measure(home: Path, seconds: float, minutes: int = 0, *, columns: int = 80, rows: int = 24) -> dict[str, float]:
    """All figures of one console."""
    terminal = Terminal(home, columns, rows)
    try:
        terminal.wait(b"STOP")
        first_paint_s = time.monotonic() - terminal.started_s
        terminal.wait("▀▀▀▀".encode())
        picture_at_s = time.monotonic()
        first_picture_s = picture_at_s - terminal.started_s
        terminal.idle(3.0)
        console = psutil.Process(terminal.child.pid)
        times = reactions(terminal)
        memory_mb, cpu = console.memory_info().rss / 1e6, _cpu_s(console)
        begun = time.monotonic()
        terminal.idle(seconds)
        share = (_cpu_s(console) - cpu) / (time.monotonic() - begun)
        growth_mb = console.memory_info().rss / 1e6 - memory_mb
        samples_mb = memory_once_a_minute(terminal, console, minutes)
        ended_s = time.monotonic()
    finally:
        terminal.close()
    lags = terminal.lags_ms(picture_at_s, ended_s)
    return {
        "first_paint_s": first_paint_s,
        "first_picture_s": first_picture_s,
        "key_to_reaction_p50_ms": statistics.median(times),
        "key_to_reaction_p95_ms": _share(sorted(times), 0.95),
        "loop_lag_p50_ms": _share(lags, 0.50),
        "loop_lag_p95_ms": _share(lags, 0.95),
        "loop_lag_p99_ms": _share(lags, 0.99),
        "loop_lag_max_ms": lags[-1],
        "cpu_percent": 100 * share,
        "memory_mb": memory_mb,
        "memory_growth_mb": growth_mb,
        "memory_slope_mb_per_h": slope_mb_per_h(samples_mb),
        "seconds": seconds,
    }


def _share(ordered: list[float], share: float) -> float:
    return ordered[int(share * (len(ordered) - 1))]


def _cpu_s(process: psutil.Process) -> float:
    times = process.cpu_times()
    return float(times.user + times.system)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--minutes", type=int, default=0)
    parser.add_argument("--columns", type=int, default=80)
    parser.add_argument("--rows", type=int, default=24)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        configure(Path(folder))
        measure(Path(folder), 1.0)  # warm the caches
        found = measure(Path(folder), options.seconds, options.minutes, columns=options.columns, rows=options.rows)
    table = Table("figure", "measured", "bound")
    bounds = {"first_paint_s": "1.0", "key_to_reaction_p95_ms": "50", "cpu_percent": "60", "first_picture_s": "3.0"}
    for name, value in found.items():
        table.add_row(name, f"{value:.2f}", bounds.get(name, ""))
    Console().print(table)
    if options.json:
        options.json.write_text(json.dumps(found, indent=2))


if __name__ == "__main__":
    main()
