"""Questions over many sessions: one flat table of records in embedded DuckDB, asked in SQL.

DuckDB reads the JSON Lines as they are, or the Parquet that `export` wrote. The ready questions use standard SQL only,
so that another engine can answer them over the same Parquet.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import duckdb
from rich.table import Table
from rich.text import Text

from logs.errors import AuditError, AuditFault
from logs.line import MAX_LINE
from logs.read import session_paths
from logs.reason import Reason, Render
from logs.sanitize import sanitize_terminal

# Columns taken out of the body, by DuckDB's type; `body` holds all of it as JSON text.
_TEXT = "kind action source gesture state from_state to_state outcome reason event effect text stream"
_COUNTS = "number steps rating recognised_ns released_ns accepted_ns first_command_ns first_motion_ns ended_ns"
_NUMBERS = "confidence distance_m tracking_rms_rad waited_s lasted_s p99_ms max_ms"
BODY_COLUMNS: dict[str, str] = {
    name: kind
    for kind, names in {"VARCHAR": _TEXT, "BIGINT": _COUNTS, "DOUBLE": _NUMBERS}.items()
    for name in names.split()
}
MOST_ROWS = 500  # on a screen; JSON has them all
_ENVELOPE = (
    "body: 'JSON', monotonic_ns: 'BIGINT', operator: 'VARCHAR', process: 'VARCHAR', "
    "schema: 'BIGINT', sequence: 'BIGINT', session: 'VARCHAR', wall: 'VARCHAR'"
)
_NAMES = ("sign-in", "sign-out", "sign-in-failed", "operator-changed")  # kinds whose body names operators


# The ready questions: standard SQL over the table of records. Their wording: `question.<name>` in the catalogues.
QUESTIONS: dict[str, str] = {
    "unintended": """
        SELECT session, patient, count(*) AS actions,
               sum(CASE WHEN outcome = 'stopped' THEN 1 ELSE 0 END) AS stopped,
               avg(CASE WHEN outcome = 'stopped' THEN 1.0 ELSE 0.0 END) AS share
        FROM records WHERE kind = 'action-end' GROUP BY session, patient ORDER BY session
        """,
    "refusals": """
        SELECT gesture, count(*) AS requests,
               sum(CASE WHEN kind = 'refusal' THEN 1 ELSE 0 END) AS refused,
               avg(CASE WHEN kind = 'refusal' THEN 1.0 ELSE 0.0 END) AS rate
        FROM records WHERE kind IN ('command', 'refusal') AND gesture IS NOT NULL
        GROUP BY gesture ORDER BY rate DESC, gesture
        """,
    "response": """
        SELECT substr(wall, 1, 10) AS day, count(*) AS actions,
               avg((first_command_ns - released_ns) / 1e6) AS mean_ms,
               max((first_command_ns - released_ns) / 1e6) AS longest_ms
        FROM records WHERE kind = 'action-end' AND released_ns > 0 AND first_command_ns > 0
        GROUP BY substr(wall, 1, 10) ORDER BY day
        """,
    "faults": """
        WITH lengths AS (
            SELECT (max(monotonic_ns) - min(monotonic_ns)) / 3.6e12 AS hours FROM records GROUP BY file
        ),
        total AS (SELECT sum(hours) AS device_hours FROM lengths),
        faults AS (
            SELECT event, effect, count(*) AS times
            FROM records WHERE kind = 'event-raised' AND effect IN ('hold', 'damp') GROUP BY event, effect
        )
        SELECT event, effect, times, device_hours, times / device_hours AS per_hour
        FROM faults CROSS JOIN total ORDER BY times DESC, event
        """,
}


def connect(paths: Sequence[Path]) -> duckdb.DuckDBPyConnection:
    """A database with the view `records` over folders or files of trails, or Parquet files.

    Raises AuditError when there is nothing to read.
    """
    parquet = [str(path) for path in paths if path.suffix == ".parquet"]
    files = parquet or [str(path) for path in _trails(paths)]
    if not files:
        raise AuditError(AuditFault.NO_TRAILS, places=", ".join(map(str, paths)))
    connection = duckdb.connect()
    listed = ", ".join(map(_quoted, files))
    source = f"SELECT * FROM read_parquet([{listed}])" if parquet else _trails_sql(listed)
    try:
        connection.execute(f"CREATE VIEW records AS {source}")
    except duckdb.Error as error:
        raise AuditError(AuditFault.TRAIL_UNREADABLE, path=files[0], detail=_first_line(error)) from error
    return connection


def ask(connection: duckdb.DuckDBPyConnection, sql: str) -> Any:
    """The answer to one SQL question as a pyarrow table. Raises AuditError with the engine's message."""
    try:
        relation = connection.sql(sql)
        if relation is None:
            raise AuditError(AuditFault.NOT_A_QUESTION)
        return relation.to_arrow_table()
    except duckdb.Error as error:
        raise AuditError(AuditFault.UNANSWERABLE, detail=_first_line(error)) from error


def export(paths: Sequence[Path], output: Path, *, drop_operators: bool) -> int:
    """Write the table as Parquet; returns its number of rows. Raises AuditError.

    Pseudonyms of patients stay. Without operators, their names leave the column and every body that names one.
    """
    names = ", ".join(map(_quoted, _NAMES))
    cleared = f"REPLACE ('' AS operator, CASE WHEN kind IN ({names}) THEN '{{}}' ELSE body END AS body)"
    columns = f"* {cleared}" if drop_operators else "*"
    try:
        copy = f"COPY (SELECT {columns} FROM records) TO {_quoted(str(output))} (FORMAT parquet)"
        (count,) = connect(paths).execute(copy).fetchone() or (0,)
    except (duckdb.Error, OSError) as error:
        raise AuditError(AuditFault.UNWRITABLE, path=output, detail=_first_line(error)) from error
    return int(count)


def as_table(answer: Any, render: Render) -> Table:
    """The first rows of a pyarrow table, numbers to the right, safe for a terminal. Known columns get their name."""
    table = Table(box=None)
    rows = answer.slice(0, MOST_ROWS).to_pylist()
    for name in answer.column_names:
        numeric = any(isinstance(row[name], int | float) for row in rows)
        table.add_column(Text(sanitize_terminal(name)), justify="right" if numeric else "left")
    for row in rows:
        table.add_row(*(Text(_cell(value)) for value in row.values()))
    if answer.num_rows > MOST_ROWS:
        table.caption = render(Reason("query.more", {"rows": answer.num_rows, "shown": MOST_ROWS}))
    return table


def as_json(answer: Any) -> Iterator[str]:
    """Every row of a pyarrow table as an object in pure ASCII."""
    return (json.dumps(row, default=str) for row in answer.to_pylist())


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    return "–" if value is None else sanitize_terminal(str(value))


def _quoted(text: str) -> str:
    return "'" + text.replace("'", "''") + "'"


def _first_line(error: Exception) -> str:
    return str(error).strip().splitlines()[0]


def _trails(paths: Sequence[Path]) -> list[Path]:
    found: list[Path] = []
    for path in paths:
        found += session_paths(path) if path.is_dir() else [path]
    missing = [path for path in found if not path.exists()]
    if missing:
        raise AuditError(AuditFault.TRAIL_MISSING, path=missing[0])
    return [path for path in found if path.stat().st_size]


def _trails_sql(listed: str) -> str:
    """The flat table over JSON Lines. A line that is no JSON (a torn tail) becomes no row."""
    columns = ", ".join(f"TRY_CAST(body->>'$.{name}' AS {kind}) AS {name}" for name, kind in BODY_COLUMNS.items())
    return f"""
        WITH raw AS (
            SELECT * FROM read_json([{listed}], format='newline_delimited', ignore_errors=true, filename='file',
                                    maximum_object_size={MAX_LINE}, columns={{{_ENVELOPE}}})
            WHERE session IS NOT NULL
        ),
        patients AS (
            SELECT file AS of_file, any_value(body->>'$.patient') AS patient
            FROM raw WHERE body->>'$.kind' = 'patient' GROUP BY file
        )
        SELECT file, session, sequence, wall, monotonic_ns, process, operator, schema, coalesce(patient, '') AS patient,
               {columns}, CAST(body AS VARCHAR) AS body
        FROM raw LEFT JOIN patients ON of_file = file
    """
