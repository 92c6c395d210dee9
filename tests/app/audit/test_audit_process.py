"""The real audit process: records in, health out, a signed end, and death at any moment."""

from __future__ import annotations

import multiprocessing
import os
import resource
import shutil
import time
from collections.abc import Callable, Iterator
from functools import partial
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import get_args

import msgspec
import pytest

from app.audit.process import IDLE_S, start_record
from app.audit.sink import AuditSink, other_trail
from app.ipc.links import LatestReceiver, address, new_link_directory
from app.ipc.messages import AuditHealth
from app.ipc.streams import AUDIT_HEALTH, LinkDirectory
from app.session.child import run_process
from app.system.config import Config, Purpose, SessionSetup
from app.system.paths import Home
from logs.findings import Remark
from logs.keys import by_fingerprint, known_keys, read_anchors
from logs.reason import Reason, key_of
from logs.records import Command, Loss, Note, OtherTrail, Record, RecordsLost, SessionEnd, SessionStart
from logs.scan import scan_file
from logs.trail import MAX_WAITING_BYTES, DiskFault
from logs.verify import Evidence, exit_status, verify
from profiles.schema import DEMO_PATIENT

pytestmark = pytest.mark.serial

COMMAND = Command(number=1, action="walk", source="gesture", state="standing")
PATIENCE_S = 60.0


class Session:
    """One session's audit process with a sender and a receiver."""

    def __init__(self, home: Home, links: LinkDirectory, name: str) -> None:
        self.home = home
        self.setup = SessionSetup(
            session=name,
            home=home.root,
            links=links,
            config=Config(checkpoint_copy=str(home.root / "copies")),
            profile=DEMO_PATIENT,
            operator="ann",
            host_pid=os.getpid(),
        )
        self.process: BaseProcess = multiprocessing.get_context("spawn").Process(
            target=run_process, args=("audit", self.setup)
        )
        self.process.start()
        self.sink = AuditSink(links, "control", "ann")
        self._health = LatestReceiver(address(links, AUDIT_HEALTH.name), AuditHealth)

    def wait_until(self, condition: Callable[[AuditHealth], bool]) -> AuditHealth:
        """The first health for which it holds."""
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            health = self._health.receive(0.2)
            if health is not None and condition(health):
                return health
        raise AssertionError("the audit process did not get there")

    def end(self) -> int | None:
        """Ask it to end in good order."""
        self.process.terminate()
        return self.wait_for_end()

    def wait_for_end(self) -> int | None:
        self.process.join(PATIENCE_S)
        self.sink.close()
        self._health.close()
        return self.process.exitcode


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[[str], Session]]:
    """Start sessions of one home; whatever is left is ended."""
    begun: list[Session] = []
    (tmp_path / "links").mkdir()
    links = new_link_directory(tmp_path / "links")

    def begin(name: str) -> Session:
        begun.append(Session(Home(tmp_path / "home"), links, name))
        return begun[-1]

    yield begin
    for session in begun:
        session.process.kill()
        session.wait_for_end()


def evidence(home: Home) -> Evidence:
    return Evidence(
        keys=by_fingerprint(known_keys(home.keys)),
        copies=home.root / "copies",
        anchors=read_anchors(home.keys),
    )


def bodies(path: Path) -> list[object]:
    return [_record(line).body for line in path.read_bytes().splitlines()]


def _has_written(trail: Path, text: str, _: AuditHealth) -> bool:
    return trail.exists() and text in trail.read_text(encoding="utf-8")


def _record(line: bytes) -> Record:
    return msgspec.json.decode(line, type=Record)


def test_after_a_takeover_every_process_signs_with_who_commands(start: Callable[[str], Session]) -> None:
    session = start("s1")
    trail = session.home.logs / "s1.jsonl"
    guardian = AuditSink(session.setup.links, "guardian", "ann")
    for number, operator in enumerate(("ann", "tom"), 1):
        session.sink.operator = operator
        for sink, name in ((session.sink, "control"), (guardian, "guardian")):
            assert sink.emit(Note(text=f"{name} {number}"))
            session.wait_until(partial(_has_written, trail, f"{name} {number}"))
    guardian.close()
    assert session.end() == 0
    lines = trail.read_bytes().splitlines()
    written_by = {one.body.text: one.operator for one in map(_record, lines) if isinstance(one.body, Note)}
    assert written_by == {"control 1": "ann", "guardian 1": "ann", "control 2": "tom", "guardian 2": "tom"}
    assert [one.operator for one in map(_record, lines) if isinstance(one.body, SessionEnd)] == ["tom"]


def test_everything_sent_is_written_in_order_and_signed_at_the_end(start: Callable[[str], Session]) -> None:
    session = start("s1")
    for number in range(3000):
        assert session.sink.emit(Note(text=str(number)))
    session.wait_until(lambda health: health.written > 3000)
    assert session.end() == 0
    written = bodies(session.home.logs / "s1.jsonl")
    assert isinstance(written[0], SessionStart)
    assert [body.text for body in written if isinstance(body, Note)] == [str(n) for n in range(3000)]
    assert any(isinstance(body, SessionEnd) for body in written)
    assert exit_status(verify([session.home.logs], evidence(session.home))) == 0


@pytest.mark.parametrize("purpose", get_args(Purpose))
def test_the_first_record_says_what_runs(tmp_path: Path, purpose: Purpose) -> None:
    links = LinkDirectory(path=tmp_path, public=b"", secret=b"")
    setup = SessionSetup(
        session="s1", home=tmp_path, links=links, config=Config(), profile=DEMO_PATIENT, operator="ann", purpose=purpose
    )
    assert start_record(setup).purpose == purpose


def test_records_still_queued_at_the_end_are_written(start: Callable[[str], Session]) -> None:
    session = start("s1")
    session.wait_until(lambda health: health.written > 0)
    for _ in range(2000):
        session.sink.emit(COMMAND)
    assert session.end() == 0
    written = bodies(session.home.logs / "s1.jsonl")
    assert sum(isinstance(body, Command) for body in written) == 2000


def test_records_queued_while_the_disk_is_full_are_written_when_it_is_freed_after_the_end_was_asked_for(
    start: Callable[[str], Session],
) -> None:
    session = start("s1")
    session.wait_until(lambda health: health.written > 0 and health.waiting == 0)
    pid, trail = session.process.pid, session.home.logs / "s1.jsonl"
    assert pid is not None
    _, most = resource.prlimit(pid, resource.RLIMIT_FSIZE)
    resource.prlimit(pid, resource.RLIMIT_FSIZE, (trail.stat().st_size, most))
    large = MAX_WAITING_BYTES // 1_000_000 + 1
    for _ in range(large):
        assert session.sink.emit(Note(text="x" * 1_000_000))
    session.wait_until(lambda health: health.waiting >= large)
    for number in range(100):
        assert session.sink.emit(Note(text=str(number)))
    session.process.terminate()
    asked_ns = time.monotonic_ns()
    session.wait_until(lambda health: health.at_ns - asked_ns > 2 * IDLE_S * 1e9)
    resource.prlimit(pid, resource.RLIMIT_FSIZE, (most, most))
    assert session.wait_for_end() == 0
    texts = [body.text for body in bodies(trail) if isinstance(body, Note)]
    assert texts[large:] == [str(number) for number in range(100)]
    assert exit_status(verify([session.home.logs], evidence(session.home))) == 0


def test_a_trail_that_is_deleted_is_told_within_seconds_and_once_in_the_engineers_log(
    start: Callable[[str], Session],
) -> None:
    session = start("s1")
    session.wait_until(lambda health: health.written > 0 and health.waiting == 0)
    shutil.rmtree(session.home.logs)
    session.sink.emit(COMMAND)
    session.wait_until(lambda health: health.fault is not None and health.fault.code == key_of(DiskFault.NOT_WRITTEN))
    assert session.end() == 1
    log = (session.home.root / "diagnostics" / "audit.log").read_text(encoding="utf-8")
    assert [msgspec.json.decode(line)["event"] for line in log.splitlines()] == ["process started", "trail not written"]


def test_killed_at_any_moment_nothing_acknowledged_is_missing_and_the_next_session_starts(
    start: Callable[[str], Session],
) -> None:
    names = [f"k{number}" for number in range(3)]
    for number, name in enumerate(names):
        session = start(name)
        acknowledged = session.wait_until(lambda health: health.written > 0).written
        while acknowledged < 200 * number + 5:
            for _ in range(50):
                session.sink.emit(COMMAND)
            acknowledged = session.wait_until(lambda _: True).written
        session.process.kill()
        session.wait_for_end()
        keys = by_fingerprint(known_keys(session.home.keys))
        assert scan_file(session.home.logs / f"{name}.jsonl", keys).records >= acknowledged
    last = start("last")
    last.wait_until(lambda health: health.written > 0)
    assert last.end() == 0
    findings = verify([last.home.logs], evidence(last.home))
    assert exit_status(findings) == 0
    explained = [
        finding for finding in findings if any(remark.code == key_of(Remark.RECOVERED) for remark in finding.remarks)
    ]
    assert {finding.file.stem for finding in explained} == set(names)


def test_the_same_session_started_again_continues_in_a_part_of_its_own(start: Callable[[str], Session]) -> None:
    first = start("s1")
    first.wait_until(lambda health: health.written > 0)
    first.process.kill()
    first.wait_for_end()
    second = start("s1")
    second.wait_until(lambda health: health.written > 0)
    assert second.end() == 0
    assert (second.home.logs / "s1-2.jsonl").exists()
    assert exit_status(verify([second.home.logs], evidence(second.home))) == 0


def test_a_session_being_written_is_called_running(start: Callable[[str], Session]) -> None:
    session = start("s1")
    session.wait_until(lambda health: health.written > 0)
    (finding,) = verify([session.home.logs / "s1.jsonl"], evidence(session.home))
    assert finding.status.value == "running"
    assert exit_status([finding]) == 0


def test_what_can_not_be_written_is_reported(start: Callable[[str], Session]) -> None:
    session = start("s1")
    session.sink.emit(Note(text="\ud800"))
    session.sink.emit(Note(text="x" * 2_000_000))
    session.wait_until(lambda health: health.written >= 5)
    assert session.end() == 0
    lost = [body for body in bodies(session.home.logs / "s1.jsonl") if isinstance(body, RecordsLost)]
    codes = [body.reason.code for body in lost if isinstance(body.reason, Reason)]
    assert codes == [key_of(Loss.NOT_ENCODABLE), key_of(Loss.TOO_LONG)]


def test_the_health_names_the_newest_record_on_the_medium(start: Callable[[str], Session]) -> None:
    session = start("s1")
    trail = session.home.logs / "s1.jsonl"
    for number in range(100):
        assert session.sink.emit(Note(text=str(number)))
    newest = session.wait_until(lambda health: health.written > 100 and health.waiting == 0).newest
    assert newest is not None
    written = [_record(line) for line in trail.read_bytes().splitlines()]
    (key,) = known_keys(session.home.keys)
    assert (newest.session, newest.key, newest.first_hash) == ("s1", key.fingerprint, written[0].hash)
    assert newest.sequence >= 100
    assert written[newest.sequence].hash == newest.hash
    assert session.end() == 0


def test_the_other_hosts_newest_record_is_written_with_its_clock(start: Callable[[str], Session]) -> None:
    session = start("s1")
    health = session.wait_until(lambda health: health.newest is not None)
    body = other_trail(health, offset_ns=3_600_000_000_000, uncertainty_ns=400_000)
    assert body is not None
    assert health.newest is not None
    assert session.sink.emit(body)
    assert session.end() == 0
    (found,) = [one for one in bodies(session.home.logs / "s1.jsonl") if isinstance(one, OtherTrail)]
    assert found == body
    assert (found.sequence, found.hash) == (health.newest.sequence, health.newest.hash)
    assert (found.offset_ns, found.uncertainty_ns) == (3_600_000_000_000, 400_000)


def test_nothing_is_said_of_a_trail_of_which_nothing_is_on_its_medium() -> None:
    assert other_trail(AuditHealth(at_ns=1, written=0, waiting=1), 0, 0) is None
