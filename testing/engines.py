"""For comparing engines: made-up rows of several sites as Parquet, as many as wanted, and a real Spark cluster.

The cluster is a standalone one on this machine: a master and workers, each a process, all on 127.0.0.1.
"""

from __future__ import annotations

import math
import os
import re
import subprocess
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import duckdb

from logs.records_table import BODY_COLUMNS, quoted
from logs.spark import LOCAL

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


PATIENCE_S = 300.0
_MASTER = re.compile(r"Starting Spark master at (spark://\S+)")
_REGISTERED = "Successfully registered with master"
_CLASSES = "org.apache.spark.deploy"


@contextmanager
def spark_cluster(folder: Path, workers: int = 2, worker_mb: int = 1024) -> Iterator[str]:
    """The address of a cluster's master while it runs; its logs and work are in `folder`."""
    with ExitStack() as processes:
        master = processes.enter_context(_process(folder, "master", f"{_CLASSES}.master.Master", "--port", "0"))
        address = _wait_for(master, _MASTER)
        options = ("--cores", "1", "--memory", f"{worker_mb}m", "--work-dir", str(folder / "work"), address)
        logs = [
            processes.enter_context(_process(folder, f"worker-{number}", f"{_CLASSES}.worker.Worker", *options))
            for number in range(workers)
        ]
        for log in logs:
            _wait_for(log, re.compile(f"({_REGISTERED})"))
        yield address


@contextmanager
def _process(folder: Path, name: str, *command: str) -> Iterator[Path]:
    """One process of the cluster, without the shell scripts that would leave it behind; yields its log."""
    import pyspark

    home = Path(pyspark.__file__).parent
    log = folder / f"{name}.log"
    environment = os.environ | {"SPARK_HOME": str(home), "SPARK_LOCAL_IP": LOCAL, "SPARK_DAEMON_MEMORY": "256m"}
    arguments = [str(home / "bin" / "spark-class"), *command, "--host", LOCAL, "--webui-port", "0"]
    with log.open("wb") as output:
        process = subprocess.Popen(arguments, env=environment, stdout=output, stderr=subprocess.STDOUT)
    try:
        yield log
    finally:
        process.terminate()
        try:
            process.wait(20)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _wait_for(log: Path, wanted: re.Pattern[str]) -> str:
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        if (found := wanted.search(log.read_text(encoding="utf-8", errors="replace"))) is not None:
            return found[1]
        time.sleep(0.1)
    raise TimeoutError(f"{log.name}: no {wanted.pattern!r}; {log.read_text(errors='replace')[-2000:]}")
