"""rleex audit: verify, merge, key."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import msgspec
import typer
from rich.console import Console
from rich.progress import BarColumn, DownloadColumn, Progress, TimeRemainingColumn
from rich.text import Text

from app.cli.audit.common import KeyOption, evidence_of, print_json, write_output
from app.cli.common import HomeOption, check_output, print_text, shown_after
from app.system.paths import find_home
from app.text.catalogue import tr
from app.text.recorded import render_recorded
from logs.errors import AuditError, AuditFault
from logs.findings import describe, to_values
from logs.join import Join, describe_join, join_findings, join_values
from logs.keys import PUBLIC_FILE, load_public_key
from logs.read import find_session
from logs.reading.errors import cause_of
from logs.verify import Finding, exit_status
from logs.verify import verify as assess

cli = typer.Typer()


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
    write_output(path, msgspec.json.format(msgspec.json.encode(content)) + b"\n")


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
            print_json(msgspec.to_builtins(merged_values(one, (first, second))))
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
        write_output(output, pem)
