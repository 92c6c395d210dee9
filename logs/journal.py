"""A trail that many starts append to: operators' changes, reviewers' comments. Every append is signed."""

from __future__ import annotations

from pathlib import Path

from logs.disk import Disk, PosixDisk
from logs.errors import AuditError
from logs.keys import ConsoleKey
from logs.line import SIGNED_KINDS
from logs.manifest import Moment, found_torn, resume
from logs.records import Body, Checkpoint
from logs.trail import open_logger

OPERATORS = "operators.jsonl"
COMMENTS = ".comments.jsonl"


def append_signed(
    path: Path, session: str, bodies: list[Body], key: ConsoleKey, now: Moment, *, disk: Disk | None = None
) -> None:
    """Append records to a journal and sign them; returns when they are on the disk.

    Raises AuditError when the disk refuses, or when the journal was changed and must be looked at first.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        trail, chain, scan = resume(path, session, key, disk or PosixDisk())
    except OSError as error:
        raise AuditError(f"The journal {path} can't be read: {error.strerror}.") from error
    if scan is not None and scan.fault is not None and not scan.is_torn:
        raise AuditError(f"The journal {path} was changed at line {scan.fault.line}; keep it aside for the reviewer.")
    logger = open_logger(trail, chain)
    if scan is not None and scan.torn_bytes:
        logger.record(now.entry(found_torn(path.name, scan, key)))
    for body in bodies:
        logger.record(now.entry(body))
    if type(bodies[-1]).__struct_config__.tag not in SIGNED_KINDS:
        seal = Checkpoint(records=chain.sequence, closing=False, key=key.public.fingerprint)
        logger.record(now.entry(seal))
    try:
        if not trail.settle():
            raise AuditError(trail.fault)
    finally:
        trail.close()
