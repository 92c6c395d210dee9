"""Questions over many sessions, on the engine inside and, where there is one, on a cluster engine."""

from __future__ import annotations

import importlib.util
import shutil
import warnings
from pathlib import Path
from typing import Any

import pytest

from logs import records as r
from logs.errors import AuditError
from logs.query import QUESTIONS, ask, connect, export
from logs.read import records, session_paths
from tools.audit_sample import write_sample

# Ibis 12 still uses a name that DuckDB 2 is about to drop.
pytestmark = pytest.mark.filterwarnings("ignore:fetch_arrow_table:DeprecationWarning")


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two sessions of one patient."""
    home = tmp_path_factory.mktemp("home")
    for seed in (1, 2):
        write_sample(home, minutes=12, seed=seed)
    return home / "logs"


@pytest.fixture(scope="module")
def bodies(logs: Path) -> list[r.Body]:
    """Everything in them."""
    return [record.body for path in session_paths(logs) for record in records(path)]


def rows(table: Any) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = table.to_pylist()
    return found


def test_sql_sees_every_record(logs: Path, bodies: list[r.Body]) -> None:
    connection, _ = connect([logs])
    (row,) = rows(ask(connection, "SELECT count(*) AS n, count(DISTINCT patient) AS p, min(patient) AS w FROM records"))
    assert row == {"n": len(bodies), "p": 1, "w": "P-017"}


def test_the_refusal_rate_is_that_of_the_records(logs: Path, bodies: list[r.Body]) -> None:
    _, table = connect([logs])
    for row in rows(QUESTIONS["refusals"].expression(table).to_pyarrow()):
        refused = sum(isinstance(b, r.Refusal) and b.gesture == row["gesture"] for b in bodies)
        wishes = refused + sum(isinstance(b, r.Command) and b.gesture == row["gesture"] for b in bodies)
        assert (row["refused"], row["wishes"]) == (refused, wishes)
        assert row["rate"] == pytest.approx(refused / wishes)


def test_response_and_faults_are_those_of_the_records(logs: Path, bodies: list[r.Body]) -> None:
    _, table = connect([logs])
    ends = [b for b in bodies if isinstance(b, r.ActionEnd)]
    days = rows(QUESTIONS["response"].expression(table).to_pyarrow())
    assert sum(day["actions"] for day in days) == len(ends)
    assert max(day["longest_ms"] for day in days) == pytest.approx(
        max((end.first_command_ns - end.released_ns) / 1e6 for end in ends)
    )
    faults = rows(QUESTIONS["faults"].expression(table).to_pyarrow())
    assert sum(fault["times"] for fault in faults) == sum(isinstance(b, r.EventRaised) for b in bodies)
    unintended = rows(QUESTIONS["unintended"].expression(table).to_pyarrow())
    assert [row["stopped"] for row in unintended] == [0, 0]


def test_parquet_gives_the_same_answers(logs: Path, tmp_path: Path) -> None:
    parquet = tmp_path / "records.parquet"
    export([logs], parquet, drop_operators=False)
    for question in QUESTIONS.values():
        direct = rows(question.expression(connect([logs])[1]).to_pyarrow())
        assert rows(question.expression(connect([parquet])[1]).to_pyarrow()) == direct


def test_operators_can_be_left_out_and_pseudonyms_stay(logs: Path, tmp_path: Path) -> None:
    parquet = tmp_path / "records.parquet"
    export([logs], parquet, drop_operators=True)
    connection, _ = connect([parquet])
    answer = rows(ask(connection, "SELECT DISTINCT operator, patient FROM records"))
    assert answer == [{"operator": "", "patient": "P-017"}]
    assert b"Ann Berg" not in parquet.read_bytes()


def test_torn_and_foreign_lines_become_no_rows(logs: Path, tmp_path: Path) -> None:
    torn = tmp_path / "torn.jsonl"
    whole = session_paths(logs)[0].read_bytes()
    torn.write_bytes(whole + b'{"body":{"kind":"no')
    connection, _ = connect([torn])
    (row,) = rows(ask(connection, "SELECT count(*) AS n FROM records"))
    assert row["n"] == whole.count(b"\n")


@pytest.mark.parametrize("sql", ["SELECT nonsense FROM records", "SELEC 1", "DROP TABLE nothing"])
def test_a_bad_question_is_answered_with_a_sentence(logs: Path, sql: str) -> None:
    connection, _ = connect([logs])
    with pytest.raises(AuditError, match="question"):
        ask(connection, sql)


def test_nothing_to_read_is_said(tmp_path: Path) -> None:
    with pytest.raises(AuditError, match="no trails"):
        connect([tmp_path])
    with pytest.raises(AuditError, match="not there"):
        connect([tmp_path / "gone.jsonl"])


HAS_SPARK = importlib.util.find_spec("pyspark") is not None and shutil.which("java") is not None


@pytest.mark.skipif(not HAS_SPARK, reason="Java and pyspark are not both installed")
def test_the_same_expressions_run_on_a_local_spark_session(logs: Path, tmp_path: Path) -> None:
    parquet = tmp_path / "records.parquet"
    export([logs], parquet, drop_operators=False)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # pyspark's own
        connection, table = connect([parquet], "pyspark://local")
        for question in QUESTIONS.values():
            there = rows(question.expression(table).to_pyarrow())
            here = rows(question.expression(connect([parquet])[1]).to_pyarrow())
            assert [tuple(row) for row in there] == [tuple(row) for row in here]
            for one, other in zip(there, here, strict=True):
                for name, value in other.items():
                    assert one[name] == (pytest.approx(value) if isinstance(value, float) else value)
        connection.disconnect()
