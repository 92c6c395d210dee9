"""Verification of a trail: each file by itself, then against its manifest, the folder and the mirror."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from logs.disk import is_being_written
from logs.findings import Finding, Remark, Status, Verdict
from logs.journal import MANIFEST, first_body, is_journal, misplaced, part_is_cut
from logs.keys import Anchor, PublicKey
from logs.line import GENESIS
from logs.manifest import Listing, manifest_paths, read_listings
from logs.mirror import SUFFIX, copied, copied_files, differing
from logs.reading.errors import cause_of
from logs.reading.regular import open_regular
from logs.reason import Reason, key_of, reason
from logs.records import SCHEMA, LogClosed, LogRecovered, SessionStart
from logs.scan import Progress, Scan, scan_file

__all__ = ["Evidence", "Finding", "Status", "exit_status", "is_session", "verify"]

_RECORD_BEGINS = b'{"body":{'


EXIT_STATUS = {
    Status.SOUND: 0,
    Status.RUNNING: 0,
    Status.INCOMPLETE: 1,
    Status.TAMPERED: 1,
    Status.UNREADABLE: 2,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Evidence:
    """What a verification may use beside the files."""

    keys: Mapping[str, PublicKey] = field(default_factory=dict)  # by fingerprint
    copies: Path | None = None  # the mirror of the checkpoints
    anchors: Mapping[str, Anchor] = field(default_factory=dict)  # the console's, by the journal's file name
    # The manifests' entries by folder, and how long the manifests were then.
    listings: dict[Path, tuple[int, Listing]] = field(default_factory=dict)

    def listing(self, folder: Path) -> Listing:
        """What a folder's manifests say: read once for a verification, not once for each file, unless they grew.

        Without parts where there is none, or one can't be read.
        """
        try:
            size = sum(path.stat().st_size for path in manifest_paths(folder))
            if folder not in self.listings or self.listings[folder][0] != size:
                self.listings[folder] = size, read_listings(folder, self.keys, self.keys or None)
        except OSError:
            return Listing()
        return self.listings[folder][1]


def exit_status(findings: Sequence[Finding]) -> int:
    """0 when all is sound, 1 when anything was changed, cut or added, else 2 when something can't be read."""
    statuses = {EXIT_STATUS[finding.status] for finding in findings}
    return 1 if 1 in statuses else max(statuses, default=2)


def assess(path: Path, scan: Scan, evidence: Evidence, *, running: bool) -> Finding:
    """What became of a file that was scanned; `running`: its session is still being written."""
    finding = Finding(
        file=path,
        status=Status.SOUND,
        records=scan.records,
        proven=scan.proven,
        last_hash=scan.last_hash,
        remarks=_remarks(scan, evidence),
    )
    if _is_foreign(path, scan, evidence):
        return replace(finding, status=Status.UNREADABLE, reason=reason(Verdict.NOT_A_TRAIL))
    if scan.unknown_keys and evidence.keys:
        unknown = reason(Verdict.KEY_NOT_KNOWN, keys=_keys(scan.unknown_keys))
        return replace(finding, status=Status.TAMPERED, reason=unknown)
    if is_journal(path):
        return _assess_journal(finding, scan, evidence)
    return _assess_session(finding, scan, evidence, running=running)


def _is_foreign(path: Path, scan: Scan, evidence: Evidence) -> bool:
    """Not a record in it, and neither manifest nor anchor names it: binary, another encoding, another program's."""
    if scan.records or not scan.is_torn or scan.fault_is_sealed or path.name in evidence.anchors:
        return False
    with open_regular(path) as file:
        if file.read(len(_RECORD_BEGINS)) == _RECORD_BEGINS:
            return False
    return path.name not in evidence.listing(path.parent).opened


def _assess_journal(finding: Finding, scan: Scan, evidence: Evidence) -> Finding:
    anchor = evidence.anchors.get(finding.file.name)
    holds = scan.fault is None or scan.is_torn
    if holds and anchor is not None and anchor.hash != scan.unended_hash and part_is_cut(finding.file, anchor):
        cut = reason(Verdict.JOURNAL_CUT, remembered=anchor.entries, found=scan.records)
        return _bad(finding, scan, Status.TAMPERED, cut)
    if holds and (wrong := misplaced(finding.file, scan)) is not None:
        return replace(finding, status=Status.TAMPERED, reason=wrong, line=1, sequence=0)
    if anchor is None:
        finding = replace(finding, remarks=(*finding.remarks, reason(Remark.END_NOT_KNOWN)))
    if scan.fault is None and (scan.proven == scan.records or not evidence.keys):
        return finding
    if scan.fault is None:
        return _bad(finding, scan, Status.INCOMPLETE, reason(Verdict.END_NOT_SIGNED))
    if scan.is_torn:
        return _bad(finding, scan, Status.INCOMPLETE, reason(Verdict.TORN, size_bytes=scan.torn_bytes))
    return _bad(finding, scan, Status.TAMPERED, scan.fault.reason)


def _assess_session(finding: Finding, scan: Scan, evidence: Evidence, *, running: bool) -> Finding:
    if scan.fault is not None and not scan.is_torn:
        return _bad(finding, scan, Status.TAMPERED, scan.fault.reason)
    listing = evidence.listing(finding.file.parent)
    if not listing.parts:
        return _by_itself(finding, scan, running=running)
    return _against_manifest(finding, scan, listing, running=running)


def _by_itself(finding: Finding, scan: Scan, *, running: bool) -> Finding:
    remark = Remark.MANIFEST_UNREADABLE if manifest_paths(finding.file.parent) else Remark.NO_MANIFEST
    finding = replace(finding, remarks=(*finding.remarks, reason(remark)))
    if scan.closed:
        return finding
    return _unfinished(finding, scan, running=running)


def _unfinished(finding: Finding, scan: Scan, *, running: bool) -> Finding:
    if running:
        return replace(finding, status=Status.RUNNING, reason=reason(Verdict.STILL_WRITTEN))
    torn = reason(Verdict.NOT_CLOSED_TORN, size_bytes=scan.torn_bytes)
    return _bad(finding, scan, Status.INCOMPLETE, torn if scan.torn_bytes else reason(Verdict.NOT_CLOSED))


def _against_manifest(finding: Finding, scan: Scan, listing: Listing, *, running: bool) -> Finding:
    if finding.file.name not in listing.opened:
        return _unnamed(finding, scan)
    if (wrong := _wrong_history(finding.file, scan, listing)) is not None:
        return replace(finding, status=Status.TAMPERED, reason=wrong, line=1, sequence=0)
    match listing.ended.get(finding.file.name):
        case LogClosed() as end:
            return _against_close(finding, scan, end)
        case LogRecovered() as end:
            return _against_recovery(finding, scan, end)
        case None if scan.closed and not running:
            return _bad(finding, scan, Status.INCOMPLETE, reason(Verdict.CLOSE_NOT_IN_MANIFEST))
        case _:
            return _unfinished(finding, scan, running=running)


def _unnamed(finding: Finding, scan: Scan) -> Finding:
    if scan.size == 0:
        return replace(finding, remarks=(reason(Remark.EMPTY),))
    return replace(finding, status=Status.TAMPERED, reason=reason(Verdict.NOT_IN_MANIFEST))


def _against_close(finding: Finding, scan: Scan, end: LogClosed) -> Finding:
    if (scan.records, scan.last_hash, scan.torn_bytes) == (end.records, end.last_hash, 0) and scan.closed:
        return finding
    return _bad(finding, scan, Status.TAMPERED, reason(Verdict.NOT_AS_CLOSED, closed=end.records, found=scan.records))


def _against_recovery(finding: Finding, scan: Scan, end: LogRecovered) -> Finding:
    as_found = (end.records, end.last_hash, end.torn_bytes, end.torn_sha256)
    if (scan.records, scan.last_hash, scan.torn_bytes, scan.torn_sha256) != as_found:
        return _bad(finding, scan, Status.TAMPERED, reason(Verdict.NOT_AS_RECOVERED, recovered=end.records))
    remark = reason(Remark.RECOVERED, how=end.text or "")
    return replace(finding, remarks=(*finding.remarks, remark))


def _wrong_history(path: Path, scan: Scan, listing: Listing) -> Reason | None:
    """The first record names the newest entry that the manifest had: it must still be there."""
    body = first_body(path, scan)
    if not isinstance(body, SessionStart) or body.history_hash in ("", GENESIS):
        return None
    if body.history_hash in listing.hashes:
        return None
    return reason(Verdict.HISTORY_MISSING)


def _bad(finding: Finding, scan: Scan, status: Status, why: Reason) -> Finding:
    return replace(
        finding,
        status=status,
        reason=why,
        line=scan.fault.line if scan.fault else scan.records + 1,
        sequence=scan.fault.sequence if scan.fault else None,
    )


def _remarks(scan: Scan, evidence: Evidence) -> tuple[Reason, ...]:
    remarks = []
    if scan.newer_schema:
        remarks.append(reason(Remark.NEWER_SCHEMA, schema=scan.newer_schema, known=SCHEMA))
    if scan.tears:
        remarks.append(reason(Remark.TEARS_EXPLAINED, tears=len(scan.tears)))
    if scan.unknown_keys and not evidence.keys:
        remarks.append(reason(Remark.KEY_NOT_CHECKED, keys=_keys(scan.unknown_keys)))
    return tuple(remarks)


def _keys(keys: Iterable[str]) -> str:
    return ", ".join(sorted(key[:12] if key.isalnum() else "?" for key in keys))


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
    own = listing.signers or evidence.keys  # the mirror may be another computer's, too
    named = dict.fromkeys(copied_files(evidence.copies, own), Verdict.MISSING_BY_MIRROR)
    named |= dict.fromkeys(evidence.anchors, Verdict.MISSING_BY_ANCHOR)
    named |= dict.fromkeys(listing.opened, Verdict.MISSING_BY_MANIFEST)
    return findings + _missing(folder, named)


def _missing(folder: Path, named: Mapping[str, Verdict]) -> list[Finding]:
    """The files that are not there, each with what names it."""
    return [
        Finding(file=folder / name, status=Status.TAMPERED, reason=reason(witness))
        for name, witness in sorted(named.items())
        if not (folder / name).exists()
    ]


def _no_manifest(folder: Path, findings: list[Finding], evidence: Evidence) -> list[Finding]:
    journals = [each.file for each in findings if is_journal(each.file) and each.status is not Status.UNREADABLE]
    signers = {key for path in journals for key in scan_file(path, evidence.keys).signers}
    own = signers or evidence.keys  # the mirror may be another computer's, too
    named = dict.fromkeys(copied_files(evidence.copies, own), Verdict.MISSING_BY_MIRROR)
    named |= dict.fromkeys(evidence.anchors, Verdict.MISSING_BY_ANCHOR)
    if gone := _missing(folder, named):
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
        remark = reason(Remark.MIRROR_OF_OTHERS, keys=_keys(copies)) if copies else reason(Remark.NO_MIRROR)
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
