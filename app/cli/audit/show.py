"""rleex audit: show, explain, replay, report: one session's trail."""

from __future__ import annotations

import re
from collections.abc import Callable
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
import typer
from rich.console import Console
from rich.text import Text
from typer import CallbackParam

from app.cli.audit.common import KeyOption, evidence_of, print_json, skip_unreadable, write_output
from app.cli.common import CliFault, HomeOption, check_output, print_text, refuse_options
from app.system.errors import AppError
from app.system.paths import find_home
from app.text.catalogue import language, render, tr
from app.text.recorded import render_recorded
from logs.disk import is_being_written
from logs.errors import AuditError, AuditFault
from logs.read import find_session, read, records, session_paths
from logs.read import follow as follow_file
from logs.reason import sanitize_terminal
from logs.records import Record
from logs.show import Filter, RecordSelector, json_of, line_of

if TYPE_CHECKING:
    from app.replay.session import Replayed

cli = typer.Typer()

# ISO 8601, or its beginning, as records have it: text is compared.
_MOMENT = re.compile(r"\d{4}(-\d\d(-\d\d(T\d\d(:\d\d(:\d\d(\.\d+)?)?)?Z?)?)?)?")


def _moment(parameter: CallbackParam, value: str) -> str:
    if value and not (_MOMENT.fullmatch(value) and _is_moment(value)):
        raise AppError(CliFault.NO_MOMENT, option=parameter.opts[0], value=value)
    return value.removesuffix("Z")  # behind every digit: a beginning with it would pass nothing of its minute


def _is_moment(beginning: str) -> bool:
    """Whether the calendar and the clock have it: as text, a thirteenth month would pass every record of its year."""
    begun = beginning.removesuffix("Z")[:19]
    with suppress(ValueError):
        return bool(datetime.fromisoformat(begun + "0001-01-01T00:00:00"[len(begun) :]))
    return False


@cli.command()
def show(
    session: Annotated[str, typer.Argument(help="Path, name, beginning of a name, or last.")] = "last",
    since: Annotated[str, typer.Option(callback=_moment, help="From this UTC time on, e.g. 2026-11-21T09:30.")] = "",
    until: Annotated[str, typer.Option(callback=_moment, help="Up to this UTC time.")] = "",
    patient: Annotated[str, typer.Option(help="Only this patient.")] = "",
    operator: Annotated[str, typer.Option(help="Only this operator.")] = "",
    state: Annotated[str, typer.Option(help="Only records of this gait state.")] = "",
    event: Annotated[str, typer.Option(help="Only this event.")] = "",
    gesture: Annotated[str, typer.Option(help="Only this gesture.")] = "",
    kind: Annotated[list[str] | None, typer.Option(help="Only this kind; may be repeated.")] = None,
    everything: Annotated[bool, typer.Option("--all", help="Every session, not only one.")] = False,
    follow: Annotated[bool, typer.Option("--follow", "-f", help="Go on while it is written.")] = False,
    json: Annotated[bool, typer.Option("--json", help="One JSON object a line.")] = False,
    home: HomeOption = None,
) -> None:
    """Print a session's records, one a line."""
    if everything:
        refuse_options("audit show --all", {"--follow": follow, "SESSION": session != "last"})
    wanted = Filter(
        since=since,
        until=until,
        patient=patient,
        operator=operator,
        state=state,
        event=event,
        gesture=gesture,
        kinds=tuple(kind or ()),
    )
    folder = find_home(home).logs
    count = 0
    if everything:
        for path in session_paths(folder):
            with skip_unreadable():
                count += _print_records(path, RecordSelector(wanted), named=True, as_json=json)
    else:
        count = _print_records(find_session(folder, session), RecordSelector(wanted), follow=follow, as_json=json)
    if not count:
        typer.echo(tr("cli.audit.no_records"), err=True)


def _print_records(
    path: Path, selector: RecordSelector, *, named: bool = False, follow: bool = False, as_json: bool
) -> int:
    """How many were printed. Lines hold the time alone: a new day, and with `named` the session, stand before them."""
    count, before = 0, ""
    console = Console(soft_wrap=True, highlight=False, markup=False, emoji=False)
    # Rich is slow, and its colours reach no file and no pipe.
    write: Callable[..., None] = console.print if console.is_terminal else _write_plain
    found = follow_file(path, lambda: not is_being_written(path)) if follow else read(path)
    with suppress(KeyboardInterrupt):  # the end of following
        for record in found:
            if not selector.passes(record):
                continue
            day = record.wall[:10] if isinstance(record, Record) else before
            count += 1
            if as_json:
                typer.echo(json_of(record))
                continue
            if named and count == 1:
                write(Text(sanitize_terminal(f"{path.stem}  {day}"), "bold"))
            elif before not in ("", day):
                write(Text(sanitize_terminal(day), "bold"))
            write(line_of(record, render_recorded))
            before = day
    return count


def _write_plain(line: Text) -> None:
    typer.echo(line.plain)


@cli.command()
def explain(
    session: Annotated[str, typer.Argument(help="Path, name, beginning of a name, or last.")],
    number: Annotated[int, typer.Argument(help="The record's number, as `rleex audit show` prints it.")],
    json: Annotated[bool, typer.Option("--json", help="One JSON object: SI units, nanoseconds.")] = False,
    home: HomeOption = None,
) -> None:
    """Why a record came about: the hops from the first frame to the end, each with what it compared."""
    from logs.explain.hops import explain_file
    from logs.explain.text import lines, to_values

    explanation = explain_file(find_session(find_home(home).logs, session), number)
    if json:
        print_json(to_values(explanation))
        return
    for line in lines(explanation, render_recorded):
        typer.echo(line)


@cli.command()
def replay(
    session: Annotated[str, typer.Argument(help="Path, name, beginning of a name, or last.")] = "last",
    json: Annotated[bool, typer.Option("--json", help="One JSON object.")] = False,
    home: HomeOption = None,
) -> None:
    """Make a session's decisions again from their recorded inputs. Exit status: 0 the same, 1 one differs."""
    from app.replay.session import replay as run

    path = find_session(find_home(home).logs, session)
    found = records(path)
    if not found:
        raise AuditError(AuditFault.TRAIL_EMPTY, path=path)
    again = run(found)
    if json:
        print_json(msgspec.to_builtins(again.to_values()))
    else:
        _print_replayed(again)
    raise typer.Exit(1 if again.differences else 0)


def _print_replayed(again: Replayed) -> None:
    from app.system.program import RULES

    for one in again.differences:
        recorded, replayed = (sanitize_terminal(str(value)) for value in (one.recorded, one.replayed))
        place = {"sequence": one.sequence, "kind": one.kind, "field": one.field}
        print_text("cli.audit.differs", **place, recorded=recorded, replayed=replayed)
    typer.echo(tr(again.writer, recorded=again.recorded.get(RULES, "")[:8], now=again.now[RULES][:8]))
    print_text("cli.audit.not_covered")
    print_text(
        "cli.audit.replayed",
        replayed=again.replayed,
        differences=len(again.differences),
        not_recorded=again.not_recorded,
    )
    if not again.replayed:
        print_text("cli.audit.nothing_replayed")


@cli.command()
def report(
    session: Annotated[str, typer.Argument(help="Path, name, beginning of a name, or last.")] = "last",
    output: Annotated[Path, typer.Option("--output", "-o", callback=check_output, help="The page to write.")] = Path(
        "report.html"
    ),
    key: KeyOption = None,
    home: HomeOption = None,
) -> None:
    """Write one self-contained page about a session, for reading and for printing."""
    from logs.report.page import report as make

    path = find_session(find_home(home).logs, session)
    evidence = evidence_of([path], key, None, home)
    lines, notes = _outcomes(path)
    page = make(path, evidence, render_recorded, language(), outcomes=lines, outcome_notes=notes)
    write_output(output, page.encode())
    print_text("cli.audit.report", path=output, session=path.stem)


def _outcomes(path: Path) -> tuple[list[tuple[str, str, str]], list[str]]:
    """The measures with their smallest changes, and notes on them; or why there are none: the page goes on without."""
    from app.outcomes.session import find_outcomes
    from app.outcomes.table import changes_of, lines_of, remarks, sources

    try:
        found = find_outcomes(path.parent, str(path))
    except (AppError, AuditError) as error:
        return [], [render(error)]
    changes = changes_of()
    lines = [(name, value, changes.get(name, "")) for name, value in lines_of(found)]
    # The other computer stands beside the page's numbers.
    notes = (tr(code, **values) for code, values in remarks([found]) if code != "outcomes.other_computer")
    return lines, [*notes, *sources()]
