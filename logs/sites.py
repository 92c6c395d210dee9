"""Sites: folders of sessions (trails, or the Parquet that `export` wrote), each checked before it is asked.

A site that is missing, tampered or can't be read is refused by name: an answer without its rows would be a wrong one.
The ready questions are those of `logs.query`, over one table `records` with the column `site`. The files are read while
the question runs, so that more fits than memory holds; nothing but them can be opened.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum, auto
from itertools import combinations
from os.path import realpath
from pathlib import Path

import duckdb

from logs.errors import AuditError, AuditFault
from logs.findings import Finding, Status
from logs.query import QUESTIONS
from logs.read import session_paths
from logs.reason import Reason, reason
from logs.records import SCHEMA
from logs.records_table import AS_EXPORTED, check_regular, first_line, open_limited, quoted, quoted_file, source_sql
from logs.verify import Evidence, verify

PARQUET = ".parquet"
_NAMED = re.compile(r"(?P<name>[\w.-]+)=(?P<path>.+)")
_GOOD = (Status.SOUND, Status.RUNNING, Status.INCOMPLETE)


class SiteState(Enum):
    """What is known of a site that is asked."""

    PROVEN = auto()  # site, sessions
    NOT_PROVEN = auto()  # site, sessions: no public key is known
    UNFINISHED = auto()  # site, sessions, unfinished
    NOT_SIGNED = auto()  # site, files


@dataclass(frozen=True, slots=True, kw_only=True)
class Site:
    """One site's files, either trails or Parquet; `path` is what was named."""

    name: str
    path: Path
    files: tuple[Path, ...]
    is_parquet: bool


def find_sites(texts: Sequence[str]) -> list[Site]:
    """The sites of PATH or NAME=PATH each. Raises AuditError for one that is missing, empty or named twice."""
    sites = [_find(text) for text in texts]
    for first, second in combinations(sites, 2):
        if first.name == second.name:
            raise AuditError(AuditFault.SITE_TWICE, site=first.name)
        if {realpath(file) for file in first.files} & {realpath(file) for file in second.files}:
            raise AuditError(AuditFault.SITES_SHARE, site=first.name, other=second.name)
    return sites


def _find(text: str) -> Site:
    named = None if Path(text).exists() else _NAMED.fullmatch(text)
    path = Path(named["path"] if named else text)
    place = path / "logs" if (path / "logs").is_dir() else path
    root = Path(realpath(path))  # not `resolve`: links that go in a circle are a missing site
    root = root.parent if path.name == "logs" else root
    name = named["name"] if named else root.name if root.is_dir() else root.stem
    if not place.exists():
        raise AuditError(AuditFault.SITE_MISSING, site=name, path=path)
    trails = session_paths(place) if place.is_dir() else [place][: place.suffix == ".jsonl"]
    parquet = sorted(place.glob(f"*{PARQUET}")) if place.is_dir() else [place][: place.suffix == PARQUET]
    if trails and parquet:
        raise AuditError(AuditFault.SITE_AMBIGUOUS, site=name, path=place)
    if not trails and not parquet:
        raise AuditError(AuditFault.SITE_EMPTY, site=name, path=place)
    return Site(name=name, path=place, files=tuple(trails or parquet), is_parquet=not trails)


def check_site(site: Site, evidence_of: Callable[[Path], Evidence]) -> Reason:
    """What is known of it. Raises AuditError where it is tampered, can't be read or is of a newer version."""
    for path in site.files:
        check_regular(path)
    if not site.is_parquet:
        return _check_trails(site, evidence_of(site.path))
    for path in site.files:
        _check_export(site, path)
    return reason(SiteState.NOT_SIGNED, site=site.name, files=len(site.files))


def _check_trails(site: Site, evidence: Evidence) -> Reason:
    findings = verify([site.path], evidence)
    for finding in findings:
        _check_finding(site, finding)
    if not evidence.keys:
        return reason(SiteState.NOT_PROVEN, site=site.name, sessions=len(site.files))
    unfinished = sum(finding.status is not Status.SOUND for finding in findings)
    if unfinished:
        return reason(SiteState.UNFINISHED, site=site.name, sessions=len(site.files), unfinished=unfinished)
    return reason(SiteState.PROVEN, site=site.name, sessions=len(site.files))


def _check_finding(site: Site, finding: Finding) -> None:
    if finding.status not in _GOOD:
        why = finding.reason or Reason("")
        raise AuditError(AuditFault.SITE_TAMPERED, site=site.name, path=finding.file, why=why)
    newer = next((each for each in finding.remarks if each.code == "Remark.NEWER_SCHEMA"), None)
    if newer is not None:
        raise AuditError(AuditFault.SITE_NEWER, path=finding.file, schema=newer.values["schema"], known=SCHEMA)


def _check_export(site: Site, path: Path) -> None:
    """Its columns, and the newest schema in it; from the file's statistics, not from its rows."""
    source = f"read_parquet([{quoted_file(path)}])"
    try:
        connection = open_limited()
        columns = {row[0] for row in connection.execute(f"DESCRIBE SELECT * FROM {source}").fetchall()}
        if not columns >= AS_EXPORTED:
            missing = ", ".join(sorted(AS_EXPORTED - columns)[:3])
            raise AuditError(AuditFault.NOT_AN_EXPORT, path=path, missing=missing)
        (newest,) = connection.execute(f"SELECT max(schema) FROM {source}").fetchone() or (None,)
    except (duckdb.Error, OSError) as error:
        raise AuditError(AuditFault.SITE_UNREADABLE, site=site.name, path=path, detail=first_line(error)) from error
    if newest is not None and newest > SCHEMA:
        raise AuditError(AuditFault.SITE_NEWER, path=path, schema=newest, known=SCHEMA)


SITE_QUESTIONS: dict[str, str] = QUESTIONS | {
    # An action's end holds the steps of the session so far.
    "sites": """
        WITH sessions AS (SELECT site, session, max(steps) AS steps FROM records WHERE kind = 'action-end'
                          GROUP BY site, session),
             walked AS (SELECT site, sum(steps) AS total FROM sessions GROUP BY site)
        SELECT site, count(DISTINCT patient) AS patients, count(DISTINCT session) AS sessions, count(*) AS records,
               sum(CASE WHEN kind = 'action-end' THEN 1 ELSE 0 END) AS actions,
               sum(CASE WHEN kind = 'stop' THEN 1 ELSE 0 END) AS stops,
               coalesce(max(total), 0) AS steps
        FROM records LEFT JOIN walked USING (site) GROUP BY site ORDER BY site
        """,
}


def connect_sites(sites: Sequence[Site]) -> duckdb.DuckDBPyConnection:
    """A locked database over the sites' files. Raises AuditError when one can't be read."""
    connection = open_limited()
    # The files, and the patterns by which the view opens them.
    files = [file for site in sites for file in site.files]
    allowed = ", ".join((*(quoted(str(file)) for file in files), *map(quoted_file, files)))
    try:
        connection.execute(f"CREATE VIEW records AS {' UNION ALL BY NAME '.join(map(_rows_of, sites))}")
        for lock in (
            f"SET allowed_paths = [{allowed}]",
            "SET enable_external_access = false",
            "SET lock_configuration = true",
        ):
            connection.execute(lock)
    except duckdb.Error as error:
        raise AuditError(AuditFault.UNANSWERABLE, detail=first_line(error)) from error
    return connection


def _rows_of(site: Site) -> str:
    source = source_sql(site.files, is_parquet=site.is_parquet)
    return f"SELECT {quoted(site.name)} AS site, * FROM ({source})"
