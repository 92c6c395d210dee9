"""Times of the ready questions over several sites, by DuckDB and by a Spark cluster of this machine, as rows grow.

`python tools/bench_query.py [--rows 1e6 3e6 10e6]`, after `make test-spark` has installed Spark. Growth is the time
over that of the first number of rows. Both read the same Parquet; every answer is compared.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from logs.query import ask
from logs.sites import SITE_QUESTIONS, Site, connect_sites, find_sites
from logs.spark import ask_spark, spark_session
from testing.engines import same, spark_cluster, write_sites

REPEATS = 3
LIMIT_S = 600.0
Engine = Callable[[Sequence[Site], str], Any]


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=float, nargs="+", default=[1e6, 3e6, 10e6])
    parser.add_argument("--repeats", type=int, default=REPEATS)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="rleex-bench-query-") as name:
        folder = Path(name)
        with spark_cluster(folder) as master, spark_session(master) as session:
            engines: dict[str, Engine] = {
                "duckdb": lambda sites, sql: ask(connect_sites(sites), sql, LIMIT_S),
                "spark": lambda sites, sql: ask_spark(session, sites, sql, LIMIT_S),
            }
            equal = _measure(folder, engines, [int(rows) for rows in options.rows], options.repeats)
    sys.exit(0 if equal else 1)


def _measure(folder: Path, engines: dict[str, Engine], sizes: Sequence[int], repeats: int) -> bool:
    first: dict[tuple[str, str], float] = {}
    equal = True
    print(f"{'rows':>12} {'question':<12} {'engine':<8} {'s':>8} {'growth':>7}  equal")
    for rows in sizes:
        sites = find_sites([str(place) for place in write_sites(folder / str(rows), rows)])
        for question, sql in SITE_QUESTIONS.items():
            answers = []
            for engine, run in engines.items():
                seconds, answer = _timed(run, sites, sql, repeats)
                answers.append(answer)
                growth = seconds / first.setdefault((engine, question), seconds)
                alike = same(answers[0], answers[-1])
                equal = equal and alike
                told = "yes" if alike else "NO"
                print(f"{rows:>12,} {question:<12} {engine:<8} {seconds:>8.3f} {growth:>6.1f}x  {told}", flush=True)
    return equal


def _timed(run: Engine, sites: Sequence[Site], sql: str, repeats: int) -> tuple[float, list[dict[str, object]]]:
    """The median, and the answer."""
    times = []
    answer: list[dict[str, object]] = []
    for _ in range(repeats):
        began = time.perf_counter()
        answer = run(sites, sql).to_pylist()
        times.append(time.perf_counter() - began)
    return statistics.median(times), answer


if __name__ == "__main__":
    main()
