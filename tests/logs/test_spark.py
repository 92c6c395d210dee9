"""Spark and DuckDB answer alike, on a real standalone cluster: `tools/test-spark` runs this, `make test` calls it."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from logs.errors import AuditError, AuditFault
from logs.query import ask
from logs.records_table import export
from logs.sites import SITE_QUESTIONS, Site, connect_sites, find_sites
from testing.engines import same, spark_cluster, write_sites
from testing.trails import write_sample

pytestmark = [
    pytest.mark.serial,
    pytest.mark.skipif("RLEEX_TEST_SPARK" not in os.environ, reason="needs Spark and Java: make test-spark"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),  # pyspark leaves sockets to the collector
]

LIMIT_S = 120.0
ROWS = 60_000


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """A session on a master and two workers, each a process."""
    from logs.spark import spark_session

    with spark_cluster(tmp_path_factory.mktemp("cluster")) as master, spark_session(master) as session:
        yield session


@pytest.fixture(scope="module")
def generated(tmp_path_factory: pytest.TempPathFactory) -> list[Site]:
    return find_sites([str(place) for place in write_sites(tmp_path_factory.mktemp("rows"), ROWS)])


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> list[Site]:
    """Two sites with trails, and one with a Parquet export."""
    homes = [tmp_path_factory.mktemp(name) for name in ("north", "south", "west")]
    for seed, home in enumerate(homes):
        write_sample(home, minutes=6, seed=seed, patient=f"P-{seed}")
    exported = tmp_path_factory.mktemp("exports") / "west.parquet"
    export([homes[2] / "logs"], exported, drop_operators=False)
    return find_sites([f"north={homes[0]}", f"south={homes[1]}", str(exported)])


def both(session: Any, sites: list[Site], sql: str) -> tuple[list[dict[str, object]], list[dict[str, object]]]:
    from logs.spark import ask_spark

    return (
        ask(connect_sites(sites), sql).to_pylist(),
        ask_spark(session, sites, sql, LIMIT_S).to_pylist(),
    )


def by_value(row: dict[str, object]) -> dict[str, object]:
    """With the body's values: Spark hands on the trail's bytes, DuckDB writes 1e-6 as 0.000001."""
    return row | {"body": json.loads(str(row["body"]))}


@pytest.mark.parametrize("question", SITE_QUESTIONS)
def test_generated_rows_get_equal_answers(session: Any, generated: list[Site], question: str) -> None:
    ours, theirs = both(session, generated, SITE_QUESTIONS[question])
    assert ours, "an empty answer compares nothing"
    assert same(ours, theirs)


@pytest.mark.parametrize("question", SITE_QUESTIONS)
def test_trails_and_exports_get_equal_answers(session: Any, recorded: list[Site], question: str) -> None:
    ours, theirs = both(session, recorded, SITE_QUESTIONS[question])
    assert ours, "an empty answer compares nothing"
    assert same(ours, theirs)


def test_every_column_of_every_record_is_the_same(session: Any, recorded: list[Site]) -> None:
    from logs.records_table import BODY_COLUMNS

    columns = ", ".join(["site", "session", "sequence", "wall", "monotonic_ns", "patient", "body", *BODY_COLUMNS])
    ours, theirs = both(session, recorded, f"SELECT {columns} FROM records ORDER BY site, session, sequence")
    assert len(ours) > 1000
    assert list(map(by_value, ours)) == list(map(by_value, theirs))


def test_a_line_that_does_not_match_its_hash_is_no_row_of_either(session: Any, tmp_path: Path) -> None:
    path = write_sample(tmp_path, minutes=1, patient="P-ä語")
    path.write_bytes(path.read_bytes().replace(b'"kind":"patient"', b'"kind":"patienT"'))
    ours, theirs = both(
        session, find_sites([str(tmp_path)]), "SELECT patient, count(*) AS n FROM records GROUP BY patient"
    )
    assert ours == theirs == [{"patient": "", "n": path.read_bytes().count(b"\n") - 1}]


def test_the_work_is_done_by_both_workers(session: Any, generated: list[Site]) -> None:
    assert session.sparkContext.master.startswith("spark://127.0.0.1:")
    context, deadline = session.sparkContext._jsc.sc(), time.monotonic() + LIMIT_S
    while (executors := context.getExecutorMemoryStatus().size() - 1) < 2:  # one is the driver; they register late
        assert time.monotonic() < deadline, f"{executors} of 2 executors"
        time.sleep(0.1)
    assert executors == 2


def test_each_site_is_a_partition_of_its_own(session: Any, generated: list[Site]) -> None:
    from logs.spark import load_sites

    load_sites(session, generated)
    plan = session.sql("SELECT count(*) FROM records WHERE site = 'site-1'")._jdf.queryExecution().toString()
    physical = plan.split("== Physical Plan ==")[1]
    assert "site-1/records.parquet" in physical
    assert "site-0/records.parquet" not in physical


def test_a_question_that_reaches_out_or_writes_is_refused(session: Any, generated: list[Site], tmp_path: Path) -> None:
    from logs.spark import ask_spark

    for sql in (
        "DROP VIEW records",
        f"INSERT OVERWRITE DIRECTORY '{tmp_path}' USING parquet SELECT * FROM records",
        "SELECT reflect('java.lang.System', 'exit', 3)",
        f"SELECT * FROM parquet.`{generated[0].files[0]}`",
        "SELECT nonsense FROM records",
    ):
        with pytest.raises(AuditError) as raised:
            ask_spark(session, generated, sql, LIMIT_S)
        assert raised.value.code in (AuditFault.NOT_A_QUESTION, AuditFault.UNANSWERABLE), sql


def test_the_command_asks_the_cluster(session: Any, generated: list[Site]) -> None:
    from tests.app.cli.test_query_command import query

    paths = [str(site.path) for site in generated]
    alone = query(*paths, "--ask", "sites", "--json")
    assert alone[0] == 0
    # The session of this test's process is taken; it is the cluster's.
    assert query(*paths, "--ask", "sites", "--json", "--spark", session.sparkContext.master) == alone
