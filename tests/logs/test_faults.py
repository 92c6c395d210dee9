"""Disks that fill up, break and come back, and power that goes, at every single operation of the writer."""

from __future__ import annotations

import errno
import os
import shutil
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from logs import mirror
from logs.disk import Disk
from logs.findings import Remark
from logs.journal import MANIFEST, Found, append_signed
from logs.keys import ConsoleKey, by_fingerprint, load_or_make_key, read_anchors
from logs.mirror import SUFFIX, SYSLOG, CheckpointCopy, MirrorFault, copied
from logs.reason import Reason, key_of, reason
from logs.records import Body, Cancel, HeartbeatLost, Note, Press, Release
from logs.scan import scan_file
from logs.trail import DiskFault
from logs.verify import Evidence, Status, exit_status, verify
from logs.writer import SessionWriter
from tests.support.audit_trails import BODIES, START, Crash, FaultyDisk, Trail, moment, write_session

EVERY_OPERATION = 40  # more than the scenario has; test_the_scenario_is_covered holds it to that


@pytest.fixture
def folder(tmp_path: Path, key: ConsoleKey) -> Path:
    """A console's folder with a sound session in it."""
    path = tmp_path / "logs"
    path.mkdir()
    write_session(path, "before", key, Disk())
    return path


def steps(folder: Path, key: ConsoleKey, disk: Disk) -> Iterator[SessionWriter]:
    """A session, step by step, on a disk that may fail; goes on until everything is written."""
    writer = SessionWriter(folder, "s", key, disk, CheckpointCopy(""))
    writer.begin(START, moment(0))
    yield writer
    tick = 0
    for tick, body in enumerate(BODIES, start=1):
        writer.take(moment(20 * tick).entry(body))
        writer.settle_when_due(moment(20 * tick).monotonic_ns)
        yield writer
    last = moment(20 * tick + 20)
    writer.end("test", last)
    yield writer
    for _ in range(EVERY_OPERATION):
        if writer.finish(last):
            break
    writer.close()
    yield writer


def evidence(key: ConsoleKey) -> Evidence:
    return Evidence(keys=by_fingerprint([key.public]), anchors=read_anchors(key.folder))


def sound(folder: Path, key: ConsoleKey) -> bool:
    return exit_status(verify([folder], evidence(key))) == 0


def records_in(folder: Path, key: ConsoleKey) -> int:
    path = folder / "s.jsonl"
    return scan_file(path, by_fingerprint([key.public])).records if path.exists() else 0


def test_the_scenario_is_covered(folder: Path, key: ConsoleKey) -> None:
    disk = FaultyDisk()
    for _ in steps(folder, key, disk):
        pass
    assert 15 < disk.operations < EVERY_OPERATION
    assert sound(folder, key)


@pytest.mark.parametrize("error", [errno.ENOSPC, errno.EIO])
@pytest.mark.parametrize("times", [1, 3])
@pytest.mark.parametrize("fail_at", range(EVERY_OPERATION))
def test_a_disk_that_refuses_and_recovers_loses_nothing(
    folder: Path, key: ConsoleKey, fail_at: int, times: int, error: int
) -> None:
    disk = FaultyDisk(fail_at, times=times, error=error)
    for writer in steps(folder, key, disk):
        assert records_in(folder, key) >= writer.written
    assert writer.waiting == 0
    assert not writer.fault
    assert sound(folder, key)


def test_while_the_disk_refuses_its_fault_is_reported_and_nothing_counts_as_written(
    folder: Path, key: ConsoleKey
) -> None:
    disk = FaultyDisk(0, times=10_000)
    writer = SessionWriter(folder, "s", key, disk, CheckpointCopy(""))
    writer.begin(START, moment(0))
    writer.take(moment(1).entry(Note(text="kept")))
    assert not writer.settle(moment(2).monotonic_ns)
    detail = os.strerror(errno.ENOSPC)
    assert writer.fault == reason(DiskFault.NOT_WRITTEN, path=writer.path, detail=detail, waiting=writer.waiting)
    assert (writer.written, writer.waiting > 0) == (0, True)


@pytest.mark.parametrize("deleted", ["s.jsonl", MANIFEST, ""])
def test_a_trail_that_was_deleted_while_it_is_written_counts_as_not_written(
    folder: Path, key: ConsoleKey, deleted: str
) -> None:
    writer = SessionWriter(folder, "s", key, Disk(), CheckpointCopy(""))
    writer.begin(START, moment(0))
    written = writer.written
    if deleted:
        (folder / deleted).unlink()
    else:
        shutil.rmtree(folder)
    writer.take(moment(1).entry(Note(text="lost")))
    assert not writer.settle(moment(2).monotonic_ns)
    assert writer.fault is not None
    assert writer.fault.values["detail"] == os.strerror(errno.ENOENT)
    assert (writer.written, writer.waiting) == (written, 1)
    writer.close()


@pytest.mark.parametrize(
    ("body", "waits_ms"),
    [
        (Press(gesture="1"), 0),
        (Release(gesture="1"), 0),
        (Cancel(reason="too short"), 0),
        (HeartbeatLost(stream="heartbeat", age_ms=70.0), 0),
        (Note(text="later"), 50),
    ],
)
def test_how_a_press_ends_and_why_the_legs_gave_way_waits_for_nothing_else(
    folder: Path, key: ConsoleKey, body: Body, waits_ms: int
) -> None:
    writer = SessionWriter(folder, "s", key, Disk(), CheckpointCopy(""))
    writer.begin(START, moment(0))
    begun = writer.written
    taken = moment(1)
    writer.take(taken.entry(body))
    for after_ms in (0, 49, 50):
        writer.settle_when_due(taken.monotonic_ns + after_ms * 1_000_000)
        assert writer.written == begun + (after_ms >= waits_ms)
    writer.close()


@pytest.mark.parametrize("kept_share", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("fail_at", range(EVERY_OPERATION))
def test_a_crash_at_any_operation_keeps_what_was_acknowledged_and_the_next_session_explains_it(
    folder: Path, key: ConsoleKey, fail_at: int, kept_share: float
) -> None:
    disk = FaultyDisk(fail_at, crash=True)
    acknowledged = 0
    try:
        for writer in steps(folder, key, disk):
            acknowledged = writer.written
    except Crash:
        disk.lose_power(kept_share)
    assert records_in(folder, key) >= acknowledged
    before = verify([folder], evidence(key))
    assert not any(finding.status in (Status.TAMPERED, Status.UNREADABLE) for finding in before), before
    write_session(folder, "after", key, Disk())
    after = verify([folder], evidence(key))
    assert exit_status(after) == 0, after


def test_a_torn_tail_is_kept_and_recorded_by_the_next_start(folder: Path, key: ConsoleKey) -> None:
    torn = folder / "s.jsonl"
    writer = next(steps(folder, key, Disk()))
    writer.close()
    whole = torn.read_bytes()
    torn.write_bytes(whole + b'{"body":{"kind":"no')
    write_session(folder, "after", key, Disk())
    (finding,) = verify([torn], Evidence(keys=by_fingerprint([key.public])))
    assert finding.status is Status.SOUND
    found = reason(Found.TORN, records=whole.count(b"\n"), size_bytes=19)
    assert reason(Remark.RECOVERED, how=found) in finding.remarks
    assert torn.read_bytes() == whole + b'{"body":{"kind":"no'


def test_a_recovered_file_may_not_change_afterwards(folder: Path, key: ConsoleKey) -> None:
    writer = next(steps(folder, key, Disk()))
    writer.close()
    torn = folder / "s.jsonl"
    torn.write_bytes(torn.read_bytes() + b"half")
    write_session(folder, "after", key, Disk())
    torn.write_bytes(torn.read_bytes() + b"x")
    assert not sound(folder, key)
    torn.write_bytes(torn.read_bytes()[:-5])
    assert not sound(folder, key)


def test_recovery_never_launders_damage(folder: Path, key: ConsoleKey) -> None:
    for writer in steps(folder, key, Disk()):
        if writer.written > 4:
            break
    writer.close()
    path = folder / "s.jsonl"
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    write_session(folder, "after", key, Disk())
    bad = [each for each in verify([folder], evidence(key)) if each.status is Status.TAMPERED]
    assert [each.file.name for each in bad] == ["s.jsonl"]


def test_a_damaged_manifest_stays_as_it_is_and_a_new_one_is_reported(folder: Path, key: ConsoleKey) -> None:
    path = folder / "manifest.jsonl"
    data = bytearray(path.read_bytes())
    data[50] ^= 1
    path.write_bytes(data)
    write_session(folder, "after", key, Disk())
    assert path.read_bytes() == data
    assert key_of(Found.DAMAGED).encode() in (folder / "manifest-2.jsonl").read_bytes()
    assert not sound(folder, key)


@pytest.mark.parametrize("fail_at", range(8))
def test_a_journal_that_could_not_be_appended_continues_after_the_torn_tail(
    tmp_path: Path, key: ConsoleKey, fail_at: int
) -> None:
    path = tmp_path / "operators.jsonl"
    append_signed(path, "operators", [Note(text="first")], key, moment(0))
    disk = FaultyDisk(fail_at, crash=True)
    try:
        append_signed(path, "operators", [Note(text="second")], key, moment(1), disk=disk)
    except Crash:
        disk.lose_power(0.5)
    append_signed(path, "operators", [Note(text="third")], key, moment(2))
    (finding,) = verify([path], Evidence(keys=by_fingerprint([key.public])))
    assert finding.status is Status.SOUND
    assert b"third" in path.read_bytes()


@pytest.mark.parametrize("fail_at", range(16))
def test_a_key_is_whole_or_not_there(tmp_path: Path, fail_at: int) -> None:
    disk = FaultyDisk(fail_at, crash=True)
    try:
        load_or_make_key(tmp_path, disk)
    except Crash:
        disk.lose_power(0.5)
    key = load_or_make_key(tmp_path)
    assert key.public.verifies(key.sign(b"x"), b"x")
    assert (tmp_path / "console.key").stat().st_mode & 0o777 == 0o600


def test_a_copy_that_was_cut_off_spoils_no_other(trail: Trail, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write, full = os.write, iter([False, True])

    def write_half(handle: int, data: bytes) -> int:
        """The second call finds the disk full."""
        if next(full, False):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return write(handle, data[: len(data) // 2 + 1])

    with monkeypatch.context() as disk:
        disk.setattr(os, "write", write_half)
        copy = CheckpointCopy(str(tmp_path / "mirror"))
        for line in trail.manifest.read_bytes().splitlines(keepends=True):
            copy.put("s1.jsonl", line)
        copy.close(patience_s=30.0)
    (kept,) = copied(tmp_path / "mirror" / f"s1.jsonl{SUFFIX}").values()
    assert [*kept] == [1], "the second one, in several writes, though the first was cut off"


def test_a_mirror_that_hangs_is_left_behind(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / f"s.jsonl{SUFFIX}")  # opened for writing it waits for a reader that never comes
    copy = CheckpointCopy(str(tmp_path))
    while copy.fault is None:
        copy.put("s.jsonl", b"{}\n")
    assert copy.fault.code == key_of(MirrorFault.BEHIND)
    copy.close(patience_s=0.1)


def test_a_system_log_that_is_not_there_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mirror, "SYSLOG_SOCKET", str(tmp_path / "log"))

    def fault() -> Reason | None:
        copy = CheckpointCopy(SYSLOG)
        copy.put("s.jsonl", b'{"a":1}\n')
        copy.close(patience_s=30.0)
        return copy.fault

    missing = fault()
    assert missing is not None
    assert (missing.code, missing.values["target"]) == (key_of(MirrorFault.NOT_COPIED), SYSLOG)
    assert missing.values["detail"] == os.strerror(errno.ENOENT)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as log:
        log.bind(mirror.SYSLOG_SOCKET)
        assert fault() is None
        assert log.recv(100) == b'<14>rleex: s.jsonl {"a":1}\0'
