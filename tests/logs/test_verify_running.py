"""A session that is written, or closed, while it is verified: never called tampered for what came after the scan."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import pytest

from logs import verify as verifying
from logs.disk import Disk
from logs.keys import PublicKey
from logs.mirror import CheckpointCopy
from logs.reason import reason
from logs.records import Stop
from logs.scan import Break, Progress, Scan, scan_file
from logs.verify import Evidence, Finding, Status, verify
from logs.writer import SessionWriter
from tests.support.audit_trails import START, Trail, moment


class Running:
    """A session with a signed record, whose checkpoints are copied."""

    def __init__(self, trail: Trail, copies: Path) -> None:
        self._copy = CheckpointCopy(str(copies))
        self._writer = SessionWriter(trail.folder, "s4", trail.key, Disk(), self._copy)
        self._writer.begin(START, moment(0))
        self.path = self._writer.path
        self.stop()

    def stop(self) -> None:
        """A record that is signed at once."""
        self._writer.take(moment(1).entry(Stop(state="standing", effect="hold")))
        assert self._writer.settle(moment(1).monotonic_ns)

    def stop_and_copy(self) -> None:
        """Its checkpoint has reached the mirror."""
        self.stop()
        self._copy.close()

    def end(self) -> None:
        """Closed in good order."""
        self._writer.end("test", moment(2))
        assert self._writer.finish(moment(2))
        self._writer.close()

    def close(self) -> None:
        """Release the files."""
        self._writer.close()


@pytest.fixture
def copies(tmp_path: Path) -> Path:
    return tmp_path / "copies"


@pytest.fixture
def running(three: Trail, copies: Path) -> Iterator[Running]:
    session = Running(three, copies)
    yield session
    session.close()


Watch = Callable[..., list[Path]]


@pytest.fixture
def after_scan(monkeypatch: pytest.MonkeyPatch) -> Watch:
    """Lets this happen once, after this file's first scan; the files in the order in which they are scanned."""

    def watch(path: Path, event: Callable[[], object] = lambda: None) -> list[Path]:
        scanned = list[Path]()

        def scan(scanned_path: Path, keys: Mapping[str, PublicKey], progress: Progress | None = None) -> Scan:
            found = scan_file(scanned_path, keys, progress)
            scanned.append(scanned_path)
            if scanned_path == path and scanned.count(path) == 1:
                event()
            return found

        monkeypatch.setattr(verifying, "scan_file", scan)
        return scanned

    return watch


def judged(trail: Trail, *paths: Path, copies: Path | None = None) -> list[Finding]:
    return verify(paths, Evidence(keys=trail.keys, copies=copies))


def test_a_checkpoint_copied_since_the_scan_is_not_missing(
    three: Trail, running: Running, copies: Path, after_scan: Watch
) -> None:
    scanned = after_scan(running.path, running.stop_and_copy)
    (finding,) = judged(three, running.path, copies=copies)
    assert (finding.status, finding.records) == (Status.RUNNING, 3)
    assert scanned == [running.path]


def test_a_session_closed_since_the_scan_is_sound(three: Trail, running: Running, after_scan: Watch) -> None:
    after_scan(running.path, running.end)
    (finding,) = judged(three, running.path)
    assert (finding.status, finding.reason) == (Status.SOUND, None)
    assert finding.proven == finding.records


def test_a_session_closed_since_the_manifest_was_read_is_sound(
    three: Trail, running: Running, after_scan: Watch
) -> None:
    paths = [three.session, three.folder / "s2.jsonl", running.path]
    after_scan(paths[1], running.end)
    findings = judged(three, *paths)
    assert [(finding.status, finding.reason) for finding in findings] == [(Status.SOUND, None)] * 3


def test_what_is_changed_in_a_running_session_is_told(three: Trail, running: Running) -> None:
    data = bytearray(running.path.read_bytes())
    data[data.index(b"standing")] ^= 1
    running.path.write_bytes(data)
    (finding,) = judged(three, running.path)
    assert (finding.status, finding.reason) == (Status.TAMPERED, reason(Break.CHANGED))


def test_a_checkpoint_cut_from_a_running_session_is_told(three: Trail, running: Running, copies: Path) -> None:
    running.stop_and_copy()
    running.path.write_bytes(b"".join(running.path.read_bytes().splitlines(keepends=True)[:-2]))
    (finding,) = judged(three, running.path, copies=copies)
    assert finding.status is Status.TAMPERED


def test_a_bad_file_that_nobody_writes_is_scanned_once(three: Trail, after_scan: Watch) -> None:
    three.session.write_bytes(three.session.read_bytes()[:-10])
    scanned = after_scan(three.session)
    (finding,) = judged(three, three.session)
    assert finding.status is Status.TAMPERED
    assert scanned == [three.session]
