"""The same questions on Apache Spark, for data that outgrow one machine: the same table `records`, the same SQL.

Each site is a partition of its own: a question about one site reads that site's files only. Every node must see the
sites' files under the same paths. Spark is an extra (`rleex[spark]`) and needs Java.
"""

from __future__ import annotations

import os
import re
import shutil
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from os.path import realpath
from pathlib import Path
from typing import Any

from logs.errors import AuditError, AuditFault
from logs.query import ANSWER_BYTES, check_question
from logs.reading.errors import cause_of
from logs.records_table import BODY_COLUMNS, ENVELOPE_COLUMNS, SEAL, first_line, open_limited
from logs.sites import Site

LOCAL = "127.0.0.1"
_TYPES = {"VARCHAR": "STRING", "BIGINT": "BIGINT", "DOUBLE": "DOUBLE"}
_ENVELOPE = (
    "monotonic_ns BIGINT, operator STRING, process STRING, schema BIGINT, sequence BIGINT, session STRING, wall STRING"
)
# The body as the trail has it: Spark's reader of JSON would write numbers anew. Keys are sorted, quotes escaped.
_BODY = r'^\{"body":(.*),"monotonic_ns":\d+,"operator":'
_TEXT = f"length(value) - {SEAL}"  # characters of the line before its seal
_WHOLE = f"""substring(value, {_TEXT} + 1) =
             concat(',"hash":"', sha2(concat(left(value, {_TEXT}), '}}'), 256), '"}}')"""
# Functions of Spark's SQL that call into the Java machine.
_CALLS_OUT = re.compile(r"\b(reflect|java_method|try_reflect)\b", re.IGNORECASE)
_SETTINGS = {
    "spark.driver.host": LOCAL,
    "spark.driver.bindAddress": LOCAL,
    "spark.ui.enabled": "false",
    "spark.ui.showConsoleProgress": "false",
    "spark.driver.memory": "1g",
    "spark.executor.memory": "640m",  # of a worker of 1 GB, with what a Java machine takes besides
    "spark.driver.maxResultSize": str(ANSWER_BYTES),
    "spark.sql.runSQLOnFiles": "false",  # a question reaches no file but the sites'
    "spark.sql.session.timeZone": "UTC",
    "spark.sql.ansi.enabled": "false",  # a field of another type is null, as in DuckDB
    "spark.sql.shuffle.partitions": "8",
    "spark.sql.catalogImplementation": "in-memory",
    "spark.log.level": "ERROR",
}


@contextmanager
def spark_session(master: str) -> Iterator[Any]:
    """A session on this master. Raises AuditError without Spark, without Java or without an answer."""
    if shutil.which("java") is None and "JAVA_HOME" not in os.environ:
        raise AuditError(AuditFault.NO_JAVA)
    try:
        from pyspark.sql import SparkSession
    except ImportError as error:
        raise AuditError(AuditFault.NO_SPARK) from error
    os.environ.setdefault("SPARK_LOCAL_IP", LOCAL)
    builder = SparkSession.builder.master(master).appName("rleex query")
    for name, value in _SETTINGS.items():
        builder = builder.config(name, value)
    try:
        session = builder.getOrCreate()
    except Exception as error:
        raise AuditError(AuditFault.CLUSTER_UNREACHABLE, master=master, detail=_detail(error)) from error
    try:
        yield session
    finally:
        session.stop()


def ask_spark(session: Any, sites: Sequence[Site], sql: str, limit_s: float) -> Any:
    """The answer to one SELECT as a pyarrow table. Raises AuditError with the engine's message."""
    check_question(open_limited(), sql)
    if _CALLS_OUT.search(sql):
        raise AuditError(AuditFault.NOT_A_QUESTION)
    load_sites(session, sites)
    late = threading.Event()

    def end() -> None:
        late.set()
        session.sparkContext.cancelAllJobs()

    timer = threading.Timer(limit_s, end)
    timer.start()
    try:
        answer = session.sql(sql).toArrow()
    except Exception as error:
        if late.is_set():
            raise AuditError(AuditFault.QUESTION_TOO_LONG, limit_s=limit_s) from error
        raise AuditError(AuditFault.UNANSWERABLE, detail=_detail(error)) from error
    finally:
        timer.cancel()
    if answer.nbytes > ANSWER_BYTES:
        raise AuditError(AuditFault.ANSWER_TOO_LARGE, limit_bytes=ANSWER_BYTES)
    return answer


def load_sites(session: Any, sites: Sequence[Site]) -> None:
    """Define the table `records` over the sites' files."""
    from pyspark.sql import functions

    tables = []
    for site in sites:
        table = session.read.parquet(*addresses(site)) if site.is_parquet else _trails(session, site)
        tables.append(table.withColumn("site", functions.lit(site.name)))
    whole = tables[0]
    for table in tables[1:]:
        whole = whole.unionByName(table, allowMissingColumns=True)
    whole.createOrReplaceTempView("records")


def _trails(session: Any, site: Site) -> Any:
    """The table over JSON Lines, as `logs.records_table` makes it. A line that does not match its hash is no row."""
    from pyspark.sql import functions as f

    body = ", ".join(f"{name} {_TYPES[kind]}" for name, kind in BODY_COLUMNS.items())
    lines = session.read.text(addresses(site)).where(_WHOLE)
    envelope = f.from_json("value", _ENVELOPE).alias("envelope")
    split = lines.select(envelope, f.regexp_extract("value", _BODY, 1).alias("body"), f.input_file_name().alias("file"))
    raw = split.select("envelope.*", "body", "file").where("session IS NOT NULL AND wall IS NOT NULL")
    patients = (
        raw.where(f.get_json_object("body", "$.kind") == "patient")
        .groupBy(f.col("file").alias("of_file"))
        .agg(f.first(f.get_json_object("body", "$.patient")).alias("named"))
    )
    joined = raw.join(f.broadcast(patients), raw.file == patients.of_file, "left")
    parsed = joined.withColumn("patient", f.coalesce("named", f.lit(""))).withColumn(
        "fields", f.from_json("body", body)
    )
    return parsed.select(*ENVELOPE_COLUMNS, "fields.*", "body")


def addresses(site: Site) -> list[str]:
    """Where its files are, links followed: not `resolve`, which raises RuntimeError for links in a circle."""
    return [Path(realpath(file)).as_uri() for file in site.files]


def _detail(error: BaseException) -> str:
    return first_line(error) if not isinstance(error, OSError) else str(cause_of(error))
