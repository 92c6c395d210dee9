"""The judgement on files and folders of a trail: each file by itself, then the folder and the copies elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from logs.copies import SUFFIX
from logs.disk import is_being_written
from logs.judgement import Evidence, Finding, Status, exit_status, is_appended, judge
from logs.manifest import manifest_paths, read_listings
from logs.scan import Progress, scan_file
from logs.second_place import copied, copied_files, differing

__all__ = ["Evidence", "Finding", "Status", "exit_status", "is_session", "verify"]


def verify(paths: Sequence[Path], evidence: Evidence, progress: Progress | None = None) -> list[Finding]:
    """Judge files and folders. A folder is judged as a whole: no file may be missing from it or too many."""
    findings: list[Finding] = []
    for path in paths:
        if path.is_dir():
            findings += _verify_folder(path, evidence, progress)
        else:
            findings.append(_verify_one(path, evidence, progress))
    return findings


def _verify_folder(folder: Path, evidence: Evidence, progress: Progress | None) -> list[Finding]:
    files = sorted(folder.glob("*.jsonl"))
    findings = [_verify_one(path, evidence, progress) for path in files]
    if not manifest_paths(folder):
        return findings + _no_manifest(folder, files, evidence)
    listing = read_listings(folder, evidence.keys)
    told = listing.opened | ({evidence.anchor.file} if evidence.anchor else set())
    named = dict.fromkeys(copied_files(evidence.copies, evidence.keys), "the second place") | dict.fromkeys(
        told, "the manifest"
    )
    return findings + [
        Finding(file=folder / name, status=Status.TAMPERED, reason=f"the file is missing: {witness} names it")
        for name, witness in sorted(named.items())
        if not (folder / name).exists()
    ]


def _no_manifest(folder: Path, files: list[Path], evidence: Evidence) -> list[Finding]:
    if evidence.anchor is not None or not all(is_appended(path) for path in files):
        path = folder / "manifest.jsonl"
        return [Finding(file=path, status=Status.TAMPERED, reason="the manifest is missing")]
    if files:
        return []
    return [Finding(file=folder, status=Status.UNREADABLE, reason="there is no audit trail in this folder")]


def _verify_one(path: Path, evidence: Evidence, progress: Progress | None) -> Finding:
    try:
        running = is_being_written(path)
        scan = scan_file(path, evidence.keys, progress)
        finding = judge(path, scan, evidence, running=running)
        return _with_copies(path, finding, evidence)
    except OSError as error:
        return Finding(file=path, status=Status.UNREADABLE, reason=f"it can't be read: {error.strerror}")


def is_session(path: Path) -> bool:
    """Whether a file of a folder of trails is a session, by its name."""
    return path.suffix == ".jsonl" and not is_appended(path)


def _with_copies(path: Path, finding: Finding, evidence: Evidence) -> Finding:
    if evidence.copies is None:
        return finding
    copy = evidence.copies / (path.name + SUFFIX)
    if not copy.exists():
        return replace(finding, remarks=(*finding.remarks, "no checkpoint of it in the second place"))
    expected = copied(copy)
    wrong = next((number for number in sorted(expected) if number >= finding.records), None)
    if wrong is None:
        wrong = differing(path, expected)
    if wrong is None:
        remark = f"{len(expected)} checkpoints agree with the second place"
        return replace(finding, remarks=(*finding.remarks, remark))
    text = f"checkpoint {wrong} of the second place is not in it: it was cut or rewritten"
    return replace(finding, status=Status.TAMPERED, reason=text, sequence=wrong, line=wrong + 1)
