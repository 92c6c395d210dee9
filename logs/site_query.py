"""The same questions over several sites in embedded DuckDB: one table `records`, with the column `site`.

The files are read while the question runs, so that more fits than memory holds; nothing but them can be opened.
"""

from __future__ import annotations

from collections.abc import Sequence

import duckdb

from logs.errors import AuditError, AuditFault
from logs.query import QUESTIONS, first_line, open_limited, quoted, source_sql
from logs.sites import Site

SITE_QUESTIONS: dict[str, str] = QUESTIONS | {
    "sites": """
        SELECT site, count(DISTINCT patient) AS patients, count(DISTINCT session) AS sessions, count(*) AS records,
               sum(CASE WHEN kind = 'action-end' THEN 1 ELSE 0 END) AS actions,
               sum(CASE WHEN kind = 'stop' THEN 1 ELSE 0 END) AS stops,
               sum(CASE WHEN kind = 'action-end' THEN steps ELSE 0 END) AS steps
        FROM records GROUP BY site ORDER BY site
        """,
}


def connect_sites(sites: Sequence[Site]) -> duckdb.DuckDBPyConnection:
    """A locked database over the sites' files. Raises AuditError when one can't be read."""
    connection = open_limited()
    allowed = ", ".join(quoted(str(file)) for site in sites for file in site.files)
    try:
        connection.execute(f"CREATE VIEW records AS {' UNION ALL BY NAME '.join(map(_rows_of, sites))}")
        for lock in (
            f"SET allowed_paths = [{allowed}]",
            "SET enable_external_access = false",
            "SET lock_configuration = true",
        ):
            connection.execute(lock)
    except duckdb.Error as error:
        raise AuditError(AuditFault.UNANSWERABLE, detail=first_line(error)) from error
    return connection


def _rows_of(site: Site) -> str:
    source = source_sql([str(file) for file in site.files], is_parquet=site.is_parquet)
    return f"SELECT {quoted(site.name)} AS site, * FROM ({source})"
