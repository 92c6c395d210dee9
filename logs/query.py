"""Questions over many sessions: one flat table of records, asked in SQL or by ready expressions, on any Ibis backend.

Embedded DuckDB reads the JSON Lines as they are, or Parquet. A cluster engine is named by its Ibis address
(`pyspark://…`) and reads the Parquet that `export` wrote; the ready questions are the same expressions there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import duckdb
import ibis
from ibis import _

from logs.errors import AuditError
from logs.line import MAX_LINE
from logs.read import session_paths

# Columns taken out of the body; `body` holds all of it as JSON text. DuckDB's type names.
BODY_COLUMNS: dict[str, str] = {
    "kind": "VARCHAR",
    "number": "BIGINT",
    "action": "VARCHAR",
    "source": "VARCHAR",
    "gesture": "VARCHAR",
    "state": "VARCHAR",
    "from_state": "VARCHAR",
    "to_state": "VARCHAR",
    "outcome": "VARCHAR",
    "reason": "VARCHAR",
    "event": "VARCHAR",
    "effect": "VARCHAR",
    "text": "VARCHAR",
    "stream": "VARCHAR",
    "confidence": "DOUBLE",
    "distance_m": "DOUBLE",
    "steps": "BIGINT",
    "recognised_ns": "BIGINT",
    "released_ns": "BIGINT",
    "accepted_ns": "BIGINT",
    "first_command_ns": "BIGINT",
    "first_motion_ns": "BIGINT",
    "ended_ns": "BIGINT",
    "tracking_rms_rad": "DOUBLE",
    "waited_s": "DOUBLE",
    "lasted_s": "DOUBLE",
    "rating": "BIGINT",
    "p99_ms": "DOUBLE",
    "max_ms": "DOUBLE",
}
TABLE = "records"
_ENVELOPE = (
    "body: 'JSON', monotonic_ns: 'BIGINT', operator: 'VARCHAR', process: 'VARCHAR', "
    "schema: 'BIGINT', sequence: 'BIGINT', session: 'VARCHAR', wall: 'VARCHAR'"
)
_NAMES = {"sign-in", "sign-out", "sign-in-failed", "operator-changed"}  # kinds whose body names operators


def connect(paths: Sequence[Path], backend: str = "") -> tuple[Any, Any]:
    """An Ibis connection and its table of records. Raises AuditError when there is nothing to read.

    paths: folders or files of trails (JSON Lines), or Parquet files. backend: "" for embedded DuckDB over any of
    them, else an Ibis address; such an engine reads Parquet.
    """
    parquet = [path for path in paths if path.suffix == ".parquet"]
    if backend:
        return _elsewhere(backend, parquet)
    connection = ibis.duckdb.connect()
    files = [str(path) for path in parquet] or [str(path) for path in _trails(paths)]
    if not files:
        raise AuditError(f"There are no trails in {', '.join(str(path) for path in paths)}; name others.")
    if parquet:
        connection.read_parquet(files, table_name=TABLE)
    else:
        connection.raw_sql(_view(files))
    return connection, connection.table(TABLE)


def ask(connection: Any, sql: str) -> Any:
    """The answer to one SQL question as a pyarrow table. Raises AuditError with the engine's own words."""
    try:
        if connection.name == "duckdb":  # Ibis 12 asks DuckDB 2 for a method that it no longer has
            return _answered(connection.con.sql(sql))
        return connection.sql(sql).to_pyarrow()
    except (duckdb.Error, ibis.common.exceptions.IbisError) as error:
        raise AuditError(f"The question can't be answered: {str(error).strip().splitlines()[0]}") from error


def _answered(relation: Any) -> Any:
    if relation is None:
        raise AuditError("That is no question; ask with SELECT.")
    return relation.to_arrow_table()


def export(paths: Sequence[Path], output: Path, *, drop_operators: bool) -> int:
    """Write the table as Parquet; returns its number of rows. Raises AuditError.

    Pseudonyms of patients stay. Without operators, their names leave the column and every body that names one.
    """
    connection, table = connect(paths)
    if drop_operators:
        table = table.mutate(
            operator=ibis.literal(""), body=_.kind.isin(sorted(_NAMES)).ifelse(ibis.literal("{}"), _.body)
        )
    try:
        table.to_parquet(output)
    except (duckdb.Error, OSError) as error:
        raise AuditError(f"{output} can't be written: {str(error).splitlines()[0]}") from error
    count: int = connection.read_parquet(output).count().to_pyarrow().as_py()
    return count


@dataclass(frozen=True, slots=True)
class Question:
    """A question that is asked often, as an expression over the table of records."""

    text: str
    expression: Callable[[Any], Any]


def _unintended(records: Any) -> Any:
    ends = records.filter(_.kind == "action-end")
    stopped = (_.outcome == "stopped").cast("int64").sum()
    table = ends.group_by(_.session, _.patient).aggregate(actions=_.count(), stopped=stopped)
    return table.mutate(share=_.stopped / _.actions).order_by(_.session)


def _refusals(records: Any) -> Any:
    wishes = records.filter(_.kind.isin(["command", "refusal"]), _.gesture.notnull())
    refused = (_.kind == "refusal").cast("int64").sum()
    table = wishes.group_by(_.gesture).aggregate(wishes=_.count(), refused=refused)
    return table.mutate(rate=_.refused / _.wishes).order_by(ibis.desc("rate"), _.gesture)


def _response(records: Any) -> Any:
    ends = records.filter(_.kind == "action-end", _.released_ns > 0, _.first_command_ns > 0)
    timed = ends.mutate(response_ms=(_.first_command_ns - _.released_ns) / 1e6, day=_.wall.substr(0, 10))
    return (
        timed.group_by(_.day)
        .aggregate(actions=_.count(), mean_ms=_.response_ms.mean(), longest_ms=_.response_ms.max())
        .order_by(_.day)
    )


def _faults(records: Any) -> Any:
    lengths = records.group_by(_.file).aggregate(hours=(_.monotonic_ns.max() - _.monotonic_ns.min()) / 3.6e12)
    hours = lengths.aggregate(device_hours=_.hours.sum())
    faults = records.filter(_.kind == "event-raised", _.effect.isin(["hold", "damp"]))
    counted = faults.group_by(_.event, _.effect).aggregate(times=_.count()).cross_join(hours)
    return counted.mutate(per_hour=_.times / _.device_hours).order_by(ibis.desc("times"), _.event)


QUESTIONS: dict[str, Question] = {
    "unintended": Question("actions that somebody stopped before their end, a session", _unintended),
    "refusals": Question("how often each gesture is refused", _refusals),
    "response": Question("release to first joint command, day by day", _response),
    "faults": Question("events that held or damped the legs, a device-hour", _faults),
}


def _elsewhere(backend: str, parquet: list[Path]) -> tuple[Any, Any]:
    if not parquet:
        raise AuditError("A cluster engine reads Parquet; write it with `rleex audit export` and name that file.")
    try:
        connection = ibis.connect(backend)
        return connection, connection.read_parquet(str(parquet[0]), table_name=TABLE)
    except (ImportError, AttributeError, ValueError, ibis.common.exceptions.IbisError) as error:
        first = str(error).splitlines()[0]
        raise AuditError(f"The engine {backend!r} can't be used: {first}; install its Ibis backend.") from error


def _trails(paths: Sequence[Path]) -> list[Path]:
    found: list[Path] = []
    for path in paths:
        found += session_paths(path) if path.is_dir() else [path]
    missing = [path for path in found if not path.exists()]
    if missing:
        raise AuditError(f"The trail {missing[0]} is not there; `rleex audit list` names what is.")
    return [path for path in found if path.stat().st_size]


def _view(files: Sequence[str]) -> str:
    """The flat table over JSON Lines. A line that is no JSON (a torn tail) becomes no row."""
    listed = ", ".join("'" + file.replace("'", "''") + "'" for file in files)
    columns = ", ".join(f"TRY_CAST(body->>'$.{name}' AS {kind}) AS {name}" for name, kind in BODY_COLUMNS.items())
    return f"""
        CREATE VIEW {TABLE} AS
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
