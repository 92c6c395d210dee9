"""Recordings whose keeping time is over, as far as the clock can be believed by which their sessions were named."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from app.recording.read import STAMP, session_of
from app.system.paths import RECORDING_SUFFIX
from logs.manifest import manifest_paths
from logs.read import records
from logs.records import LogOpened

FIRST = datetime(2026, 1, 1, tzinfo=UTC)  # no recording is older than the program that records


@dataclass(frozen=True, slots=True, kw_only=True)
class Expired:
    """A recording, or pictures, of a session that began so long ago by its name."""

    path: Path
    age: timedelta
    after: str  # a session of a later name that was opened before it: a clock was wrong; empty: none
    too_old: bool  # older than FIRST by its name: a clock was wrong


def expired(folder: Path, keep_days: int, now: datetime) -> list[Expired]:
    """What is older than so many days, the oldest first. Raises AuditError where a manifest can't be read."""
    after = _misdated(folder, now)
    return [
        Expired(path=path, age=now - began, after=after.get(session_of(path), ""), too_old=began < FIRST)
        for path in sorted(folder.glob(f"*{RECORDING_SUFFIX}"))
        if (began := _began(path.name)) is not None and now - began > timedelta(days=keep_days)
    ]


def _misdated(folder: Path, now: datetime) -> dict[str, str]:
    """By session, the one of a later name that the manifests opened before it.

    One in the future tells of its own clock only: it would keep all that come after it for ever.
    """
    after: dict[str, str] = {}
    newest, newest_began = "", datetime.min.replace(tzinfo=UTC)
    bodies = [record.body for path in manifest_paths(folder) for record in records(path)]
    for session in (session_of(Path(body.file)) for body in bodies if isinstance(body, LogOpened)):
        began = _began(session)
        if began is None or began > now:
            continue
        if began < newest_began:
            after[session] = newest
        else:
            newest, newest_began = session, began
    return after


def _began(name: str) -> datetime | None:
    """By its session's name; None: it has none of ours."""
    stamp = name.partition("-")[0]
    try:
        began = datetime.strptime(stamp, STAMP).replace(tzinfo=UTC)
    except ValueError:
        return None
    return began if f"{began:{STAMP}}" == stamp else None  # fewer digits would be read, too
