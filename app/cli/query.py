"""rleex query."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from app.cli.audit import evidence_of
from app.cli.common import CliFault, HomeOption
from app.system.errors import AppError
from app.system.paths import find_home
from app.text.catalogue import render, tr
from app.text.recorded import render_recorded

if TYPE_CHECKING:
    from logs.sites import Site

cli = typer.Typer()


@cli.command()
def query(
    sites: Annotated[
        list[str] | None, typer.Argument(help="PATH or NAME=PATH of each site: a home, trails or Parquet; none: home.")
    ] = None,
    sql: Annotated[str, typer.Option(help="SQL over the table `records`, whose column `site` names the site.")] = "",
    ask: Annotated[str, typer.Option(help="A ready question: unintended, refusals, response, faults, sites.")] = "",
    spark: Annotated[
        str, typer.Option(help="Ask this Spark master (spark://HOST:PORT, local[2]) instead of DuckDB.")
    ] = "",
    json: Annotated[bool, typer.Option("--json", help="One JSON object a row.")] = False,
    home: HomeOption = None,
) -> None:
    """Query the sessions of several sites. A site that is missing or tampered is refused by name."""
    from logs.query import as_json, as_table
    from logs.sites import SITE_QUESTIONS, check_site, find_sites

    if bool(sql) == bool(ask) or (ask and ask not in SITE_QUESTIONS):
        ready = "; ".join(f"{name}: {tr(f'question.{name}')}" for name in SITE_QUESTIONS)
        raise AppError(CliFault.NO_QUESTION, ready=ready)
    found = find_sites(sites or [str(find_home(home).root)])
    for site in found:
        known = check_site(site, lambda path: evidence_of([path], None, None, home))
        typer.echo(render(known), err=True)
    answer = _answer(found, sql or SITE_QUESTIONS[ask], spark)
    if json:
        for line in as_json(answer):
            typer.echo(line)
    else:
        Console(highlight=False, markup=False).print(as_table(answer, render_recorded))


def _answer(sites: list[Site], sql: str, spark: str) -> Any:
    from logs.query import LIMIT_S
    from logs.query import ask as ask_duckdb
    from logs.sites import connect_sites

    if not spark:
        return ask_duckdb(connect_sites(sites), sql)
    from logs.spark import ask_spark, spark_session

    with spark_session(spark) as session:
        return ask_spark(session, sites, sql, LIMIT_S)
