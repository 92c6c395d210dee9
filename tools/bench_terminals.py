"""The console beside posting, harlequin and btop in the same pseudo terminal: first paint, keys, CPU.

`python tools/bench_terminals.py [--rounds 7] [--seconds 10] [--presses 20] [--venv DIR]`. posting and harlequin are
installed from the package index, each into an environment of its own in DIR (a temporary folder unless given); btop
is Debian's. A program that is not there, or hangs in a round, is left out and named. In each round every program runs
once, one after the other; a ratio is the console's figure over the other's of the same round, and what is printed is
the median of the rounds' ratios.

first paint: from the start to the first text of the program's own. key: from the byte of a key that opens a page to
text that only this page shows; p95 of a round's presses. CPU: of the program's own process, in per cent of a core; at
rest with nothing to draw (the console: its list of patients), live with its own traffic (the console: a session with
camera and legs; posting and harlequin: that key or Escape twice a second; btop: its charts, every 2 s as it comes).
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import psutil
from rich.console import Console
from rich.table import Table

from tools.pty_program import PtyProgram, configure

COLUMNS, ROWS = 120, 36
ESCAPE = b"\x1b"
# What each is installed with: posting 2.11 crashes with tree-sitter 0.26.
INSTALLED = {"posting": ("posting", "tree-sitter<0.26"), "harlequin": ("harlequin",)}
SETTLE_S = 3.0  # after the first paint: what loads in the background has loaded
FIGURES = {"first_paint_s": "first paint, s", "key_ms": "key p95, ms", "rest": "CPU at rest, %", "live": "CPU live, %"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Subject:
    """How one program is started and what its screen says."""

    command: tuple[str, ...]
    painted: str  # the first text of its own
    key: bytes  # opens a page ...
    page: str  # ... that alone shows this text
    end: bytes
    own_traffic: bool = False  # it draws by itself; else live means keys
    live_command: tuple[str, ...] = ()  # where it is live only when started otherwise
    live_painted: str = ""


def subjects(home: Path, tools: Path) -> dict[str, Subject]:
    """The console and the three others. home: two consoles' data, `rest` and `live`."""
    console = (str(Path(sys.executable).with_name("rleex")), "run", "--home")
    return {
        "rleex": Subject(
            command=(*console, str(home / "rest")),
            painted="STOP",
            key=b"\x1bOP",
            page="All patients on this computer",
            end=b"\x03",
            own_traffic=True,
            live_command=(*console, str(home / "live")),
            live_painted="▀▀▀▀",
        ),
        "posting": Subject(
            command=(str(tools / "posting" / "bin" / "posting"), "--collection", str(home)),
            painted="Send",
            key=b"\x10",
            page="Search for commands",
            end=b"\x03",
        ),
        "harlequin": Subject(
            command=(str(tools / "harlequin" / "bin" / "harlequin"), "-P", "None", ":memory:"),
            painted="Query Results",
            key=b"\x1bOP",
            page="Harlequin Help",
            end=b"\x11",
        ),
        "btop": Subject(
            command=("btop", "--utf-force"), painted="cpu", key=b"h", page="Description", end=b"q", own_traffic=True
        ),
    }


def measure(subject: Subject, seconds: float, presses: int) -> dict[str, float]:
    """One run. Raises TimeoutError when its screen doesn't say what it should."""
    found = _in(subject.command, subject.painted, subject.end, partial(_at_rest, subject, seconds, presses))
    command, painted = subject.live_command or subject.command, subject.live_painted or subject.painted
    live = _in(command, painted, subject.end, partial(_live, subject, seconds))
    return {**found, "live": live["live"]}


def _in(
    command: tuple[str, ...], painted: str, end: bytes, look: Callable[[PtyProgram], dict[str, float]]
) -> dict[str, float]:
    program = PtyProgram(command, os.environ, COLUMNS, ROWS)
    try:
        program.wait(painted.encode())
        first_paint_s = time.monotonic() - program.started_s
        program.idle(SETTLE_S)
        return {"first_paint_s": first_paint_s, **look(program)}
    finally:
        program.close(end)


def _at_rest(subject: Subject, seconds: float, presses: int, program: PtyProgram) -> dict[str, float]:
    rest = _cpu_percent(program, seconds, lambda: program.idle(seconds))
    times = []
    for _ in range(presses):
        program.press(subject.key)
        times.append(1000 * program.wait(subject.page.encode()))
        program.press(ESCAPE)
        program.idle(0.3)
    return {"rest": rest, "key_ms": sorted(times)[int(0.95 * (len(times) - 1))]}


def _live(subject: Subject, seconds: float, program: PtyProgram) -> dict[str, float]:
    def keys() -> None:
        for _ in range(round(seconds)):
            program.press(subject.key)
            program.idle(0.5)
            program.press(ESCAPE)
            program.idle(0.5)

    idle = partial(program.idle, seconds)
    return {"live": _cpu_percent(program, seconds, idle if subject.own_traffic else keys)}


def _cpu_percent(program: PtyProgram, seconds: float, during: Callable[[], object]) -> float:
    process = psutil.Process(program.child.pid)
    before, begun = sum(process.cpu_times()[:2]), time.monotonic()
    during()
    return 100 * (sum(process.cpu_times()[:2]) - before) / max(seconds, time.monotonic() - begun)


def install(name: str, folder: Path) -> None:
    """A program in an environment of its own: two of them in one don't agree on a Textual."""
    if not (folder / name / "bin" / name).exists():
        subprocess.run([sys.executable, "-m", "venv", str(folder / name)], check=True)
        subprocess.run(
            [str(folder / name / "bin" / "python"), "-m", "pip", "install", "-q", *INSTALLED[name]], check=True
        )


def furnish(home: Path) -> None:
    """Two homes: one begins with the list of patients, one with the demo patient's session."""
    for name, more in (("rest", '[joints]\nkind = "can"\n'), ("live", "")):
        (home / name).mkdir()
        configure(home / name, more)


Round = dict[str, dict[str, float]]  # program → its figures


def table(rounds: list[Round]) -> Table:
    """Medians, and the median of the console's ratios to each of the others."""
    shown = Table("program", "rounds", *FIGURES.values(), *(f"rleex ÷, {name}" for name in FIGURES.values()))
    for name in dict.fromkeys(name for one in rounds for name in one):
        found = [(one["rleex"], one[name]) for one in rounds if name in one]
        medians = [f"{statistics.median(each[figure] for _, each in found):.2f}" for figure in FIGURES]
        ratios = [
            statistics.median(ours[figure] / max(each[figure], 1e-9) for ours, each in found) for figure in FIGURES
        ]
        more = ("",) * len(FIGURES) if name == "rleex" else [f"{one:.2f}" for one in ratios]
        shown.add_row(name, str(len(found)), *medians, *more)
    return shown


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--presses", type=int, default=20)
    parser.add_argument("--venv", type=Path, help="folder for the environments of posting and harlequin, kept")
    parser.add_argument("--only", nargs="+", help="these programs")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        furnish(home)
        venv = options.venv or home / "venv"
        known = subjects(home, venv)
        wanted = {name: one for name, one in known.items() if not options.only or name in {"rleex", *options.only}}
        for name in INSTALLED.keys() & wanted.keys():
            install(name, venv)
        there = {name: one for name, one in wanted.items() if shutil.which(one.command[0])}
        for name in wanted.keys() - there.keys():
            Console(stderr=True).print(f"{name} is not installed and is left out")
        rounds: list[Round] = []
        for number in range(options.rounds):
            rounds.append({})
            for name, subject in there.items():
                Console(stderr=True).print(f"round {number + 1} of {options.rounds}: {name}")
                try:
                    rounds[-1][name] = measure(subject, options.seconds, options.presses)
                except TimeoutError as error:
                    if name == "rleex":
                        raise
                    Console(stderr=True).print(f"{name} is left out of this round: {error}")
    Console(width=200).print(table(rounds))
    if options.json:
        options.json.write_text(json.dumps(rounds, indent=2))


if __name__ == "__main__":
    main()
