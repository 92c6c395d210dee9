"""Keys and seconds from `rleex run` to the first step, a new patient, 'why did it stop', and a report.

`python tools/bench_ways.py [--rounds 3] [--size 120x36]`; in another checkout, its catalogues compiled,
`PYTHONPATH=. python HERE/tools/bench_ways.py` measures what it took there: it needs the same keys, as 294cb3b and later
ones have them. Real processes, digital hand, simulated joints, a pseudo terminal. Each key is pressed as soon as the
screen says that it is its turn, so the seconds are the program's and the legs' own; a person adds what reading and
reaching take. Every key counts, letters of an identifier too; a command line counts as its letters and Enter.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

# Run as a script, `tools` is a folder of the tree; PYTHONPATH, and the folder it is run in, go before it.
sys.path.append(str(Path(__file__).parent.parent))

from app.system.config import load_config
from app.system.hand_model import set_up_model
from app.system.paths import find_home
from app.text.catalogue import tr
from tools.pty_program import PtyProgram

LIMIT_S = 120.0
RLEEX = (sys.executable, "-c", "from app.cli import main; main()")
START, REPORT = "rleex run", "rleex audit report last -o report.html"
CTRL_Q, CTRL_S = "\x11", "\x13"
IDENTIFIER = "P-9"
Steps = tuple[tuple[str, str], ...]  # what the screen says, and the key whose turn it is then


def _said(key: str) -> str:
    """The part of a text that holds no value, as the screen shows it."""
    values = ("confirm", "arm", "act", "stop", "name", "checks", "order", "key", "acknowledge")
    return max(tr(key, **dict.fromkeys(values, "\0")).split("\0"), key=len)


def first_step() -> Steps:
    """A known patient: confirm, arm, stand up, step."""
    return (
        (_said("guide.confirm"), "c"),
        (tr("confirm.title"), "y"),
        (_said("guide.arm"), "a"),
        (_said("guide.initialise"), "t"),
        (tr("act.title"), "0"),
        (_said("guide.sign"), "t"),
        (tr("act.title"), "1"),
        (_said("guide.moving"), ""),
    )


def why() -> Steps:
    """STOP, and the sequence of what happened with its times."""
    texts = ((key, _said(key)) for key in ("hold.held", "stop.held"))  # the second, where no sequence is shown
    return (("", " "), (next(text for key, text in texts if not text.startswith(key)), ""))


def end() -> Steps:
    """From a session to its summary, saved."""
    return (("", "e"), (tr("end.title"), "y"), (_said("after.title"), CTRL_S), (_said("patients.title"), CTRL_Q))


def new_patient() -> Steps:
    """Out of the session that opened, a name of three letters, all else as it is proposed."""
    letters = tuple(("", letter) for letter in IDENTIFIER)
    opened = ((_said("guide.confirm"), "e"), (_said("after.title"), CTRL_S), (_said("patients.title"), "n"))
    return (*opened, (tr("form.title_new"), ""), *letters, ("", CTRL_S), (_said("patients.title"), ""))


@dataclass(frozen=True, slots=True)
class Taken:
    """How many keys, how many seconds."""

    keys: int
    seconds: float


def walk(program: PtyProgram, steps: Steps) -> Taken:
    """Each key in its turn. Raises TimeoutError with the text that did not come."""
    begun, keys = time.monotonic(), 0
    for text, key in steps:
        if text.strip():
            program.wait(text.strip().encode(), LIMIT_S)
        if key:
            program.press(key.encode())
            keys += 1
    return Taken(keys, time.monotonic() - begun)


def started(home: Path, columns: int, rows: int) -> PtyProgram:
    """`rleex run`."""
    return PtyProgram([*RLEEX, "run", "--home", str(home)], os.environ, columns, rows)


def measure(home: Path, columns: int, rows: int) -> dict[str, Taken]:
    """One round."""
    typed = len(START) + 1
    program = started(home, columns, rows)
    step, stop, ended = (walk(program, steps) for steps in (first_step(), why(), end()))
    program.child.wait(LIMIT_S)
    begun, page = time.monotonic(), home / "report.html"
    subprocess.run([*RLEEX, "audit", "report", "last", "-o", str(page), "--home", str(home)], check=True)
    report_s = time.monotonic() - begun
    program = started(home, columns, rows)
    patient = walk(program, new_patient())
    program.close(CTRL_Q.encode())
    return {
        "start → first step": Taken(typed + step.keys, step.seconds),
        "moving legs → why did it stop": stop,
        "session → report": Taken(ended.keys + len(REPORT) + 1, ended.seconds + report_s),
        "start → new patient": Taken(typed + patient.keys, patient.seconds),
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--size", default="120x36")
    options = parser.parse_args()
    columns, rows = map(int, options.size.split("x"))
    real = find_home()
    model = set_up_model(real, load_config(real.config))
    found = []
    for _ in range(options.rounds):
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "config.toml").write_text(f'model = "{model}"\n')
            found.append(measure(Path(folder), columns, rows))
    table = Table("from → to", "keys", "seconds (median)")
    for name in found[0]:
        seconds = statistics.median(each[name].seconds for each in found)
        table.add_row(name, str(found[0][name].keys), f"{seconds:.1f}")
    Console().print(table)


if __name__ == "__main__":
    main()
