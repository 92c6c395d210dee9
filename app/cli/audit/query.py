"""rleex audit: query, export, schema, list: many sessions at once."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from app.cli.audit.common import skip_unreadable
from app.cli.common import CliFault, HomeOption, check_output, print_answer, print_text, sql_of, wide_console
from app.system.errors import AppError
from app.system.paths import find_home
from app.text.catalogue import tr
from logs.read import outline, session_paths
from logs.reason import sanitize_terminal
from logs.show import UNKNOWN

cli = typer.Typer()


@cli.command()
def query(
    sql: Annotated[str, typer.Argument(help="SQL over the table `records`; see --ask for ready questions.")] = "",
    ask: Annotated[
        str, typer.Option(help="A ready question: unintended, refusals, response, faults. Of sites: see `rleex query`.")
    ] = "",
    at: Annotated[list[Path] | None, typer.Option(help="Folders, trails or Parquet; none: the home's.")] = None,
    json: Annotated[bool, typer.Option("--json", help="One JSON object a row.")] = False,
    home: HomeOption = None,
) -> None:
    """Query many sessions, of one site or several, at once."""
    from logs.query import QUESTIONS, connect_locked
    from logs.query import ask as ask_sql
    from logs.records_table import lines_of, omitted_lines
    from logs.sites import SITE_QUESTIONS

    if ask in SITE_QUESTIONS.keys() - QUESTIONS.keys():
        raise AppError(CliFault.QUESTION_OF_SITES, question=ask)
    wanted = sql_of(sql, ask, QUESTIONS)
    places = at or [find_home(home).logs]
    lines = lines_of(places)
    records_table = connect_locked(places)
    print_answer(ask_sql(records_table, wanted), json=json)
    _print_omitted(omitted_lines(records_table, lines))


@cli.command()
def export(
    parquet: Annotated[Path, typer.Option(callback=check_output, help="The Parquet file to write.")],
    at: Annotated[list[Path] | None, typer.Option(help="Folders or trails; none: the home's.")] = None,
    drop_operators: Annotated[bool, typer.Option("--drop-operators", help="Leave operators' names out.")] = False,
    home: HomeOption = None,
) -> None:
    """Write all records as one Parquet table; patients' pseudonyms stay."""
    from logs.records_table import connect, lines_of, omitted_lines
    from logs.records_table import export as write

    places = at or [find_home(home).logs]
    lines = lines_of(places)
    rows = write(places, parquet, drop_operators=drop_operators)
    print_text("cli.audit.exported", path=parquet, records=rows)
    _print_omitted(omitted_lines(connect([parquet]), lines))


def _print_omitted(omitted: dict[str, int]) -> None:
    for path, count in omitted.items():
        typer.echo(sanitize_terminal(tr("cli.audit.omitted", count=count, path=path)), err=True)


@cli.command()
def schema() -> None:
    """Print the records' JSON Schema."""
    from logs.records import schema_text

    typer.echo(schema_text(), nl=False)


@cli.command("list")
def list_sessions(home: HomeOption = None) -> None:
    """Sessions of this home, oldest first."""
    table = Table(box=None, collapse_padding=True)
    for column in ("session", "patient", "operator", "started", "minutes", "records", "actions", "stops"):
        table.add_column(tr(f"cli.audit.{column}"), no_wrap=column in ("session", "started"))
    elsewhere: dict[str, list[str]] = {}  # the sessions whose legs were another computer's, by that
    for path in session_paths(find_home(home).logs):
        with skip_unreadable():
            one = outline(path)
            texts = (path.stem, one.patient, one.operator, one.began[:16].replace("T", " "))
            numbers = (f"{one.duration_s / 60:.1f}", one.records, one.actions, one.stops)
            counts = (UNKNOWN if number is None else str(number) for number in numbers)
            table.add_row(*(sanitize_terminal(text) for text in texts), *counts)
            if one.joints_host:
                elsewhere.setdefault(one.joints_host, []).append(path.stem)
    wide_console().print(table, highlight=False, markup=False)
    for host, sessions in elsewhere.items():
        typer.echo(sanitize_terminal(tr("outcomes.other_computer", session=", ".join(sessions), host=host)))
