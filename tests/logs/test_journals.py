"""The ends of the files that grow over many starts: nothing at all can be taken from them unseen."""

from __future__ import annotations

import fcntl
import os
import shutil
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import msgspec
import pytest
from typer.testing import CliRunner

from app.cli import cli
from app.text.catalogue import use_language
from logs import manifest as manifests
from logs.disk import Disk
from logs.findings import Remark, Verdict
from logs.journal import (
    CHANGES,
    COMMENTS,
    MANIFEST,
    OPERATORS,
    Found,
    Misplaced,
    append_signed,
    found_torn,
    is_journal,
    parts_of,
)
from logs.keys import ANCHOR_FOLDER, PUBLIC_FILE, ConsoleKey, by_fingerprint, read_anchors
from logs.line import GENESIS, canonical, seal, unseal
from logs.read import records
from logs.reason import Reason, key_of
from logs.records import Body, Comment, LogRecovered, Note, Payload
from logs.scan import Scan, scan_file
from logs.verify import Evidence, Finding, Status, exit_status, verify
from tests.support.audit_trails import Trail, moment, write_session

JOURNALS = (OPERATORS, CHANGES, f"s1{COMMENTS}", MANIFEST)


def body_for(name: str, key: ConsoleKey, text: str) -> Body:
    if name.endswith(COMMENTS):
        return Comment(about_sequence=0, about_hash=GENESIS, text=text, key=key.public.fingerprint)
    return Note(text=text)


def append(folder: Path, name: str, key: ConsoleKey, text: str) -> None:
    if name == MANIFEST:
        write_session(folder, text, key, Disk())
    else:
        session = f"comments {name.removesuffix(COMMENTS)}" if name.endswith(COMMENTS) else "journal"
        append_signed(folder / name, session, [body_for(name, key, text)], key, moment(0))


def judged(folder: Path, key: ConsoleKey) -> list[Finding]:
    return verify([folder], Evidence(keys=by_fingerprint([key.public]), anchors=read_anchors(key.folder)))


@pytest.fixture
def journals(trail: Trail) -> Trail:
    """Three entries in each journal."""
    for name in JOURNALS:
        for number in range(3):
            append(trail.folder, name, trail.key, f"entry-{number}")
    assert exit_status(judged(trail.folder, trail.key)) == 0
    return trail


@pytest.mark.parametrize("name", JOURNALS)
def test_a_journal_cut_anywhere_is_told(journals: Trail, name: str) -> None:
    path = journals.folder / name
    data = path.read_bytes()
    ends = [place + 1 for place, byte in enumerate(data) if byte == ord("\n")][:-1]
    for length in sorted({0, *range(0, len(data), 97), *ends, *(end + 9 for end in ends), len(data) - 1}):
        path.write_bytes(data[:length])
        findings = judged(journals.folder, journals.key)
        assert exit_status(findings) == 1, length
        (bad,) = (finding for finding in findings if finding.file == path)
        unended = length == len(data) - 1  # a crash loses the line end of what the anchor names, too
        expected = (Status.INCOMPLETE, Verdict.TORN) if unended else (Status.TAMPERED, Verdict.JOURNAL_CUT)
        assert (bad.status, bad.reason and bad.reason.code) == (expected[0], key_of(expected[1]))
        assert exit_status(verify([path], Evidence(keys=journals.keys, anchors=read_anchors(journals.key.folder)))) == 1


@pytest.mark.parametrize("name", JOURNALS)
def test_a_journal_overwritten_with_something_else_was_tampered_with(journals: Trail, name: str) -> None:
    (journals.folder / name).write_bytes(b"garbage\n")
    findings = judged(journals.folder, journals.key)
    assert exit_status(findings) == 1
    assert Status.TAMPERED in {finding.status for finding in findings if finding.file.name == name}


@pytest.mark.parametrize(("language", "warned"), [("en", "would NOT be noticed"), ("zh", "将无法发现")])
def test_a_copy_without_the_ends_says_that_it_can_not_tell_a_cut(
    journals: Trail, tmp_path: Path, language: str, warned: str
) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(journals.folder, copy)
    lines = (copy / CHANGES).read_bytes().splitlines(keepends=True)
    (copy / CHANGES).write_bytes(b"".join(lines[:-2]))  # with its signature
    public = journals.key.folder / PUBLIC_FILE
    arguments = ["--language", language, "audit", "verify"]
    try:
        copied = CliRunner().invoke(
            cli, [*arguments, str(copy), "--key", str(public), "--home", str(tmp_path / "none")]
        )
    finally:
        use_language("en")
    assert (copied.exit_code, copied.output.count(warned)) == (0, len(JOURNALS))
    codes = {remark.code for finding in judged(journals.folder, journals.key) for remark in finding.remarks}
    assert key_of(Remark.END_NOT_KNOWN) not in codes


@pytest.mark.parametrize("name", JOURNALS)
def test_a_journal_that_is_gone_is_told(journals: Trail, name: str) -> None:
    (journals.folder / name).unlink()
    findings = judged(journals.folder, journals.key)
    assert exit_status(findings) == 1
    assert (journals.folder / name) in {finding.file for finding in findings if finding.status is Status.TAMPERED}


def _cut(path: Path) -> None:
    path.write_bytes(b"".join(path.read_bytes().splitlines(keepends=True)[:2]))


def _cut_and_named(path: Path) -> None:
    """Cut; behind it a torn line that only names the hash of the record that was last."""
    lines = path.read_bytes().splitlines(keepends=True)
    forged = msgspec.json.encode({"body": {"x": 1}, "hash": msgspec.json.decode(lines[-1])["hash"]})
    path.write_bytes(b"".join(lines[:2]) + forged + b"\n")


def _damage(path: Path) -> None:
    path.write_bytes(path.read_bytes().replace(b"entry-1", b"ENTRY-1"))


@pytest.mark.parametrize(
    ("tamper", "found"),
    [(_cut, Found.CUT), (_cut_and_named, Found.CUT), (_damage, Found.DAMAGED), (Path.unlink, Found.MISSING)],
)
@pytest.mark.parametrize("name", JOURNALS)
def test_going_on_hides_nothing(journals: Trail, name: str, tamper: Callable[[Path], None], found: Found) -> None:
    path = journals.folder / name
    tamper(path)
    left = path.read_bytes() if path.exists() else None
    for text in ("later", "later-2"):
        append(journals.folder, name, journals.key, text)
    assert (path.read_bytes() if path.exists() else None) == left
    behind = parts_of(path)[-1]
    assert behind.name == f"{path.stem}-2.jsonl"
    first = records(behind)[0].body
    assert isinstance(first, LogRecovered)
    assert isinstance(first.text, Reason)
    assert (first.file, first.text.code) == (name, key_of(found))
    findings = {finding.file.name: finding.status for finding in judged(journals.folder, journals.key)}
    assert findings[name] is Status.TAMPERED
    assert findings[behind.name] is Status.SOUND


@pytest.mark.parametrize(
    ("source", "target", "found"),
    [
        (CHANGES, "changes-2.jsonl", Misplaced.PART_ADDED),
        (OPERATORS, "operators-7.jsonl", Misplaced.PART_ADDED),
        (MANIFEST, "manifest-2.jsonl", Misplaced.PART_ADDED),
        (f"s1{COMMENTS}", "s1.comments-2.jsonl", Misplaced.PART_ADDED),
        (f"s1{COMMENTS}", f"s2{COMMENTS}", Misplaced.COMMENTS_OF_OTHER),
    ],
)
def test_a_copied_journal_is_told(journals: Trail, source: str, target: str, found: Misplaced) -> None:
    shutil.copy(journals.folder / source, journals.folder / target)
    bad = [finding for finding in judged(journals.folder, journals.key) if finding.status is not Status.SOUND]
    assert [(each.file.name, each.status, each.reason and each.reason.code) for each in bad] == [
        (target, Status.TAMPERED, key_of(found))
    ]


def test_a_next_part_copied_further_is_told(journals: Trail) -> None:
    (journals.folder / CHANGES).unlink()
    append(journals.folder, CHANGES, journals.key, "later")
    shutil.copy(journals.folder / "changes-2.jsonl", journals.folder / "changes-3.jsonl")
    found = {finding.file.name: finding for finding in judged(journals.folder, journals.key)}
    assert found["changes-2.jsonl"].status is Status.SOUND
    assert (found["changes-3.jsonl"].reason or Reason("")).code == key_of(Misplaced.PART_ADDED)


def test_a_next_part_whose_first_record_was_torn_is_sound_again_with_the_next(journals: Trail) -> None:
    (journals.folder / "changes-2.jsonl").write_bytes(b'{"body":{"kind":"log-')
    append(journals.folder, CHANGES, journals.key, "later")
    found = {finding.file.name: finding.status for finding in judged(journals.folder, journals.key)}
    assert found["changes-2.jsonl"] is Status.SOUND


@pytest.mark.parametrize("name", JOURNALS)
def test_a_next_part_that_was_created_and_not_written_begins_with_how_the_part_before_was_found(
    journals: Trail, name: str
) -> None:
    path = journals.folder / name
    _damage(path)
    behind = path.with_name(f"{path.stem}-2.jsonl")
    behind.touch()  # the disk was full, or the process died
    append(journals.folder, name, journals.key, "later")
    assert parts_of(path) == [path, behind]
    first = records(behind)[0].body
    assert isinstance(first, LogRecovered)
    assert first.file == name
    found = {finding.file.name: finding.status for finding in judged(journals.folder, journals.key)}
    assert (found[name], found[behind.name]) == (Status.TAMPERED, Status.SOUND)


@pytest.mark.parametrize("settled", [True, False])
@pytest.mark.parametrize("name", JOURNALS)
def test_a_journal_that_lost_its_last_line_end_goes_on_behind_it(journals: Trail, name: str, settled: bool) -> None:
    path = journals.folder / name
    if not settled:  # the power went before the console remembered the record
        shutil.copytree(journals.key.folder / ANCHOR_FOLDER, journals.folder.parent / "before")
        append(journals.folder, name, journals.key, "newest")
        shutil.rmtree(journals.key.folder / ANCHOR_FOLDER)
        shutil.copytree(journals.folder.parent / "before", journals.key.folder / ANCHOR_FOLDER)
    whole = path.read_bytes()
    path.write_bytes(whole[:-1])
    append(journals.folder, name, journals.key, "later")
    assert path.read_bytes().startswith(whole)
    assert b"log-recovered" not in path.read_bytes()
    assert {finding.status for finding in judged(journals.folder, journals.key)} == {Status.SOUND}


def test_a_record_in_a_torn_stretch_that_is_explained_is_none(tmp_path: Path, key: ConsoleKey) -> None:
    """The power went: of the last write the first record never reached the disk, and the line end of the second."""
    path, anchors, before = tmp_path / CHANGES, key.folder / ANCHOR_FOLDER, tmp_path / "before"
    append(tmp_path, CHANGES, key, "kept")
    size = path.stat().st_size
    shutil.copytree(anchors, before)
    append(tmp_path, CHANGES, key, "lost")
    data = path.read_bytes()
    end = data.index(b"\n", size)
    path.write_bytes(data[:size] + bytes(end - size) + data[end:-1])
    shutil.rmtree(anchors)
    shutil.copytree(before, anchors)
    append(tmp_path, CHANGES, key, "later")
    (finding,) = verify([path], Evidence(keys=by_fingerprint([key.public]), anchors=read_anchors(key.folder)))
    assert (finding.status, parts_of(path)) == (Status.SOUND, [path])
    assert key_of(Remark.TEARS_EXPLAINED) in {remark.code for remark in finding.remarks}
    found = records(path)
    assert [record.sequence for record in found] == list(range(finding.records))
    assert [record.body.text for record in found if isinstance(record.body, Note)] == ["kept", "later"]


@pytest.mark.parametrize("tail", ["changed", "without line end", "whole"])
def test_a_forged_end_in_a_torn_manifest_ends_nothing(three: Trail, tail: str) -> None:
    """By who writes the trails alone: a session that was cut, and at the manifest's end how it was found, unsigned."""
    whole = three.session.read_bytes().splitlines(keepends=True)
    three.session.write_bytes(b"".join(whole[:3]))
    newest = records(three.manifest)[-1]
    values = {name: getattr(newest, name) for name in Payload.__struct_fields__}
    values["body"] = found_torn(three.session.name, scan_file(three.session, {}), three.key)
    line, _ = seal(canonical(Payload(**values | {"sequence": newest.sequence + 1, "previous": newest.hash})))
    with three.manifest.open("ab") as file:
        file.write({"changed": line[:-4] + b'0"}', "without line end": line[:-1], "whole": line}[tail])
    write_session(three.folder, "s4", three.key, Disk())
    found = {finding.file.name: finding.status for finding in judged(three.folder, three.key)}
    assert found["s1.jsonl"] is Status.TAMPERED
    assert (found["s3.jsonl"], found["s4.jsonl"]) == (Status.SOUND, Status.SOUND)
    assert found["manifest.jsonl"] is (Status.TAMPERED if tail == "whole" else Status.SOUND)


def test_what_reads_like_a_record_in_a_torn_stretch_is_none(journals: Trail) -> None:
    path = journals.folder / CHANGES
    forged = path.read_bytes().splitlines()[0].replace(b"entry-0", b"forged")
    with path.open("ab") as file:
        file.write(forged)
    append(journals.folder, CHANGES, journals.key, "later")
    assert {finding.status for finding in judged(journals.folder, journals.key)} == {Status.SOUND}
    texts = [record.body.text for record in records(path) if isinstance(record.body, Note)]
    assert texts == ["entry-0", "entry-1", "entry-2", "later"]


def test_an_empty_part_behind_a_sound_one_is_not_gone_on_with(journals: Trail) -> None:
    (journals.folder / "changes-2.jsonl").touch()
    append(journals.folder, CHANGES, journals.key, "later")
    assert (journals.folder / "changes-2.jsonl").read_bytes() == b""
    assert exit_status(judged(journals.folder, journals.key)) == 0


def test_comments_on_a_sessions_further_file_name_the_session(journals: Trail) -> None:
    comment = body_for(COMMENTS, journals.key, "seen")
    append_signed(journals.folder / f"s1-2{COMMENTS}", "comments s1", [comment], journals.key, moment(0))
    assert exit_status(judged(journals.folder, journals.key)) == 0


def test_who_appends_at_the_same_time_waits(tmp_path: Path, key: ConsoleKey) -> None:
    path = tmp_path / CHANGES
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda number: append(tmp_path, CHANGES, key, f"{number}"), range(40)))
    texts = {record.body.text for record in records(path) if isinstance(record.body, Note)}
    assert texts == {f"{number}" for number in range(40)}
    assert exit_status(judged(tmp_path, key)) == 0


def test_a_reader_that_probes_for_a_writer_is_waited_for(
    tmp_path: Path, key: ConsoleKey, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / CHANGES
    append(tmp_path, CHANGES, key, "before")
    reader = os.open(path, os.O_RDONLY)
    fcntl.flock(reader, fcntl.LOCK_SH)  # as is_being_written does
    with pytest.raises(BlockingIOError):
        Disk().open_existing(path)
    with monkeypatch.context() as waiting:
        waiting.setattr(time, "sleep", lambda _: os.close(reader))  # the reader ends while the writer waits
        append(tmp_path, CHANGES, key, "after")
    assert [record.body.text for record in records(path) if isinstance(record.body, Note)] == ["before", "after"]


def test_a_home_of_before_has_no_ends_and_gets_them_with_its_next_entries(journals: Trail) -> None:
    newest = read_anchors(journals.key.folder)[MANIFEST]
    for path in (journals.key.folder / ANCHOR_FOLDER).iterdir():
        path.unlink()
    (journals.key.folder / "history.json").write_bytes(msgspec.json.encode(newest))
    assert exit_status(judged(journals.folder, journals.key)) == 0
    for name in JOURNALS:
        append(journals.folder, name, journals.key, "later")
    assert set(read_anchors(journals.key.folder)) == set(JOURNALS)
    assert exit_status(judged(journals.folder, journals.key)) == 0


def test_only_names_that_a_part_can_have_are_parts(tmp_path: Path) -> None:
    for name in ("manifest.jsonl", "manifest-2.jsonl", "manifest-10.jsonl"):
        (tmp_path / name).touch()
        assert is_journal(tmp_path / name)
    for name in ("manifest-1.0.jsonl", "manifest-02.jsonl", "manifest-x.jsonl", "manifest-1.jsonl", "s1.jsonl"):
        (tmp_path / name).touch()
        assert not is_journal(tmp_path / name)
    assert [part.name for part in parts_of(tmp_path / MANIFEST)] == [
        "manifest.jsonl",
        "manifest-2.jsonl",
        "manifest-10.jsonl",
    ]


@pytest.mark.parametrize("number", [b'"records":', b'"sequence":', b'"schema":', b'"monotonic_ns":'])
def test_a_number_of_the_manifest_written_otherwise_is_told(three: Trail, number: bytes) -> None:
    data = three.manifest.read_bytes()
    at = data.rindex(number) + len(number)
    end = at + next(place for place, byte in enumerate(data[at:]) if not chr(byte).isdigit())
    for written in (b"1.0", b"1e300", b"-0", b"9" * 5000, b"9" * 400, b"9" * 19, data[at:end] + b".0"):
        three.manifest.write_bytes(data[:at] + written + data[end:])
        assert exit_status(judged(three.folder, three.key)) == 1
        resealed = _resealed(data[:at] + written + data[end:], three.key)
        three.manifest.write_bytes(resealed)
        assert exit_status(judged(three.folder, three.key)) == 1


def _resealed(data: bytes, key: ConsoleKey) -> bytes:
    """Each line with the right hash and place in the chain, as far as it is a record; without the key's signature."""
    out, previous = [], GENESIS
    for line in data.splitlines(keepends=True):
        parts = unseal(line)
        assert parts is not None
        payload = parts[0].replace(
            parts[0][parts[0].index(b'"previous":"') :][:77], b'"previous":"%s"' % previous.encode()
        )
        sealed, previous = seal(payload)
        out.append(sealed)
    return b"".join(out)


def test_the_manifest_is_read_once_however_many_sessions_it_names(
    three: Trail, monkeypatch: pytest.MonkeyPatch
) -> None:
    read: list[Path] = []

    def counted(path: Path, *arguments: object) -> Scan:
        read.append(path)
        return scan_file(path, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(manifests, "scan_file", counted)
    assert exit_status(judged(three.folder, three.key)) == 0
    assert read == [three.manifest]
