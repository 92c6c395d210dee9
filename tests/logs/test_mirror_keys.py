"""By whose keys a trail is compared with the mirror: a home that was written anew, or put back, disagrees with it."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from logs.disk import Disk
from logs.findings import Remark, Verdict
from logs.journal import OPERATORS, append_signed
from logs.keys import KEY_FILE, ConsoleKey, by_fingerprint, known_keys, load_or_make_key
from logs.mirror import SUFFIX, CheckpointCopy
from logs.reason import key_of
from logs.records import Note, SignIn
from logs.verify import Evidence, Finding, Status, exit_status, verify
from logs.writer import SessionWriter
from tests.support.audit_trails import START, Trail, moment, write_session
from tests.support.two_trails import UnsyncedDisk


def codes(finding: Finding) -> set[str]:
    return {remark.code for remark in finding.remarks} | ({finding.reason.code} if finding.reason else set())


def copy_to_mirror(mirror: Path, session: Path) -> None:
    """Its last checkpoint, as the mirror gets it."""
    mirror.mkdir(exist_ok=True)
    with (mirror / (session.name + SUFFIX)).open("ab") as copy:
        copy.write(session.read_bytes().splitlines(keepends=True)[-1])


def unsigned_session(folder: Path, key: ConsoleKey) -> Path:
    """The session s1 of a console that died before its first checkpoint."""
    folder.mkdir()
    writer = SessionWriter(folder, "s1", key, UnsyncedDisk(), CheckpointCopy(""))
    writer.begin(START, moment(0))
    writer.take(moment(1).entry(Note(text="begun")))
    assert writer.settle(moment(1).monotonic_ns)
    writer.close()
    return writer.path


@pytest.mark.parametrize(
    ("former_key_kept", "status", "code"),
    [
        (True, Status.TAMPERED, key_of(Verdict.CHECKPOINT_MISSING)),
        (False, Status.SOUND, key_of(Remark.MIRROR_OF_OTHERS)),
    ],
)
def test_a_home_written_anew_with_a_fresh_key_disagrees_with_the_mirror(
    trail: Trail, tmp_path: Path, former_key_kept: bool, status: Status, code: str
) -> None:
    mirror, keys = tmp_path / "mirror", trail.key.folder
    copy_to_mirror(mirror, trail.session)
    (keys / KEY_FILE).unlink()
    fresh = load_or_make_key(keys)  # it keeps the former public half
    if not former_key_kept:
        for former in keys.glob("console-*.pub"):
            former.unlink()
    shutil.rmtree(trail.folder)
    trail.folder.mkdir()
    write_session(trail.folder, "s1", fresh, Disk(), (Note(text="nothing happened"),))
    found = verify([trail.folder], Evidence(keys=by_fingerprint(known_keys(keys)), copies=mirror))
    (session,) = (finding for finding in found if finding.file == trail.session)
    assert session.status is status
    assert code in codes(session)
    assert key_of(Remark.NO_MIRROR) not in codes(session)


def test_a_trail_without_a_signature_yet_is_not_the_other_computers(trail: Trail, tmp_path: Path) -> None:
    mirror, key = tmp_path / "mirror", load_or_make_key(tmp_path / "other")
    copy_to_mirror(mirror, trail.session)
    path = unsigned_session(tmp_path / "unsigned", key)
    both = trail.keys | by_fingerprint([key.public])
    (found,) = verify([path], Evidence(keys=both, copies=mirror))
    assert found.status is Status.INCOMPLETE
    assert key_of(Remark.MIRROR_OF_OTHERS) in codes(found)
    write_session(path.parent, "s2", key, Disk())  # the next start signs how s1 was found
    (found,) = verify([path], Evidence(keys=both, copies=mirror))
    assert found.status is Status.SOUND
    assert codes(found) == {key_of(Remark.RECOVERED), key_of(Remark.MIRROR_OF_OTHERS)}
    whole = tmp_path / "whole"
    whole.mkdir()
    copy_to_mirror(mirror, write_session(whole, "s1", key, Disk()))
    (found,) = verify([path], Evidence(keys=both, copies=mirror))
    assert (found.status, key_of(Verdict.CHECKPOINT_MISSING) in codes(found)) == (Status.TAMPERED, True)


def test_a_trail_without_its_signatures_and_manifest_disagrees_with_the_only_known_keys_copies(
    trail: Trail, tmp_path: Path
) -> None:
    mirror = tmp_path / "mirror"
    copy_to_mirror(mirror, trail.session)
    path = unsigned_session(tmp_path / "unsigned", trail.key)
    alone = path.rename(tmp_path / path.name)
    (found,) = verify([alone], Evidence(keys=trail.keys, copies=mirror))
    assert (found.status, key_of(Verdict.CHECKPOINT_MISSING) in codes(found)) == (Status.TAMPERED, True)


def test_a_home_put_back_to_before_its_first_session_is_missed_by_the_mirror(trail: Trail, tmp_path: Path) -> None:
    mirror = tmp_path / "mirror"
    copy_to_mirror(mirror, trail.session)
    append_signed(trail.folder / OPERATORS, "operators", [SignIn(name="ann", role="engineer")], trail.key, moment(0))
    trail.session.unlink()
    trail.manifest.unlink()
    found = verify([trail.folder], Evidence(keys=trail.keys, copies=mirror))
    assert exit_status(found) == 1
    bad = {finding.file.name: finding.reason.code for finding in found if finding.reason}
    assert bad == {trail.session.name: key_of(Verdict.MISSING_BY_MIRROR)}


def test_a_home_before_its_first_session_does_not_miss_the_other_computers_sessions(
    trail: Trail, tmp_path: Path
) -> None:
    mirror, key = tmp_path / "mirror", load_or_make_key(tmp_path / "other")
    copy_to_mirror(mirror, trail.session)
    folder = tmp_path / "new"
    append_signed(folder / OPERATORS, "operators", [SignIn(name="ann", role="engineer")], key, moment(0))
    found = verify([folder], Evidence(keys=trail.keys | by_fingerprint([key.public]), copies=mirror))
    assert [(finding.file.name, finding.status) for finding in found] == [(OPERATORS, Status.SOUND)]
