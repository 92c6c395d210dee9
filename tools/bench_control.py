"""How late control's ticks begin while everything runs and the legs walk: real processes, N seconds; --json too."""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from pathlib import Path

import msgspec
from rich.console import Console
from rich.progress import track
from rich.table import Table

from app.control.states import Action
from app.messages import OperatorKind

sys.path.insert(0, str(Path(__file__).parent.parent))  # run as a script, `tools` is a folder of the tree

from tools.real_session import RealSession, real_session

BOUNDS_MS = {"p99_ms": 0.2, "p999_ms": 1.0}  # where SCHED_FIFO is allowed


def walk_for(session: RealSession, seconds: float) -> None:
    """Keep the legs walking; an event that holds them ends the walk, and the ticks go on being counted."""
    session.walk()
    deadline = time.monotonic() + seconds
    for _ in track(range(int(seconds)), description="walking", disable=not os.isatty(1)):
        pause = min(time.monotonic() + 1.0, deadline)
        while time.monotonic() < pause:
            session.look()


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0, help="600 for the bound's ten minutes")
    parser.add_argument("--no-perception", action="store_true")
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    with (
        tempfile.TemporaryDirectory() as folder,
        real_session(Path(folder), perception=not asked.no_perception) as session,
    ):
        walk_for(session, asked.seconds)
        session.send(OperatorKind.ACT, Action.WALK_END)
        snapshot = session.until(lambda s: s.action is None, "the end of the walk")
    figures = msgspec.structs.asdict(snapshot.lateness)
    real_time = snapshot.real_time
    table = Table("lateness", "value", "bound")
    for name, value in figures.items():
        bound = BOUNDS_MS.get(name)
        table.add_row(name, f"{value:.4g}", "" if bound is None else f"≤ {bound:g} {'yes' if value <= bound else 'NO'}")
    table.add_row("SCHED_FIFO / locked / core", f"{real_time.fifo} / {real_time.memory_locked} / {real_time.core}", "")
    table.add_row("steps walked", str(snapshot.steps), "")
    Console().print(table)
    if asked.json:
        figures |= {"fifo": real_time.fifo, "memory_locked": real_time.memory_locked, "steps": snapshot.steps}
        asked.json.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
