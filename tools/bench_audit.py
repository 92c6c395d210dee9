"""Measures the audit trail: verifying a million records, taking ten thousand a second, the report, the review screen.

`python tools/bench_audit.py [--seconds 60] [--records 1000000]` prints what it measured; CPU time beside wall time,
because a busy machine lengthens only the latter.
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import os
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from itertools import chain
from pathlib import Path

from app.audit.process import run_audit
from app.audit.sink import AuditSink
from app.console.review_data import open_session
from app.ipc.links import LatestReceiver, address, new_link_directory
from app.ipc.messages import AuditHealth
from app.ipc.streams import AUDIT_HEALTH, LinkDirectory
from app.perception.frames import DecisionRecorder
from app.perception.reporting import Scale
from app.system.config import Config, SessionSetup
from app.text.recorded import render_recorded
from kgdfa.button_state import ButtonMode, ButtonPlace
from kgdfa.gesture import Decision, Explanation, Gesture, Verdict
from kgdfa.pipeline import Report
from kgdfa.recognition import FrameReading, Recognition, recognise
from logs.disk import Disk
from logs.journal import Moment
from logs.keys import by_fingerprint, known_keys, load_or_make_key
from logs.line import GENESIS, SEAL_LENGTH, canonical
from logs.mirror import CheckpointCopy
from logs.records import Body, Note, Payload, SessionStart
from logs.report.page import report
from logs.verify import Evidence, exit_status, verify
from logs.writer import SessionWriter
from profiles.schema import DEMO_PATIENT
from testing.trails import joints, write_sample

TICK_S = 0.002


def say(what: str, value: str) -> None:
    """One measured line."""
    print(f"{what:<58} {value}", flush=True)


def timed(work: Callable[[], object]) -> tuple[float, float]:
    """Wall and CPU seconds."""
    wall, cpu = time.perf_counter(), time.process_time()
    work()
    return time.perf_counter() - wall, time.process_time() - cpu


def evidence(home: Path) -> Evidence:
    """The keys of a home."""
    return Evidence(keys=by_fingerprint(known_keys(home / "keys")))


def bench_verify(home: Path, records: int) -> None:
    """A file of so many records: notes mostly, a joint record in ten, as a busy session has."""
    import random

    rng, folder = random.Random(1), home / "logs"
    folder.mkdir(parents=True)
    writer = SessionWriter(folder, "million", load_or_make_key(home / "keys"), Disk(), CheckpointCopy(""))
    start = SessionStart(versions={}, configuration={}, simulated=True)
    writer.begin(start, Moment(wall_ns=10**18, monotonic_ns=0))
    note, joint = Note(text="so many of them"), joints(1.0, "standing", rng)
    for number in range(records):
        now = Moment(wall_ns=10**18 + number * 1000, monotonic_ns=number * 1000)
        writer.take(now.entry(joint if number % 10 == 0 else note))
        if number % 2000 == 0:
            writer.settle(now.monotonic_ns)
    now = Moment(wall_ns=10**18 + records * 1000, monotonic_ns=records * 1000)
    writer.end("bench", now)
    writer.finish(now)
    writer.close()
    wall, cpu = timed(lambda: _must_be_sound([writer.path], evidence(home)))
    size = writer.path.stat().st_size / 1e6
    say(f"verify {records} records ({size:.0f} MB), s", f"{wall:.2f} wall, {cpu:.2f} CPU")


def bench_rate(home: Path, seconds: float, per_second: int = 10_000) -> None:
    """The real audit process under a steady load, and the lateness of a 500 Hz loop with it and without."""
    links = new_link_directory(Path(tempfile.mkdtemp(prefix="rleex-")))
    setup = SessionSetup(
        session="rate",
        home=home,
        links=links,
        config=Config(),
        profile=DEMO_PATIENT,
        operator="bench",
        host_pid=os.getpid(),
    )
    quiet = _lateness(min(seconds, 20.0))
    process = multiprocessing.get_context("spawn").Process(target=run_audit, args=(setup,))
    process.start()
    health = LatestReceiver(address(links, AUDIT_HEALTH.name), AuditHealth)
    while health.receive(1.0) is None:
        pass
    sender = multiprocessing.get_context("spawn").Process(target=_send, args=(links, seconds, per_second))
    began = time.monotonic()
    sender.start()
    sink = AuditSink(links, "control")
    busy = _lateness(seconds, lambda: sink.emit(Note(text="tick")))
    sender.join()
    took = time.monotonic() - began
    process.terminate()
    process.join()
    sink.close()
    health.close()
    path = home / "logs" / "rate.jsonl"
    _must_be_sound([path], evidence(home))
    kept = path.read_bytes().count(b'"kind":"note"')
    sent = int(seconds * per_second) + int(seconds)
    say(f"{per_second} a second for {seconds:.0f} s: sent, kept, refused", f"{sent}, {kept}, {sender.exitcode}")
    say("rate that the sender reached, records a second", f"{sent / took:.0f}")
    say("500 Hz loop, p99 late without and with it, ms", f"{quiet * 1e3:.3f}, {busy * 1e3:.3f}")
    say("ratio", f"{busy / quiet:.2f}")


def _send(links: LinkDirectory, seconds: float, per_second: int) -> None:
    """Emits at a steady rate; exit status: how many were refused, at most 255."""
    sink = AuditSink(links, "perception")
    refused, began = 0, time.monotonic()
    for batch in range(int(seconds * 100)):
        for _ in range(per_second // 100):
            refused += not sink.emit(Note(text="ten thousand of these"))
        time.sleep(max(began + (batch + 1) / 100 - time.monotonic(), 0))
    sink.close(10.0)
    os._exit(min(refused, 255))


@contextmanager
def _real_time() -> Iterator[None]:
    """SCHED_FIFO as control has it, where it is allowed."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(10))
    except PermissionError:
        say("SCHED_FIFO is not allowed here:", "lateness below is that of an ordinary process")
        yield
        return
    yield
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def _lateness(seconds: float, each_second: Callable[[], object] = lambda: None) -> float:
    """99th percentile of how late the ticks of a 500 Hz loop begin, seconds."""
    late = []
    with _real_time():
        due = time.monotonic() + TICK_S
        for tick in range(int(seconds / TICK_S)):
            time.sleep(max(due - time.monotonic(), 0))
            late.append(time.monotonic() - due)
            due += TICK_S
            if tick % 500 == 0:
                each_second()
    late.sort()
    return late[int(0.99 * len(late))]


def bench_reading(home: Path) -> None:
    """The report of half an hour, and opening two hundred thousand records for review."""
    half_hour = write_sample(home, minutes=30)
    for seed in range(2, 6):
        write_sample(home, minutes=30, seed=seed)
    wall, cpu = timed(lambda: report(half_hour, evidence(home), render_recorded))
    say("report of a 30 min session, s", f"{wall:.2f} wall, {cpu:.2f} CPU")
    long = write_sample(home, minutes=240, seed=9, per_second=20)
    session = open_session(long)
    wall, cpu = timed(lambda: open_session(long))
    say(f"open {len(session)} records for review, s", f"{wall:.2f} wall, {cpu:.2f} CPU")


def bench_frames(frames: int = 18_000) -> None:
    """What recording each frame costs: ten minutes of a hand that pushes every three seconds, and ten without one."""
    place = ButtonPlace.in_the_middle(1280, 720, 0.20)
    scale = Scale(anchor_m=0.065, anchor_method="measured", focal_px=650.0, focal_source="given")
    for name, in_view in (("with a hand", True), ("without a hand", False)):
        readings = [_reading(number, in_view) for number in range(frames)]
        state, reports = Recognition(), []
        for reading in readings:
            state = recognise(state, reading, place, ButtonMode.ROBUST)
            reports.append(_report(reading, state))
        found: list[Body] = []
        recorded = chain.from_iterable(map(DecisionRecorder(scale).take, reports))
        wall_s, cpu_s = timed(partial(found.extend, recorded))
        size = sum(len(canonical(_payload(number, body))) + SEAL_LENGTH for number, body in enumerate(found))
        hour_mb = size / frames * 30 * 3600 / 1e6
        say(f"recording frames {name}, {len(found)} records", f"{hour_mb:.1f} MB an hour at 30 frames/s")
        say("  time a frame", f"{wall_s / frames * 1e6:.1f} µs (CPU {cpu_s / frames * 1e6:.1f})")


def _reading(number: int, in_view: bool) -> FrameReading:
    """A push every three seconds; numbers as long as measured ones."""
    at_s = number / 30
    distance_m = 0.30 + 0.1234567 * math.cos(2 * math.pi * at_s / 3) + 1e-4 * math.sin(number)
    return FrameReading(
        captured_ns=1_000_000_000_000 + number * 33_366_123,
        hand=1,
        gesture=Gesture.FIVE if in_view else None,
        cut_off=False,
        distance_m=distance_m if in_view else None,
        beside_px=0.0 if in_view else None,
    )


def _report(reading: FrameReading, state: Recognition) -> Report:
    named = Verdict(gesture=reading.gesture, confidence=0.987654, explanation=Explanation(Decision.CLOSEST))
    return Report(
        captured_ns=reading.captured_ns,
        hand=None,
        verdict=named if reading.gesture else None,
        gesture=state.vote.gesture,
        recognised_ns=state.vote.recognised_ns,
        votes=3,
        distance=None,
        depth_distance=None,
        button=state.button,
        vote_ns=state.vote.decided_ns,
        reading=reading,
    )


def _payload(number: int, body: Body) -> Payload:
    return Payload(
        body=body,
        monotonic_ns=1_000_000_000_000 + number,
        operator="Ann Berg",
        previous=GENESIS,
        process="perception",
        schema=2,
        sequence=number,
        session="20261121T093000Z-1a2b",
        wall="2026-11-21T09:30:00.123456Z",
    )


def _must_be_sound(paths: list[Path], known: Evidence) -> None:
    findings = verify(paths, known)
    if exit_status(findings) != 0:
        raise SystemExit(f"not sound: {findings}")


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--records", type=int, default=1_000_000)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        bench_verify(Path(folder) / "verify", options.records)
        bench_rate(Path(folder) / "rate", options.seconds)
        bench_reading(Path(folder) / "reading")
    bench_frames()


if __name__ == "__main__":
    main()
