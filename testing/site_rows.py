"""Made-up rows of several sites as Parquet, as many as wanted: for comparing engines, not for looking at."""

from __future__ import annotations

import math
from pathlib import Path

import duckdb

from logs.query import BODY_COLUMNS, quoted

_KINDS = "action-end command refusal event-raised joint-statistics stop"
# What the ready questions read; every other column is null. Row numbers, scattered, decide the values.
_VALUES = {
    "kind": f"list_extract(string_split('{_KINDS}', ' '), 1 + CAST(h % 6 AS INTEGER))",
    "gesture": "CASE WHEN h % 6 <= 2 THEN CAST(h // 6 % 8 AS VARCHAR) END",
    "outcome": "CASE WHEN h % 6 = 0 THEN CASE WHEN h % 13 = 0 THEN 'stopped' ELSE 'completed' END END",
    "event": "CASE WHEN h % 6 = 3 THEN 'event ' || CAST(h // 18 % 9 AS VARCHAR) END",
    "effect": "CASE WHEN h % 6 = 3 THEN list_extract(['note', 'hold', 'damp'], 1 + CAST(h // 6 % 3 AS INTEGER)) END",
    "steps": "CASE WHEN h % 6 = 0 THEN h % 5 END",
    "released_ns": "CASE WHEN h % 6 = 0 THEN n * 1000000 + 1 END",
    "first_command_ns": "CASE WHEN h % 6 = 0 THEN n * 1000000 + 30000000 + h % 40000000 END",
}


def write_sites(folder: Path, rows: int, sites: int = 3, sessions: int = 40) -> list[Path]:
    """A folder of Parquet a site, `rows` together, the same ones at each call."""
    folders = []
    for number in range(sites):
        place = folder / f"site-{number}"
        place.mkdir(parents=True, exist_ok=True)
        duckdb.sql(_sql(rows // sites + (number < rows % sites), number, sessions, place / "records.parquet"))
        folders.append(place)
    return folders


def _sql(rows: int, number: int, sessions: int, output: Path) -> str:
    columns = ", ".join(f"CAST({_VALUES.get(name, 'NULL')} AS {kind}) AS {name}" for name, kind in BODY_COLUMNS.items())
    session = f"'s{number}-' || CAST(n % {sessions} AS VARCHAR)"
    return f"""
        COPY (
            WITH numbered AS (
                SELECT n, (n * 2654435761 + {number} * 40503) % 1000003 AS h
                FROM (SELECT unnest(range({rows})) AS n)
            )
            SELECT {session} || '.jsonl' AS file, {session} AS session, n // {sessions} AS sequence,
                   '2026-11-' || lpad(CAST(1 + n % 28 AS VARCHAR), 2, '0') || 'T09:00:00.000000Z' AS wall,
                   n * 1000000 AS monotonic_ns, 'control' AS process, '' AS operator, 2 AS schema,
                   'P-' || CAST(n % {sessions} % 17 AS VARCHAR) AS patient, {columns}, '{{}}' AS body
            FROM numbered
        ) TO {quoted(str(output))} (FORMAT parquet)
    """


def same(ours: list[dict[str, object]], theirs: list[dict[str, object]]) -> bool:
    """Whether two answers are equal: fractions to 1e-12 of themselves, as each engine adds in an order of its own."""
    return len(ours) == len(theirs) and all(
        row.keys() == other.keys() and all(_alike(row[name], other[name]) for name in row)
        for row, other in zip(ours, theirs, strict=True)
    )


def _alike(one: object, other: object) -> bool:
    if isinstance(one, float) and isinstance(other, float):
        return math.isclose(one, other, rel_tol=1e-12)
    return one == other
