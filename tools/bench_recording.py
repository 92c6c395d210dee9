"""What a recording costs: sessions with and without it in turn, walking; ticks, frames, processor time, size an hour.

`--seconds` of walking in each session, `--pairs` of sessions; exit status 1 when a message is lost or a file is not the
one that its trail names.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import psutil
from rich.console import Console
from rich.table import Table

sys.path.insert(0, str(Path(__file__).parent.parent))  # run as a script, `tools` is a folder of the tree

from app.recording.read import HashCheck, proof_of, survey
from app.system.paths import recording_path
from testing.session import real_session


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """One session's figures."""

    p50_ms: float
    p99_ms: float
    max_ms: float
    missed: int
    fps: float
    control_us: float  # processor time a tick
    recording_share: float = 0.0  # of a core
    mb_an_hour: float = 0.0
    messages: int = 0
    lost: int = 0
    proven: bool = True


def run(home: Path, seconds: float, *, recording: bool) -> Run:
    """A session that walks for so long."""
    with real_session(home, perception=True, recording=recording) as session:
        session.until(lambda _: session.report is not None and session.report.detector_ready, "perception")
        session.walk(1)
        processes = {
            name: psutil.Process(session.pids[name]) for name in ("control", "recording") if name in session.pids
        }
        before = {name: sum(process.cpu_times()[:2]) for name, process in processes.items()}
        ticks, began_s = session.snapshot.lateness.ticks if session.snapshot else 0, time.monotonic()
        while time.monotonic() - began_s < seconds:
            session.poll()
            if session.snapshot is not None and session.snapshot.action is None:  # something held the legs
                session.walk(1)
        took_s = time.monotonic() - began_s
        used_s = {name: sum(process.cpu_times()[:2]) - before[name] for name, process in processes.items()}
        late = session.until(lambda _: True).lateness
        fps = session.perception_fps()
        session.finish()
        path = recording_path(home / "logs", session.setup.session)
    measured = Run(
        p50_ms=late.p50_ms,
        p99_ms=late.p99_ms,
        max_ms=late.max_ms,
        missed=late.missed,
        fps=fps,
        control_us=used_s["control"] / max(1, late.ticks - ticks) * 1e6,
    )
    if not recording:
        return measured
    found, (proof, recorded) = survey(path), proof_of(path)
    return Run(
        **{name: getattr(measured, name) for name in ("p50_ms", "p99_ms", "max_ms", "missed", "fps", "control_us")},
        recording_share=used_s["recording"] / took_s,
        mb_an_hour=path.stat().st_size / 1e6 / found.duration_s * 3600,
        messages=found.counts.total(),
        lost=sum(recorded.lost.values()) if recorded else 0,
        proven=found.whole and proof is HashCheck.SAME and recorded is not None and recorded.messages == found.counts,
    )


def main() -> int:
    """Print the table; 1 when something was lost."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--pairs", type=int, default=3)
    arguments = parser.parse_args()
    runs: dict[bool, list[Run]] = {False: [], True: []}
    for _ in range(arguments.pairs):
        for recording, found in runs.items():
            with tempfile.TemporaryDirectory(prefix="bench-recording-") as home:
                found.append(run(Path(home), arguments.seconds, recording=recording))
    table = Table("", "without", "with", "ratio", title="recording, medians of sessions")
    for name in ("p50_ms", "p99_ms", "max_ms", "missed", "fps", "control_us"):
        without, with_it = (median(getattr(one, name) for one in runs[on]) for on in (False, True))
        table.add_row(name, f"{without:.3f}", f"{with_it:.3f}", f"{with_it / without:.3f}" if without else "–")
    for name in ("recording_share", "mb_an_hour", "messages", "lost"):
        table.add_row(name, "", f"{median(getattr(one, name) for one in runs[True]):.3f}", "")
    Console().print(table)
    return 0 if all(one.proven and not one.lost for one in runs[True]) else 1


if __name__ == "__main__":
    raise SystemExit(main())
