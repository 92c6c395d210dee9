"""The flat table `records` over many sessions, in embedded DuckDB, and its export.

DuckDB reads the JSON Lines as they are, or the Parquet that `export` wrote.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from functools import partial
from glob import escape
from os.path import realpath
from pathlib import Path

import duckdb

from logs.errors import AuditError, AuditFault
from logs.line import MAX_LINE, SEAL_LENGTH
from logs.read import session_paths
from logs.reading.errors import cause_of
from logs.reading.regular import open_regular

# Columns taken out of the body, by DuckDB's type; `body` holds all of it as JSON text.
_TEXT = "kind action source gesture state from_state to_state outcome reason event effect text stream"
_COUNTS = "number steps rating recognised_ns released_ns accepted_ns first_command_ns first_motion_ns ended_ns"
_NUMBERS = "confidence distance_m tracking_rms_rad waited_s lasted_s p99_ms max_ms"
BODY_COLUMNS: dict[str, str] = {
    name: kind
    for kind, names in {"VARCHAR": _TEXT, "BIGINT": _COUNTS, "DOUBLE": _NUMBERS}.items()
    for name in names.split()
}
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
_ENVELOPE = {
    "session": "VARCHAR",
    "sequence": "BIGINT",
    "wall": "VARCHAR",
    "monotonic_ns": "BIGINT",
    "process": "VARCHAR",
    "operator": "VARCHAR",
    "schema": "BIGINT",
}
_LONGEST_LINE = 16 << 20  # bytes; DuckDB passes over longer lines than MAX_LINE, and gives up beyond this
SEAL = SEAL_LENGTH - 1  # characters behind the hashed text, which lacks its last brace; without the line end
_NAMES = ("sign-in", "sign-out", "sign-in-failed", "operator-changed")  # kinds whose body names operators
# The columns of the table; what lacks one is none that `export` wrote.
ENVELOPE_COLUMNS = ["file", *_ENVELOPE, "patient"]
AS_EXPORTED = {*ENVELOPE_COLUMNS, *BODY_COLUMNS, "body"}


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


def source_sql(files: Sequence[Path], *, is_parquet: bool) -> str:
    """The table over files of one kind, as a SELECT."""
    listed = ", ".join(map(quoted_file, files))
    return f"SELECT * FROM read_parquet([{listed}])" if is_parquet else _trails_sql(listed)


def open_limited() -> duckdb.DuckDBPyConnection:
    """An empty database within the limits above."""
    return duckdb.connect(config=dict(_LIMITS))


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
    """How many lines each trail holds; of Parquet none are counted. Raises AuditError, also for too long a line."""
    return {str(path): _count_lines(path) for path in _trails(paths)}


def _count_lines(path: Path) -> int:
    count = length = 0
    with open_regular(path) as file:
        for part in iter(partial(file.readline, MAX_LINE), b""):
            count += not length and bool(part.strip())
            length = 0 if part.endswith(b"\n") else length + len(part)
            if length > _LONGEST_LINE:
                raise AuditError(AuditFault.LINE_TOO_LONG, path=path, limit_mb=_LONGEST_LINE >> 20)
    return count


def omitted_lines(connection: duckdb.DuckDBPyConnection, lines: dict[str, int]) -> dict[str, int]:
    """Trail → its lines that are no records and stand in no row. lines: counted before the connection was made."""
    rows = dict(connection.execute("SELECT file, count(*) FROM records GROUP BY file").fetchall())
    missing = {path: count - rows.get(path, 0) for path, count in lines.items()}
    return {path: count for path, count in missing.items() if count > 0}


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
    """The flat table over JSON Lines. A line that does not match its hash (changed, torn, no JSON) becomes no row.

    NOT MATERIALIZED: `whole` is read twice, and DuckDB would hold all of it in memory.
    """
    line = "CAST(json AS VARCHAR)"
    shape = json.dumps(_ENVELOPE | {"body": BODY_COLUMNS | {"patient": "VARCHAR"}})
    columns = [f"record.{name}" for name in _ENVELOPE] + ["coalesce(patient, '') AS patient"]
    columns += [f"record.body.{name}" for name in BODY_COLUMNS]
    return f"""
        WITH whole AS NOT MATERIALIZED (
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
