"""Every way to change, cut or add that we can enumerate is caught."""

from __future__ import annotations

import io
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from logs.disk import Disk
from logs.findings import Remark, Verdict
from logs.journal import found_torn, open_part
from logs.keys import ConsoleKey, load_or_make_key, read_anchors
from logs.line import GENESIS, canonical, seal, signed_message, unseal
from logs.reason import key_of, reason
from logs.records import Checkpoint, LogClosed, LogOpened, Note, Payload
from logs.scan import Break, Scan, scan_stream
from logs.trail import open_logger
from logs.verify import Evidence, Finding, Status, exit_status, verify
from tests.support.audit_trails import BODIES, Trail, moment, write_session


def scan(data: bytes, trail: Trail) -> Scan:
    return scan_stream(io.BytesIO(data), trail.keys)


def assess(trail: Trail, path: Path | None = None) -> list[Finding]:
    return verify([path or trail.folder], Evidence(keys=trail.keys, anchors=read_anchors(trail.key.folder)))


def the_bad(trail: Trail) -> list[Finding]:
    return [finding for finding in assess(trail) if finding.status is not Status.SOUND]


def codes(finding: Finding) -> set[Remark]:
    return {each for each in Remark if any(remark.code == key_of(each) for remark in finding.remarks)}


def lines_of(path: Path) -> list[bytes]:
    return path.read_bytes().splitlines(keepends=True)


def test_an_untouched_trail_is_sound_and_proven_to_its_last_record(three: Trail) -> None:
    findings = assess(three)
    assert {finding.status for finding in findings} == {Status.SOUND}
    assert all(finding.proven == finding.records > 0 for finding in findings)
    assert exit_status(findings) == 0


@pytest.mark.parametrize("which", ["session", "manifest"])
def test_every_flipped_bit_is_caught(tmp_path: Path, key: ConsoleKey, which: str) -> None:
    trail = Trail(tmp_path, write_session(tmp_path, "s1", key, Disk(), BODIES[:1]), key)
    data = bytearray(getattr(trail, which).read_bytes())
    records = scan(bytes(data), trail).records
    for place in range(len(data)):
        for bit in range(8):
            data[place] ^= 1 << bit
            found = scan(bytes(data), trail)
            assert found.fault is not None, (place, bit)
            assert found.records < records
            data[place] ^= 1 << bit


def test_a_flipped_bit_is_named_with_its_line_and_reason(trail: Trail) -> None:
    data = bytearray(trail.session.read_bytes())
    place = data.index(b"right leg forward")
    data[place] ^= 1
    trail.session.write_bytes(data)
    (bad,) = the_bad(trail)
    line = bytes(data[:place]).count(b"\n") + 1
    assert (bad.status, bad.line) == (Status.TAMPERED, line)
    assert bad.reason == reason(Break.CHANGED)
    assert exit_status([bad]) == 1


@pytest.mark.parametrize("which", ["session", "manifest"])
def test_every_removed_duplicated_or_swapped_record_is_caught(three: Trail, which: str) -> None:
    path: Path = getattr(three, which)
    whole = lines_of(path)
    for place in range(len(whole)):
        removed = whole[:place] + whole[place + 1 :]
        doubled = whole[: place + 1] + whole[place:]
        swaps = (
            [*whole[:place], whole[other], *whole[place + 1 : other], whole[place], *whole[other + 1 :]]
            for other in range(place + 1, len(whole))
        )
        for changed in (removed, doubled, *swaps):
            path.write_bytes(b"".join(changed))
            assert the_bad(three), (which, place)


def test_every_length_of_cut_tail_is_caught(trail: Trail) -> None:
    data = trail.session.read_bytes()
    for length in range(len(data)):
        found = scan(data[:length], trail)
        assert not found.closed, length
        assert found.fault is None or found.is_torn, length


def test_a_cut_tail_is_reported_with_and_without_the_manifest(trail: Trail) -> None:
    whole = lines_of(trail.session)
    for keep in range(len(whole)):
        trail.session.write_bytes(b"".join(whole[:keep]) + whole[keep][:10])
        (bad,) = the_bad(trail)
        assert (bad.status, bad.records) == (Status.TAMPERED, keep)
        alone = trail.folder.parent / "alone.jsonl"
        alone.write_bytes(trail.session.read_bytes())
        (bad,) = assess(trail, alone)
        assert bad.status is Status.INCOMPLETE
        assert exit_status([bad]) > 0


def test_a_cut_manifest_is_caught_wherever_it_is_cut(three: Trail) -> None:
    data = three.manifest.read_bytes()
    ends = [place + 1 for place, byte in enumerate(data) if byte == ord("\n")][:-1]
    for length in sorted({*range(0, len(data), 41), *ends, *(end - 1 for end in ends), *(end + 1 for end in ends)}):
        three.manifest.write_bytes(data[:length])
        assert the_bad(three), length


def forged(path: Path, change: Callable[[Payload], Payload], key: ConsoleKey | None = None) -> bytes:
    """The whole chain made anew over changed records: by who has no key, or by who has one of their own."""
    out, previous = [], GENESIS
    for number, line in enumerate(lines_of(path)):
        parts = unseal(line)
        assert parts is not None
        payload = change(msgspec.json.decode(parts[0], type=Payload))
        payload = msgspec.structs.replace(payload, previous=previous, sequence=number)
        if key is not None and isinstance(payload.body, Checkpoint | LogOpened | LogClosed):
            blank = msgspec.structs.replace(payload.body, key=key.public.fingerprint, signature="")
            payload = msgspec.structs.replace(payload, body=blank)
            signature = key.sign(signed_message(canonical(payload)))
            payload = msgspec.structs.replace(payload, body=msgspec.structs.replace(blank, signature=signature))
        sealed, previous = seal(canonical(payload))
        out.append(sealed)
    return b"".join(out)


def whitewash(payload: Payload) -> Payload:
    if isinstance(payload.body, Note):
        return msgspec.structs.replace(payload, body=Note(text="nothing happened"))
    return payload


def test_forging_is_done_right_so_that_its_tests_can_fail(trail: Trail) -> None:
    assert forged(trail.session, lambda payload: payload, trail.key) == trail.session.read_bytes()
    assert scan(forged(trail.session, whitewash, trail.key), trail).fault is None


def test_a_chain_recomputed_without_the_key_breaks_at_its_first_signature(trail: Trail) -> None:
    trail.session.write_bytes(forged(trail.session, whitewash))
    (bad,) = the_bad(trail)
    assert bad.status is Status.TAMPERED
    assert bad.reason == reason(Break.BAD_SIGNATURE, key=trail.key.public.fingerprint[:8])


def test_a_chain_signed_with_somebody_elses_key_is_refused(trail: Trail, tmp_path: Path) -> None:
    other = load_or_make_key(tmp_path / "other")
    trail.session.write_bytes(forged(trail.session, whitewash, other))
    (bad,) = the_bad(trail)
    assert bad.status is Status.TAMPERED
    assert bad.reason == reason(Verdict.KEY_NOT_KNOWN, keys=other.public.fingerprint[:12])


def test_even_with_the_key_a_rewritten_session_disagrees_with_the_manifest(trail: Trail) -> None:
    trail.session.write_bytes(forged(trail.session, whitewash, trail.key)[:-10])
    assert the_bad(trail)


def test_an_end_recorded_with_somebody_elses_key_ends_nothing(trail: Trail, tmp_path: Path) -> None:
    """The session alone is verified: its folder's manifest, which names that key, is not."""
    kept = [line for line in lines_of(trail.session) if b'"kind":"checkpoint"' not in line]
    trail.session.write_bytes(b"".join(kept))
    trail.session.write_bytes(forged(trail.session, whitewash))
    other = load_or_make_key(tmp_path / "other")
    part, chain = open_part(trail.manifest, scan(trail.manifest.read_bytes(), trail), other, Disk())
    found = found_torn(trail.session.name, scan(trail.session.read_bytes(), trail), other)
    open_logger(part, chain, "manifest").record(moment(99).entry(found))
    assert part.settle()
    part.close()
    (bad,) = assess(trail, trail.session)
    assert bad.status is Status.TAMPERED
    assert bad.reason is not None
    assert bad.reason.code == key_of(Verdict.NOT_AS_CLOSED)


def test_a_chain_without_its_checkpoints_is_refused(trail: Trail) -> None:
    kept = [line for line in lines_of(trail.session) if b'"kind":"checkpoint"' not in line]
    trail.session.write_bytes(b"".join(kept))
    trail.session.write_bytes(forged(trail.session, whitewash))
    (bad,) = the_bad(trail)
    assert bad.status is Status.TAMPERED
    (alone,) = verify([trail.session.rename(trail.folder.parent / "alone.jsonl")], Evidence(keys=trail.keys))
    assert alone.status is Status.INCOMPLETE


@pytest.mark.parametrize("name", ["s1", "s2", "s3"])
def test_a_missing_file_is_named(three: Trail, name: str) -> None:
    (three.folder / f"{name}.jsonl").unlink()
    (bad,) = the_bad(three)
    assert bad.file.name == f"{name}.jsonl"
    assert bad.reason == reason(Verdict.MISSING_BY_MANIFEST)


@pytest.mark.parametrize("name", ["s1", "s2", "s3"])
def test_a_file_dropped_from_the_manifest_is_caught(three: Trail, name: str) -> None:
    kept = [line for line in lines_of(three.manifest) if f'"{name}.jsonl"'.encode() not in line]
    three.manifest.write_bytes(b"".join(kept))
    three.manifest.write_bytes(forged(three.manifest, lambda payload: payload))
    (three.folder / f"{name}.jsonl").unlink()
    assert the_bad(three)


def without(trail: Trail, entry: type[LogOpened | LogClosed], name: str) -> None:
    """The manifest without the entries of this kind about this file, signed anew by who has the key."""
    kept = []
    for line in lines_of(trail.manifest):
        parts = unseal(line)
        assert parts is not None
        body = msgspec.json.decode(parts[0], type=Payload).body
        if not (isinstance(body, entry) and body.file == name):
            kept.append(line)
    trail.manifest.write_bytes(b"".join(kept))
    trail.manifest.write_bytes(forged(trail.manifest, lambda payload: payload, trail.key))


def test_even_with_the_key_a_session_dropped_from_the_manifest_is_missed_by_the_next_one(three: Trail) -> None:
    without(three, LogOpened, "s1.jsonl")
    without(three, LogClosed, "s1.jsonl")
    (three.folder / "s1.jsonl").unlink()
    findings = verify([three.folder], Evidence(keys=three.keys))
    bad = {one.file.name: one.reason for one in findings if one.status is Status.TAMPERED}
    assert bad["s2.jsonl"] == reason(Verdict.HISTORY_MISSING)


@pytest.mark.parametrize(
    ("records", "torn_bytes", "verdict"),
    [
        (None, 0, Verdict.CLOSE_NOT_IN_MANIFEST),
        (3, 0, Verdict.NOT_CLOSED),
        (3, 10, Verdict.NOT_CLOSED_TORN),
    ],
)
def test_a_session_whose_end_the_manifest_does_not_know_is_incomplete_and_says_how(
    trail: Trail, records: int | None, torn_bytes: int, verdict: Verdict
) -> None:
    without(trail, LogClosed, trail.session.name)
    lines = lines_of(trail.session)
    if records is not None:
        trail.session.write_bytes(b"".join([*lines[:records], lines[records][:torn_bytes]]))
    (finding,) = (one for one in verify([trail.folder], Evidence(keys=trail.keys)) if one.file == trail.session)
    assert finding.status is Status.INCOMPLETE
    assert finding.reason is not None
    assert finding.reason.code == key_of(verdict)


def test_a_missing_manifest_is_caught(trail: Trail) -> None:
    trail.manifest.unlink()
    assert [bad.file.name for bad in the_bad(trail)] == ["manifest.jsonl"]
    trail.session.unlink()
    assert [bad.file.name for bad in the_bad(trail)] == ["manifest.jsonl"]


def test_a_record_without_line_end_in_a_torn_end_leaves_it_torn(trail: Trail) -> None:
    """A crash: the record before it never reached the disk."""
    lines = lines_of(trail.session)
    torn = b"".join(lines[:3]) + bytes(len(lines[3]) - 1) + b"\n" + lines[4][:-1]
    for data, is_torn in ((torn, True), (torn + b"\n", False)):
        found = scan(data, trail)
        assert (found.records, found.is_torn) == (3, is_torn)


@pytest.mark.parametrize("make", [Path.mkdir, os.mkfifo, lambda path: path.symlink_to(path)])
def test_an_unreadable_manifest_is_named_and_each_session_judged_by_itself(
    three: Trail, make: Callable[[Path], None]
) -> None:
    (three.folder / "s2.jsonl").write_bytes(b"".join(lines_of(three.folder / "s2.jsonl")[:-1]))
    three.manifest.unlink()
    make(three.manifest)
    found = assess(three)
    assert [(finding.file.name, finding.status) for finding in found][:4] == [
        ("manifest.jsonl", Status.UNREADABLE),
        ("s1.jsonl", Status.SOUND),
        ("s2.jsonl", Status.INCOMPLETE),
        ("s3.jsonl", Status.SOUND),
    ]
    assert {finding.file for finding in found[4:]} <= {three.manifest}  # a link in a circle is missing as well
    assert Remark.MANIFEST_UNREADABLE in codes(found[1])


def test_a_file_slipped_in_is_caught(three: Trail, tmp_path: Path, key: ConsoleKey) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    stranger = write_session(elsewhere, "s9", replace(key, folder=elsewhere), Disk())
    stranger.rename(three.folder / "s9.jsonl")
    (bad,) = the_bad(three)
    assert bad.file.name == "s9.jsonl"
    assert bad.reason == reason(Verdict.NOT_IN_MANIFEST)


def test_one_session_in_place_of_another_is_caught(three: Trail) -> None:
    (three.folder / "s2.jsonl").write_bytes((three.folder / "s1.jsonl").read_bytes())
    (bad,) = the_bad(three)
    assert bad.file.name == "s2.jsonl"


def test_the_copy_of_checkpoints_misses_what_was_cut(three: Trail) -> None:
    copies = three.folder.parent / "copies"
    copies.mkdir()
    (copies / f"{three.session.name}.checkpoints").write_bytes(lines_of(three.session)[-1])
    findings = verify([three.session], Evidence(keys=three.keys, copies=copies))
    assert exit_status(findings) == 0
    three.session.write_bytes(b"".join(lines_of(three.session)[:-1]))
    (bad,) = verify([three.session], Evidence(keys=three.keys, copies=copies))
    assert bad.reason == reason(Verdict.CHECKPOINT_MISSING, checkpoint=len(lines_of(three.session)))


@pytest.mark.parametrize("keys_known", [True, False])
def test_a_mirror_of_two_computers_is_compared_by_who_signed(trail: Trail, tmp_path: Path, keys_known: bool) -> None:
    other = Trail(tmp_path / "joints", tmp_path / "joints" / trail.session.name, load_or_make_key(tmp_path / "other"))
    other.folder.mkdir()
    write_session(other.folder, "s1", other.key, Disk(), BODIES[:2])
    only_there = write_session(other.folder, "s2", other.key, Disk())
    copies = tmp_path / "copies"
    copies.mkdir()
    for path in (trail.session, other.session, only_there):
        with (copies / f"{path.name}.checkpoints").open("ab") as copy:
            copy.write(lines_of(path)[-1])
    evidence = Evidence(keys=trail.keys | other.keys if keys_known else {}, copies=copies)
    findings = verify([trail.folder, other.folder], evidence)
    assert {finding.status for finding in findings} == {Status.SOUND}
    assert sum(Remark.MIRROR_AGREES in codes(finding) for finding in findings) == 3
    for one in (trail, other):
        whole = lines_of(one.session)
        one.session.write_bytes(b"".join(whole[:-1]))
        alone = verify([one.session], replace(evidence, listings={}))
        assert [finding.reason.code for finding in alone if finding.reason] == [key_of(Verdict.CHECKPOINT_MISSING)]
        one.session.write_bytes(b"".join(whole))


def test_a_trail_rewritten_with_a_new_key_disagrees_with_the_mirror_without_any_known_key(
    trail: Trail, tmp_path: Path
) -> None:
    copies = tmp_path / "copies"
    copies.mkdir()
    (copies / f"{trail.session.name}.checkpoints").write_bytes(lines_of(trail.session)[-1])
    trail.session.write_bytes(forged(trail.session, whitewash, load_or_make_key(tmp_path / "other")))
    alone = trail.session.rename(tmp_path / trail.session.name)
    (bad,) = verify([alone], Evidence(copies=copies))
    assert bad.reason is not None
    assert bad.reason.code == key_of(Verdict.CHECKPOINT_MISSING)


def test_without_any_known_key_the_finding_reports_that_nothing_was_proven(trail: Trail) -> None:
    (finding, _) = verify([trail.folder], Evidence())
    assert finding.proven == 0
    assert Remark.KEY_NOT_CHECKED in codes(finding)


def test_a_home_rolled_back_is_missed_by_the_copy_of_checkpoints(three: Trail) -> None:
    copies = three.folder.parent / "copies"
    copies.mkdir()
    (copies / "s4.jsonl.checkpoints").write_bytes(lines_of(three.session)[-1])
    (copies / "other-console.jsonl.checkpoints").write_bytes(b"")
    bad = [each for each in verify([three.folder], Evidence(keys=three.keys, copies=copies)) if each.reason]
    assert [(each.file.name, each.status) for each in bad] == [("s4.jsonl", Status.TAMPERED)]
    assert bad[0].reason == reason(Verdict.MISSING_BY_MIRROR)


def test_a_first_record_that_is_no_text_is_judged_by_its_chain_alone(trail: Trail) -> None:
    """A trail that anybody may have written: what can't be read must not end the verification."""
    parts = unseal(lines_of(trail.session)[0])
    assert parts is not None
    assert b'"rleex":"0"' in parts[0]
    sealed, _ = seal(parts[0].replace(b'"rleex":"0"', b'"rleex":"\xff"', 1))
    trail.session.write_bytes(sealed)
    (bad,) = the_bad(trail)
    assert bad.status is Status.TAMPERED
