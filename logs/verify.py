"""Verification of trails: each file by itself (`logs.assess`), then against the mirror and the folder."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from logs.assess import Evidence, assess, short_keys
from logs.disk import is_being_written
from logs.findings import Finding, Remark, Status, Verdict
from logs.journal import MANIFEST, is_journal
from logs.manifest import manifest_paths
from logs.mirror import SUFFIX, copied, copied_files, differing
from logs.reading.errors import cause_of
from logs.reason import key_of, reason
from logs.scan import Progress, Scan, scan_file

__all__ = ["Evidence", "Finding", "Status", "exit_status", "is_session", "verify"]

EXIT_STATUS = {
    Status.SOUND: 0,
    Status.RUNNING: 0,
    Status.INCOMPLETE: 1,
    Status.TAMPERED: 1,
    Status.UNREADABLE: 2,
}


def exit_status(findings: Sequence[Finding]) -> int:
    """0 when all is sound, 1 when anything was changed, cut or added, else 2 when something can't be read."""
    statuses = {EXIT_STATUS[finding.status] for finding in findings}
    return 1 if 1 in statuses else max(statuses, default=2)


def verify(paths: Sequence[Path], evidence: Evidence, progress: Progress | None = None) -> list[Finding]:
    """Judge files and folders. A folder is judged as a whole: no file may be missing from it or too many."""
    findings: list[Finding] = []
    evidence = replace(evidence, listings={})
    for path in paths:
        if path.is_dir():
            findings += _verify_folder(path, evidence, progress)
        else:
            findings.append(_verify_one(path, evidence, progress))
    return findings


def _verify_folder(folder: Path, evidence: Evidence, progress: Progress | None) -> list[Finding]:
    files = sorted(folder.glob("*.jsonl"))
    findings = [_verify_one(path, evidence, progress) for path in files]
    listing = evidence.listing(folder)
    if not listing.parts:
        return findings + _no_manifest(folder, findings, evidence)
    return findings + _missing(folder, evidence, listing.signers, listing.opened)


def _missing(folder: Path, evidence: Evidence, signers: set[str], opened: Iterable[str] = ()) -> list[Finding]:
    """The files that are not there, each with what names it. signers: of the folder; opened: as its manifest names."""
    own = signers or evidence.keys  # the mirror may be another computer's, too
    named = dict.fromkeys(copied_files(evidence.copies, own), Verdict.MISSING_BY_MIRROR)
    named |= dict.fromkeys(evidence.anchors, Verdict.MISSING_BY_ANCHOR)
    named |= dict.fromkeys(opened, Verdict.MISSING_BY_MANIFEST)
    return [
        Finding(file=folder / name, status=Status.TAMPERED, reason=reason(witness))
        for name, witness in sorted(named.items())
        if not (folder / name).exists()
    ]


def _no_manifest(folder: Path, findings: list[Finding], evidence: Evidence) -> list[Finding]:
    journals = [each.file for each in findings if is_journal(each.file) and each.status is not Status.UNREADABLE]
    signers = {key for path in journals for key in scan_file(path, evidence.keys).signers}
    if gone := _missing(folder, evidence, signers):
        return gone
    if not manifest_paths(folder) and not all(is_journal(finding.file) for finding in findings):
        path = folder / MANIFEST
        return [Finding(file=path, status=Status.TAMPERED, reason=reason(Verdict.MANIFEST_MISSING))]
    if findings:
        return []
    return [Finding(file=folder, status=Status.UNREADABLE, reason=reason(Verdict.NO_TRAIL_HERE))]


def _verify_one(path: Path, evidence: Evidence, progress: Progress | None) -> Finding:
    try:
        finding, at_rest = _scan_and_assess(path, evidence, progress)
        if EXIT_STATUS[finding.status] and not at_rest:  # it went on, or was closed, before all else was read
            finding, _ = _scan_and_assess(path, evidence, progress)
        return finding
    except OSError as error:
        return Finding(
            file=path,
            status=Status.UNREADABLE,
            reason=reason(Verdict.CAN_NOT_BE_READ, detail=cause_of(error)),
        )


def _scan_and_assess(path: Path, evidence: Evidence, progress: Progress | None) -> tuple[Finding, bool]:
    """The finding, and whether nobody wrote the file meanwhile."""
    running = is_being_written(path)
    copies = _copies_of(path, evidence)  # before the scan: what is copied later may be of records behind its end
    scan = scan_file(path, evidence.keys, progress)
    finding = assess(path, scan, evidence, running=running)
    if evidence.copies is not None:
        finding = _with_copies(finding, copies, _writers(copies, finding, scan, evidence))
    return finding, not running and path.stat().st_size == scan.size


def is_session(path: Path) -> bool:
    """Whether a file of a folder of trails is a session, by its name."""
    return path.suffix == ".jsonl" and not is_journal(path)


def _copies_of(path: Path, evidence: Evidence) -> dict[str, dict[int, str]]:
    """The mirror's copies of the checkpoints of files of this name, hashes by key and sequence."""
    copy = None if evidence.copies is None else evidence.copies / (path.name + SUFFIX)
    return {} if copy is None or not copy.exists() else copied(copy)


def _writers(copies: Mapping[str, object], finding: Finding, scan: Scan, evidence: Evidence) -> set[str]:
    """The keys whose copies this file must agree with: another computer's trail may have its name.

    Those that sign in it, or in its folder's manifest where it has no signature. Who rewrites a file signs with another
    key or none: without copies by those keys it must agree with the copies by all known keys, or by any where none is
    known. But a trail that a crash left without a signature may be another computer's than the copies.
    """
    own = (scan.signers or evidence.listing(finding.file.parent).signers) & copies.keys()
    if own:
        return own
    keys = (evidence.keys or copies).keys()
    known = keys & copies.keys()
    recovered = key_of(Remark.RECOVERED) in {remark.code for remark in finding.remarks}
    crashed = recovered or finding.status is not Status.SOUND
    may_be_others = not scan.signers and crashed and known != keys
    return set() if may_be_others else known


def _with_copies(finding: Finding, copies: Mapping[str, Mapping[int, str]], writers: set[str]) -> Finding:
    if not writers:
        remark = reason(Remark.MIRROR_OF_OTHERS, keys=short_keys(copies)) if copies else reason(Remark.NO_MIRROR)
        return replace(finding, remarks=(*finding.remarks, remark))
    expected = {sequence: digest for key in writers for sequence, digest in copies[key].items()}
    wrong = next((number for number in sorted(expected) if number >= finding.records), None)
    if wrong is None:
        wrong = differing(finding.file, expected)
    if wrong is None:
        remark = reason(Remark.MIRROR_AGREES, checkpoints=len(expected))
        return replace(finding, remarks=(*finding.remarks, remark))
    why = reason(Verdict.CHECKPOINT_MISSING, checkpoint=wrong)
    return replace(finding, status=Status.TAMPERED, reason=why, sequence=wrong, line=wrong + 1)
