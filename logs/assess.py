"""What became of one file that was scanned: by itself, then against its folder's manifest and the console's anchors."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from logs.findings import Finding, Remark, Status, Verdict
from logs.journal import first_body, is_journal, misplaced, part_is_cut
from logs.keys import Anchor, PublicKey
from logs.line import GENESIS
from logs.manifest import Listing, manifest_paths, read_listings
from logs.reading.regular import open_regular
from logs.reason import Reason, reason
from logs.records import SCHEMA, LogClosed, LogRecovered, SessionStart
from logs.scan import Scan

_RECORD_BEGINS = b'{"body":{'


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
        unknown = reason(Verdict.KEY_NOT_KNOWN, keys=short_keys(scan.unknown_keys))
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
        remarks.append(reason(Remark.KEY_NOT_CHECKED, keys=short_keys(scan.unknown_keys)))
    return tuple(remarks)


def short_keys(keys: Iterable[str]) -> str:
    """Fingerprints as a remark names them, in order."""
    return ", ".join(sorted(key[:12] if key.isalnum() else "?" for key in keys))
