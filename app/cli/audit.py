"""rleex audit."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import msgspec
import typer
from rich.console import Console
from rich.progress import BarColumn, DownloadColumn, Progress, TimeRemainingColumn
from rich.table import Table
from rich.text import Text
from typer import CallbackParam

from app.cli.common import (
    CliFault,
    HomeOption,
    check_output,
    print_answer,
    print_text,
    refuse_options,
    shown_after,
    sql_of,
    wide_console,
)
from app.system.errors import AppError
from app.system.files import write_whole
from app.system.paths import find_home
from app.text.catalogue import language, render, tr
from app.text.recorded import render_recorded
from logs.disk import is_being_written
from logs.errors import AuditError, AuditFault
from logs.findings import describe, to_values
from logs.join import Join, describe_join, join_findings, join_values
from logs.keys import PUBLIC_FILE, by_fingerprint, known_keys, load_public_key, read_anchors
from logs.read import find_session, outline, read, records, session_paths
from logs.read import follow as follow_file
from logs.reading.errors import cause_of
from logs.reason import sanitize_terminal
from logs.records import Record
from logs.show import UNKNOWN, Filter, RecordSelector, json_of, line_of
from logs.verify import Evidence, Finding, exit_status
from logs.verify import verify as assess

if TYPE_CHECKING:
    from app.replay.session import Replayed

cli = typer.Typer(no_args_is_help=True)
KeyOption = Annotated[
    list[Path] | None, typer.Option("--key", help="Public key that must have signed; may be repeated.")
]

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


def _mirror(path: Path | None) -> Path | None:
    """Refuse a mirror that can't be read: nothing would be compared with it. Raises AuditError."""
    try:
        if path is not None:
            next(path.iterdir(), None)
    except OSError as error:
        raise AuditError(AuditFault.TRAIL_UNREADABLE, path=path, detail=cause_of(error)) from error
    return path


@cli.command()
def verify(
    files: Annotated[
        list[Path] | None, typer.Argument(help="Trails, folders or names of sessions, or last; none: the home's.")
    ] = None,
    key: KeyOption = None,
    copies: Annotated[Path | None, typer.Option(callback=_mirror, help="Mirror of the checkpoints.")] = None,
    json: Annotated[Path | None, typer.Option(callback=check_output, help="Write the findings here, too.")] = None,
    home: HomeOption = None,
) -> None:
    """Prove that nothing was changed, cut or added. Exit status: 0 sound, 1 tampered or cut, 2 unreadable."""
    logs = find_home(home).logs
    paths = [_place_of(one, logs) for one in files] if files else [logs]
    # Each place by its own console's keys: the trails of two computers are signed by two.
    evidence = [evidence_of([path], key, copies, home) for path in paths]
    with _reading_progress(paths) as progress:
        findings = [one for path, by in zip(paths, evidence, strict=True) for one in assess([path], by, progress)]
    joins = join_findings(findings)

    def print_all() -> None:
        console = Console(soft_wrap=True, highlight=False)
        for text in (*(describe(one, render_recorded) for one in findings), *_described(joins)):
            console.print(text)

    # One computer's trails alone can't prove a join: that is only told. Several places together must.
    joined = [Finding(file=one.file, status=one.status) for one in joins if len(paths) > 1 or one.is_contradiction]
    status = exit_status([*findings, *joined])
    with shown_after(print_all):
        if json is not None:
            _write_findings(json, findings, joins, status)
    raise typer.Exit(status)


def _place_of(given: Path, logs: Path) -> Path:
    """A path as it is; what can only be a session's name, as every other command takes it. Raises AuditError."""
    is_name = len(given.parts) == 1 and not given.suffix and not given.exists()
    return find_session(logs, str(given)) if is_name else given


@cli.command()
def merge(
    first: Annotated[Path, typer.Argument(help="The trail whose clock counts.")],
    second: Annotated[Path, typer.Argument(help="The trail of the other computer.")],
    json: Annotated[bool, typer.Option("--json", help="One JSON object a record.")] = False,
    home: HomeOption = None,
) -> None:
    """Print the trails of two computers as one timeline, with the clocks' uncertainty."""
    from logs.merge import merge as place
    from logs.merge import merged_line, merged_values

    logs = find_home(home).logs
    first, second = _place_of(first, logs), _place_of(second, logs)
    merged = place(first, second)
    began_ns = merged[0].placed.at_ns
    console = Console(soft_wrap=True, highlight=False, markup=False, emoji=False)
    for one in merged:
        if json:
            _print_json(msgspec.to_builtins(merged_values(one, (first, second))))
        else:
            console.print(merged_line(one, began_ns, render_recorded))
    if not json:
        widest_ms = max(one.placed.uncertainty_ns for one in merged) / 1e6
        print_text("cli.audit.merged", records=len(merged), first=first, second=second, widest_ms=widest_ms)


@cli.command()
def key(
    output: Annotated[Path | None, typer.Option("--output", "-o", callback=check_output, help="Write it here.")] = None,
    home: HomeOption = None,
) -> None:
    """Export the console's public key (PEM), with which anybody can check its signatures."""
    pem = load_public_key(find_home(home).keys / PUBLIC_FILE).pem
    if output is None:
        typer.echo(pem.decode(), nl=False)
    else:
        _write(output, pem)


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
            with _skip_unreadable():
                count += _print_records(path, RecordSelector(wanted), named=True, as_json=json)
    else:
        count = _print_records(find_session(folder, session), RecordSelector(wanted), follow=follow, as_json=json)
    if not count:
        typer.echo(tr("cli.audit.no_records"), err=True)


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
        _print_json(to_values(explanation))
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
        _print_json(msgspec.to_builtins(again.to_values()))
    else:
        _print_replayed(again)
    raise typer.Exit(1 if again.differences else 0)


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
    _write(output, page.encode())
    print_text("cli.audit.report", path=output, session=path.stem)


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
    _tell_omitted(omitted_lines(records_table, lines))


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
    _tell_omitted(omitted_lines(connect([parquet]), lines))


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
        with _skip_unreadable():
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


@contextmanager
def _skip_unreadable() -> Iterator[None]:
    """Name a session that can't be read on standard error, and go on with the others."""
    try:
        yield
    except AuditError as error:
        typer.echo(sanitize_terminal(render(error)), err=True)


def _tell_omitted(omitted: dict[str, int]) -> None:
    for path, count in omitted.items():
        typer.echo(sanitize_terminal(tr("cli.audit.omitted", count=count, path=path)), err=True)


def _print_json(values: Any) -> None:
    from json import dumps

    typer.echo(dumps(values, ensure_ascii=True, sort_keys=True))


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


def _print_records(
    path: Path, selector: RecordSelector, *, named: bool = False, follow: bool = False, as_json: bool
) -> int:
    """How many were printed. Lines hold the time alone: a new day, and with `named` the session, stand before them."""
    count, before = 0, ""
    console = Console(soft_wrap=True, highlight=False, markup=False, emoji=False)
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
                console.print(sanitize_terminal(f"{path.stem}  {day}"), style="bold")
            elif before not in ("", day):
                console.print(sanitize_terminal(day), style="bold")
            console.print(line_of(record, render_recorded))
            before = day
    return count


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


def evidence_of(paths: list[Path], given: list[Path] | None, copies: Path | None, home: Path | None) -> Evidence:
    """The keys given; else those of the home; else those of the console beside whose keys the trail lies."""
    beside = _logs_folder(paths[0]).parent / "keys"
    folder = find_home(home).keys if home or not beside.is_dir() else beside
    keys = tuple(load_public_key(path) for path in given) if given else known_keys(folder)
    is_own = folder.resolve() == beside.resolve()  # anchors are for the trails of their own home only
    anchors = read_anchors(folder) if is_own else {}
    return Evidence(keys=by_fingerprint(keys), copies=copies, anchors=anchors)


def _logs_folder(path: Path) -> Path:
    resolved = path.resolve()
    return resolved if resolved.is_dir() else resolved.parent


@contextmanager
def _reading_progress(paths: list[Path]) -> Iterator[Callable[[int], None]]:
    files = [file for path in paths for file in (path.glob("*.jsonl") if path.is_dir() else [path])]
    total = sum(file.stat().st_size for file in files if file.exists())
    columns = (BarColumn(), DownloadColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(tr("cli.audit.reading"), total=total)
        yield lambda done: progress.update(task, completed=done)


def _described(joins: list[Join]) -> Iterator[Text]:
    if joins:
        yield Text(tr("cli.audit.joins"))
    yield from (describe_join(one, render_recorded) for one in joins)


def _write_findings(path: Path, findings: list[Finding], joins: list[Join], status: int) -> None:
    content = {
        "files": [to_values(finding, render_recorded) for finding in findings],
        "joins": [join_values(join, render_recorded) for join in joins],
        "exit": status,
    }
    _write(path, msgspec.json.format(msgspec.json.encode(content)) + b"\n")


def _write(path: Path, data: bytes) -> None:
    try:
        write_whole(path, data)
    except OSError as error:
        raise AuditError(AuditFault.UNWRITABLE, path=path, detail=error.strerror) from error
