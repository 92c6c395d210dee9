"""What a recording costs: walking sessions with everything recorded and without a recording, in pairs.

    python -m tools.bench_recording [--seconds 600] [--pairs 3] [--depth] [--encrypt] [--without-pictures]
                                    [--json FILE]

Everything: joints, hand, gait, links, trail, and the camera's pictures with consent. Of each pair the ratio with by
without is printed, and the median over the pairs; which of a pair comes first alternates. The bounds: the 99th
percentile of control's lateness at most 1.1 times that without, perception's rate at least 0.97 of that without. Each
recording is compared with what control and perception made and with control's statistics (`testing/recordings.py`).
Exit status 1 beyond a bound, or when a message is missing. Run it on a machine that does nothing else.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from statistics import median
from typing import Annotated

import msgspec
import psutil
import typer
from rich.console import Console
from rich.table import Table

from app.recording.read import proof_of, survey
from app.system.paths import pictures_path, recording_path
from profiles.schema import DEMO_PATIENT, DistanceUsed
from testing.recordings import contradictions
from testing.session import RealSession

MOST_P99 = 1.1  # with by without
LEAST_FPS = 0.97
COMPARED = ("p50_ms", "p99_ms", "max_ms", "missed", "fps", "control_us")
RECORDED = ("recording_share", "mb_an_hour", "pictures_mb_an_hour", "messages", "pictures", "lost", "pictures_lost")
SHOWN = Console()


@dataclass(frozen=True, slots=True, kw_only=True)
class What:
    """What a session records beside joints, hand, gait, links and trail; a depth camera is there in both of a pair."""

    pictures: bool = True
    encrypt: bool = False
    depth: bool = False  # the digital hand's depth map, as well


@dataclass(frozen=True, slots=True, kw_only=True)
class Stored:
    """What was recorded in a session."""

    mb_an_hour: float = 0.0
    pictures_mb_an_hour: float = 0.0
    messages: int = 0
    pictures: int = 0
    lost: int = 0
    pictures_lost: int = 0
    wrong: tuple[str, ...] = ()  # see `contradictions`


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """One session's figures. Lateness of ticks since its start; the rest while it walked."""

    p50_ms: float
    p99_ms: float
    max_ms: float
    missed: int
    fps: float
    control_us: float  # processor time a tick
    recording_share: float = 0.0  # of a core
    stored: Stored = Stored()


def run(home: Path, seconds: float, what: What, *, recording: bool) -> Run:
    """A session that walks for so long."""
    source = DistanceUsed.BOTH if what.depth else DistanceUsed.MONOCULAR
    patient = msgspec.structs.replace(DEMO_PATIENT, distance_source=source)
    encrypt = recording and what.encrypt
    with RealSession(home, perception=True, patient=patient, recording=recording, encrypt=encrypt) as session:
        session.until(lambda _: session.report is not None and session.report.detector_ready, "perception")
        if recording and what.pictures:
            session.record_pictures(consent=True)
            session.until(lambda _: session.report is not None and session.report.pictures_recorded, "pictures")
        session.walk(1)
        measured = walk_for(session, seconds)
        session.finish()
        if not recording:
            return measured
        return replace(measured, stored=stored(recording_path(home / "logs", session.setup.session)))


def walk_for(session: RealSession, seconds: float) -> Run:
    """Walk on, and on again after whatever held the legs."""
    processes = {name: psutil.Process(pid) for name, pid in session.pids.items() if name in {"control", "recording"}}
    before_s = {name: sum(process.cpu_times()[:2]) for name, process in processes.items()}
    session.first_report = session.report
    ticks, began_s = session.until(lambda _: True).lateness.ticks, time.monotonic()
    while time.monotonic() - began_s < seconds:
        session.poll()
        if session.snapshot is not None and session.snapshot.action is None:
            session.walk(1)
    took_s = time.monotonic() - began_s
    used_s = {name: sum(process.cpu_times()[:2]) - before_s[name] for name, process in processes.items()}
    late = session.until(lambda _: True).lateness
    return Run(
        p50_ms=late.p50_ms,
        p99_ms=late.p99_ms,
        max_ms=late.max_ms,
        missed=late.missed,
        fps=session.perception_fps(),
        control_us=used_s["control"] / max(1, late.ticks - ticks) * 1e6,
        recording_share=used_s.get("recording", 0.0) / took_s,
    )


def stored(path: Path) -> Stored:
    """The files of a session that has ended, and whether they are what they must be."""
    found, (_, named) = survey(path), proof_of(path)
    wrong = tuple(contradictions(path))
    rest = Stored(
        mb_an_hour=_mb_an_hour(path, found.duration_s),
        messages=found.counts.total(),
        lost=sum(named.lost.values()) if named else 0,
        wrong=wrong,
    )
    beside = pictures_path(path.parent, path.stem)
    if not beside.exists():
        return rest
    taken, (_, named) = survey(beside), proof_of(beside)
    told = named is not None and taken.whole and named.messages == taken.counts
    return replace(
        rest,
        wrong=wrong if told else (*wrong, "pictures"),
        pictures_mb_an_hour=_mb_an_hour(beside, taken.duration_s),
        pictures=taken.counts.total(),
        pictures_lost=sum(named.lost.values()) if named else 0,
    )


def _mb_an_hour(path: Path, duration_s: float) -> float:
    return path.stat().st_size / 1e6 / duration_s * 3600 if duration_s else 0.0


Pair = tuple[Run, Run]  # without, with


def pairs_of(seconds: float, count: int, what: What) -> list[Pair]:
    """So many pairs; the second of one is the first of the next, so that a slow drift of the machine cancels."""
    found = []
    for number in range(count):
        made = {}
        for recording in (False, True) if number % 2 == 0 else (True, False):
            with tempfile.TemporaryDirectory(prefix="bench-recording-") as home:
                made[recording] = run(Path(home), seconds, what, recording=recording)
        found.append((made[False], made[True]))
        SHOWN.print(f"pair {number + 1}: " + ", ".join(f"{name} {ratio(found[-1], name):.3f}" for name in COMPARED))
    return found


def ratio(pair: Pair, name: str) -> float:
    """With by without; 1 where both are 0."""
    without, with_it = (getattr(one, name) for one in pair)
    return with_it / without if without else 1.0 if not with_it else float("inf")


def print_table(pairs: list[Pair]) -> None:
    """Medians of the sessions, and of the pairs' ratios."""
    table = Table("", "without", "with", "ratio, median of pairs", "bound", title="what a recording costs")
    bounds = {"p99_ms": f"≤ {MOST_P99}", "fps": f"≥ {LEAST_FPS}"}
    for name in COMPARED:
        without, with_it = (median(getattr(pair[which], name) for pair in pairs) for which in (0, 1))
        ratios = median(ratio(pair, name) for pair in pairs)
        table.add_row(name, f"{without:.3f}", f"{with_it:.3f}", f"{ratios:.3f}", bounds.get(name, ""))
    for name in RECORDED:
        values = [getattr(one if name == "recording_share" else one.stored, name) for _, one in pairs]
        table.add_row(name, "", f"{median(values):.3f}", "", "0" if name == "lost" else "")
    SHOWN.print(table)


def failures(pairs: list[Pair]) -> list[str]:
    """What is beyond a bound, or wrong in a file."""
    late, fps = (median(ratio(pair, name) for pair in pairs) for name in ("p99_ms", "fps"))
    found = [f"p99 of lateness {late:.3f} times, at most {MOST_P99}"] if late > MOST_P99 else []
    found += [f"frames {fps:.3f} times, at least {LEAST_FPS}"] if fps < LEAST_FPS else []
    return found + [f"lost or wrong: {one.stored}" for _, one in pairs if one.stored.lost or one.stored.wrong]


def main(
    *,
    seconds: Annotated[float, typer.Option(min=1.0, help="Walking in each session.")] = 600.0,
    pairs: Annotated[int, typer.Option(min=1, help="Sessions without and with, each.")] = 3,
    depth: Annotated[bool, typer.Option("--depth", help="A camera with depth, recorded as well.")] = False,
    encrypt: Annotated[bool, typer.Option("--encrypt", help="Recordings encrypted, too.")] = False,
    without_pictures: Annotated[bool, typer.Option("--without-pictures", help="No pictures of the camera.")] = False,
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the figures here as well.")] = None,
) -> None:
    """Print the table; 1 beyond a bound or when something is missing."""
    found = pairs_of(seconds, pairs, What(pictures=not without_pictures, encrypt=encrypt, depth=depth))
    print_table(found)
    wrong = failures(found)
    for line in wrong:
        SHOWN.print(line)
    if json_file is not None:
        json_file.write_text(json.dumps([[asdict(one) for one in pair] for pair in found], indent=1), encoding="utf-8")
    sys.exit(bool(wrong))


if __name__ == "__main__":
    typer.run(main)
