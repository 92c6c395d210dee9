"""Questions over many sessions: SQL over the flat table `records` (`logs.records_table`), and their answers.

The ready questions use standard SQL only, so that another engine can answer them over the same Parquet.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator, Sequence
from decimal import Decimal
from itertools import count
from math import isfinite
from pathlib import Path
from typing import Any

import duckdb
import pyarrow
from rich.table import Table
from rich.text import Text

from logs.errors import AuditError, AuditFault
from logs.reason import Reason, Render, sanitize_terminal
from logs.records_table import connect, first_line

LIMIT_S = 60.0  # of one question
ANSWER_BYTES = 256 << 20
_BATCH = 10_000  # rows
_LOCKS = ("SET enable_external_access = false", "SET lock_configuration = true")
MOST_ROWS = 500  # on a screen; JSON has them all


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


def connect_locked(paths: Sequence[Path]) -> duckdb.DuckDBPyConnection:
    """The records in memory, and no way out of it: no file, network, extension or setting. Raises AuditError."""
    connection = connect(paths, "TABLE")
    for statement in _LOCKS:
        connection.execute(statement)
    return connection


def check_question(connection: duckdb.DuckDBPyConnection, sql: str) -> Any:
    """The one SELECT that it is, parsed. Raises AuditError for anything else."""
    try:
        sql.encode()  # bytes that are no UTF-8, from a command line, are half a surrogate pair here
        statements = connection.extract_statements(sql)
    except (duckdb.Error, UnicodeEncodeError) as error:
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


def as_table(answer: Any, render: Render) -> Table:
    """The first rows of a pyarrow table, numbers to the right, safe for a terminal. Known columns get their name."""
    table = Table(box=None)
    columns = _columns(answer.slice(0, MOST_ROWS))
    for name, values in zip(answer.column_names, columns, strict=True):
        numeric = any(isinstance(value, int | float) for value in values)
        table.add_column(Text(sanitize_terminal(name)), justify="right" if numeric else "left")
    for row in zip(*columns, strict=True):
        table.add_row(*map(Text, map(_cell, row)))
    if answer.num_rows > MOST_ROWS:
        table.caption = render(Reason("query.more", {"rows": answer.num_rows, "shown": MOST_ROWS}))
    return table


def as_json(answer: Any) -> Iterator[str]:
    """Every row of a pyarrow table as an object in pure ASCII; a second column of one name is numbered, `session_2`.

    JSON has no NaN and no infinity: they are null.
    """
    names, columns = _distinct(answer.column_names), _columns(answer)
    for row in zip(*columns, strict=True):
        values = map(_finite, row)
        yield json.dumps(dict(zip(names, values, strict=True)), default=_plain, allow_nan=False)


def _columns(answer: Any) -> list[list[Any]]:
    """The values of each column, of which two may have one name. Raises AuditError for times that Python has none for.

    DuckDB's years go beyond 1 to 9999, and its times down to nanoseconds.
    """
    columns: list[list[Any]] = []
    for name, column in zip(answer.column_names, answer.columns, strict=True):
        try:
            columns.append(column.to_pylist())
        except (OverflowError, ValueError) as error:
            raise AuditError(AuditFault.TIME_NOT_SHOWN, column=name) from error
    return columns


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if isfinite(value) else None
    if isinstance(value, dict):
        return {name: _finite(held) for name, held in value.items()}
    return [_finite(held) for held in value] if isinstance(value, list | tuple) else value


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
