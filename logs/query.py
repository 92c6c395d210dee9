"""Questions over many sessions: one flat table of records in embedded DuckDB, asked in SQL.

DuckDB reads the JSON Lines as they are, or the Parquet that `export` wrote. The ready questions use standard SQL only,
so that another engine can answer them over the same Parquet.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Iterable, Iterator, Sequence
from decimal import Decimal
from functools import partial
from glob import escape
from itertools import count
from os.path import realpath
from pathlib import Path
from typing import Any

import duckdb
import pyarrow
from rich.table import Table
from rich.text import Text

from logs.errors import AuditError, AuditFault
from logs.line import MAX_LINE, SEAL_LENGTH
from logs.read import session_paths
from logs.reading.errors import cause_of
from logs.reading.regular import open_regular
from logs.reason import Reason, Render, sanitize_terminal

# Columns taken out of the body, by DuckDB's type; `body` holds all of it as JSON text.
_TEXT = "kind action source gesture state from_state to_state outcome reason event effect text stream"
_COUNTS = "number steps rating recognised_ns released_ns accepted_ns first_command_ns first_motion_ns ended_ns"
_NUMBERS = "confidence distance_m tracking_rms_rad waited_s lasted_s p99_ms max_ms"
BODY_COLUMNS: dict[str, str] = {
    name: kind
    for kind, names in {"VARCHAR": _TEXT, "BIGINT": _COUNTS, "DOUBLE": _NUMBERS}.items()
    for name in names.split()
}
LIMIT_S = 60.0  # of one question
ANSWER_BYTES = 256 << 20
_BATCH = 10_000  # rows
# From the start. python_enable_replacements: else a name in SQL may be a variable of this program.
_LIMITS: dict[str, str | int | float | list[str]] = {
    "memory_limit": "2GB",
    "threads": 2,
    "autoinstall_known_extensions": False,
    "autoload_known_extensions": False,
    "allow_community_extensions": False,
    "python_enable_replacements": False,
    "temp_directory": "",  # what does not fit into memory is refused, not written
}
_LOCKS = ("SET enable_external_access = false", "SET lock_configuration = true")
MOST_ROWS = 500  # on a screen; JSON has them all
_ENVELOPE = {
    "session": "VARCHAR",
    "sequence": "BIGINT",
    "wall": "VARCHAR",
    "monotonic_ns": "BIGINT",
    "process": "VARCHAR",
    "operator": "VARCHAR",
    "schema": "BIGINT",
}
SEAL = SEAL_LENGTH - 1  # characters behind the hashed text, which lacks its last brace; without the line end
_NAMES = ("sign-in", "sign-out", "sign-in-failed", "operator-changed")  # kinds whose body names operators


# The columns of the table; what lacks one is none that `export` wrote.
ENVELOPE_COLUMNS = ["file", *_ENVELOPE, "patient"]
AS_EXPORTED = {*ENVELOPE_COLUMNS, *BODY_COLUMNS, "body"}

# The ready questions: standard SQL over the table of records. Of a session on two computers there are two files, of
# which one holds control's records: its hours count. Their wording: `question.<name>` in the catalogues.
QUESTIONS: dict[str, str] = {
    "unintended": """
        SELECT session, patient, count(*) AS actions,
               sum(CASE WHEN outcome = 'stopped' THEN 1 ELSE 0 END) AS stopped,
               avg(CASE WHEN outcome = 'stopped' THEN 1e0 ELSE 0e0 END) AS share
        FROM records WHERE kind = 'action-end' GROUP BY session, patient ORDER BY session, patient
        """,
    "refusals": """
        WITH sums AS (
            SELECT gesture,
                   sum(CASE WHEN kind = 'command' OR coalesce(number, 0) = 0 THEN 1 ELSE 0 END) AS requests,
                   sum(CASE WHEN kind = 'refusal' THEN 1 ELSE 0 END) AS refused
            FROM records WHERE kind IN ('command', 'refusal') AND gesture IS NOT NULL GROUP BY gesture
        )
        SELECT gesture, requests, refused, refused * 1e0 / nullif(requests, 0) AS rate
        FROM sums ORDER BY rate DESC, gesture
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
            HAVING sum(CASE WHEN process = 'control' THEN 1 ELSE 0 END) > 0
        ),
        total AS (SELECT coalesce(sum(hours), 0e0) AS device_hours FROM lengths),
        faults AS (
            SELECT event, effect, count(*) AS times
            FROM records WHERE kind = 'event-raised' AND effect IN ('hold', 'damp') GROUP BY event, effect
        )
        SELECT event, effect, times, device_hours, times / nullif(device_hours, 0) AS per_hour
        FROM faults CROSS JOIN total ORDER BY times DESC, event, effect
        """,
}


def connect(paths: Sequence[Path], kind: str = "VIEW") -> duckdb.DuckDBPyConnection:
    """A database with `records` over folders or files of trails, and Parquet files. kind: VIEW, or TABLE to hold them.

    Raises AuditError when there is nothing to read.
    """
    parquet = _once(filter(_is_parquet, paths))
    for path in parquet:
        check_regular(path)
    kinds = {True: parquet, False: _trails(paths)}
    sources = [source_sql(files, is_parquet=is_parquet) for is_parquet, files in kinds.items() if files]
    if not sources:
        raise AuditError(AuditFault.NO_TRAILS, places=", ".join(map(str, paths)))
    connection = open_limited()
    try:
        together = " UNION ALL BY NAME ".join(f"SELECT * FROM ({source})" for source in sources)
        connection.execute(f"CREATE {kind} records AS {together}")
    except duckdb.Error as error:
        raise AuditError(AuditFault.TRAIL_UNREADABLE, path=paths[0], detail=first_line(error)) from error
    return connection


def connect_locked(paths: Sequence[Path]) -> duckdb.DuckDBPyConnection:
    """The records in memory, and no way out of it: no file, network, extension or setting. Raises AuditError."""
    connection = connect(paths, "TABLE")
    for statement in _LOCKS:
        connection.execute(statement)
    return connection


def source_sql(files: Sequence[Path], *, is_parquet: bool) -> str:
    """The table over files of one kind, as a SELECT."""
    listed = ", ".join(map(quoted_file, files))
    return f"SELECT * FROM read_parquet([{listed}])" if is_parquet else _trails_sql(listed)


def open_limited() -> duckdb.DuckDBPyConnection:
    """An empty database within the limits above."""
    return duckdb.connect(config=dict(_LIMITS))


def check_question(connection: duckdb.DuckDBPyConnection, sql: str) -> Any:
    """The one SELECT that it is, parsed. Raises AuditError for anything else."""
    try:
        statements = connection.extract_statements(sql)
    except duckdb.Error as error:
        raise AuditError(AuditFault.UNANSWERABLE, detail=first_line(error)) from error
    if [one.type for one in statements] != [duckdb.StatementType.SELECT]:
        raise AuditError(AuditFault.NOT_A_QUESTION)
    return statements[0]


def ask(connection: duckdb.DuckDBPyConnection, sql: str, limit_s: float = LIMIT_S) -> Any:
    """The answer to one SELECT as a pyarrow table. Raises AuditError with the engine's message."""
    question = check_question(connection, sql)
    late = threading.Event()

    def end() -> None:
        late.set()
        connection.interrupt()

    timer = threading.Timer(limit_s, end)
    timer.start()
    try:
        return _fetched(connection.sql(question).to_arrow_reader(_BATCH), late)
    except (duckdb.Error, OSError, MemoryError) as error:
        if late.is_set():
            raise AuditError(AuditFault.QUESTION_TOO_LONG, limit_s=limit_s) from error
        raise AuditError(AuditFault.UNANSWERABLE, detail=first_line(error)) from error
    finally:
        timer.cancel()


def _fetched(reader: Any, late: threading.Event) -> Any:
    """All batches as one table, within ANSWER_BYTES."""
    batches, size = [], 0
    for batch in reader:
        batches.append(batch)
        size += batch.nbytes
        if size > ANSWER_BYTES:
            raise AuditError(AuditFault.ANSWER_TOO_LARGE, limit_bytes=ANSWER_BYTES)
        if late.is_set():
            raise duckdb.InterruptException("late")
    return pyarrow.Table.from_batches(batches, reader.schema)


def export(paths: Sequence[Path], output: Path, *, drop_operators: bool) -> int:
    """Write the table as Parquet; returns its number of rows. Raises AuditError.

    Pseudonyms of patients stay. Without operators, their names leave the column and every body that names one.
    """
    names = ", ".join(map(quoted, _NAMES))
    # A takeover is a note that names the new operator.
    named = (
        f"kind IN ({names}) OR (kind = 'change' AND json_extract_string(body, '$.subject') = 'operator') "
        f"OR (kind = 'note' AND json_extract_string(body, '$.text.values.operator') IS NOT NULL)"
    )
    emptied = {name: "NULL" for name in BODY_COLUMNS if name != "kind"} | {"body": "'{}'"}
    cleared = (f"CASE WHEN {named} THEN {empty} ELSE {name} END AS {name}" for name, empty in emptied.items())
    columns = f"* REPLACE ('' AS operator, {', '.join(cleared)})" if drop_operators else "*"
    try:
        copy = f"COPY (SELECT {columns} FROM records) TO {quoted(str(output))} (FORMAT parquet)"
        (count,) = connect(paths).execute(copy).fetchone() or (0,)
    except (duckdb.Error, OSError) as error:
        raise AuditError(AuditFault.UNWRITABLE, path=output, detail=first_line(error)) from error
    return int(count)


def lines_of(paths: Sequence[Path]) -> dict[str, int]:
    """How many lines each trail holds; of Parquet none are counted. Raises AuditError."""
    counts: dict[str, int] = {}
    for path in _trails(paths):
        with open_regular(path) as file:
            counts[str(path)] = sum(1 for line in iter(partial(file.readline, MAX_LINE), b"") if line.strip())
    return counts


def omitted_lines(connection: duckdb.DuckDBPyConnection, lines: dict[str, int]) -> dict[str, int]:
    """Trail → its lines that are no records and stand in no row. lines: counted before the connection was made."""
    rows = dict(connection.execute("SELECT file, count(*) FROM records GROUP BY file").fetchall())
    missing = {path: count - rows.get(path, 0) for path, count in lines.items()}
    return {path: count for path, count in missing.items() if count > 0}


def as_table(answer: Any, render: Render) -> Table:
    """The first rows of a pyarrow table, numbers to the right, safe for a terminal. Known columns get their name."""
    table = Table(box=None)
    columns = [column.to_pylist() for column in answer.slice(0, MOST_ROWS).columns]  # two may have one name
    for name, values in zip(answer.column_names, columns, strict=True):
        numeric = any(isinstance(value, int | float) for value in values)
        table.add_column(Text(sanitize_terminal(name)), justify="right" if numeric else "left")
    for row in zip(*columns, strict=True):
        table.add_row(*map(Text, map(_cell, row)))
    if answer.num_rows > MOST_ROWS:
        table.caption = render(Reason("query.more", {"rows": answer.num_rows, "shown": MOST_ROWS}))
    return table


def as_json(answer: Any) -> Iterator[str]:
    """Every row of a pyarrow table as an object in pure ASCII; a second column of one name is numbered, `session_2`."""
    named = answer.rename_columns(_distinct(answer.column_names))
    return (json.dumps(row, default=_plain) for row in named.to_pylist())


def _distinct(names: Sequence[str]) -> list[str]:
    made: list[str] = []
    for name in names:
        numbered = (f"{name}_{number}" for number in count(2))
        made.append(name if name not in made else next(one for one in numbered if one not in (*names, *made)))
    return made


def _plain(value: Any) -> int | str:
    """DuckDB's sums of whole numbers are decimals: whole numbers again, as Spark gives them."""
    return int(value) if isinstance(value, Decimal) and value == int(value) else str(value)


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    return "–" if value is None else sanitize_terminal(str(value))


def quoted(text: str) -> str:
    return "'" + text.replace("'", "''") + "'"


def quoted_file(path: Path) -> str:
    """As DuckDB opens it: to it a path is a pattern, whose [1] would be another folder's 1."""
    return quoted(escape(str(path)))


def first_line(error: BaseException) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0]


def _is_parquet(path: Path) -> bool:
    """Whether its name or its first bytes say so. What can't be read is none: reading it says why."""
    if path.suffix.lower() == ".parquet":
        return True
    if not path.is_file():
        return False
    try:
        with open_regular(path) as file:
            return file.read(4) == b"PAR1"
    except OSError:
        return False


def _trails(paths: Sequence[Path]) -> list[Path]:
    trails = (path for path in paths if not _is_parquet(path))
    found = _once(file for path in trails for file in (session_paths(path) if path.is_dir() else [path]))
    for path in found:
        check_regular(path)
    return [path for path in found if path.stat().st_size]


def _once(paths: Iterable[Path]) -> list[Path]:
    """Each file once, however often and by whatever path it is named: its records would count twice.

    DuckDB takes `..` out of a path by its text, links or not, and names the file so: it gets the real path.
    """
    named = {realpath(path): path for path in paths}
    return [Path(real) if ".." in path.parts else path for real, path in named.items()]


def check_regular(path: Path) -> None:
    try:
        with open_regular(path):
            return
    except FileNotFoundError as error:
        raise AuditError(AuditFault.TRAIL_MISSING, path=path) from error
    except OSError as error:
        raise AuditError(AuditFault.TRAIL_UNREADABLE, path=path, detail=cause_of(error)) from error


def _trails_sql(listed: str) -> str:
    """The flat table over JSON Lines. A line that does not match its hash (changed, torn, no JSON) becomes no row."""
    line = "CAST(json AS VARCHAR)"
    shape = json.dumps(_ENVELOPE | {"body": BODY_COLUMNS | {"patient": "VARCHAR"}})
    columns = [f"record.{name}" for name in _ENVELOPE] + ["coalesce(patient, '') AS patient"]
    columns += [f"record.body.{name}" for name in BODY_COLUMNS]
    return f"""
        WITH whole AS (
            SELECT file, json, from_json(json, {quoted(shape)}) AS record
            FROM read_ndjson_objects([{listed}], ignore_errors=true, filename='file', maximum_object_size={MAX_LINE})
            WHERE right({line}, {SEAL}) = ',"hash":"' || sha256(left({line}, -{SEAL}) || '}}') || '"}}'
        ),
        patients AS (
            SELECT file AS of_file, any_value(record.body.patient) AS patient
            FROM whole WHERE record.body.kind = 'patient' GROUP BY file
        )
        SELECT file, {", ".join(columns)}, CAST(json->'$.body' AS VARCHAR) AS body
        FROM whole LEFT JOIN patients ON of_file = file WHERE record.session IS NOT NULL
    """
