"""rleex audit."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from logs.verify import Evidence, Finding

cli = typer.Typer(no_args_is_help=True)
HomeOption = Annotated[Path | None, typer.Option(help="Data directory.")]
KeyOption = Annotated[
    list[Path] | None, typer.Option("--key", help="Public key that must have signed; may be repeated.")
]


@cli.command()
def verify(
    files: Annotated[list[Path] | None, typer.Argument(help="Trails or folders; none: the home's.")] = None,
    key: KeyOption = None,
    copies: Annotated[Path | None, typer.Option(help="Second place of the checkpoints.")] = None,
    json: Annotated[Path | None, typer.Option(help="Write the findings here, too.")] = None,
    home: HomeOption = None,
) -> None:
    """Prove that nothing was changed, cut or added. Exit status: 0 sound, 1 tampered or cut, 2 unreadable."""
    from app.paths import find_home
    from logs.verify import exit_status
    from logs.verify import verify as judge

    paths = files or [find_home(home).logs]
    with _reading_progress(paths) as progress:
        findings = judge(paths, _evidence(paths, key, copies, home), progress)
    _print_findings(findings)
    status = exit_status(findings)
    if json is not None:
        _write_findings(json, findings, status)
    raise typer.Exit(status)


@cli.command()
def key(
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Write it here.")] = None,
    home: HomeOption = None,
) -> None:
    """Export the console's public key (PEM), with which anybody can check its signatures."""
    from app.paths import find_home
    from logs.keys import PUBLIC_FILE, load_public_key

    pem = load_public_key(find_home(home).keys / PUBLIC_FILE).pem
    if output is None:
        typer.echo(pem.decode(), nl=False)
    else:
        _write(output, pem)


def _evidence(paths: list[Path], given: list[Path] | None, copies: Path | None, home: Path | None) -> Evidence:
    """The keys given; else those of the home; else those of the console beside whose keys the trail lies."""
    from app.paths import find_home
    from logs.keys import by_fingerprint, known_keys, load_public_key
    from logs.verify import Evidence

    if given:
        return Evidence(keys=by_fingerprint(load_public_key(path) for path in given), copies=copies)
    folder = find_home(home).keys if home else _logs_folder(paths[0]).parent / "keys"
    keys = known_keys(folder) or known_keys(find_home(home).keys)
    return Evidence(keys=by_fingerprint(keys), copies=copies)


def _logs_folder(path: Path) -> Path:
    resolved = path.resolve()
    return resolved if resolved.is_dir() else resolved.parent


@contextmanager
def _reading_progress(paths: list[Path]) -> Iterator[Callable[[int], None]]:
    from rich.console import Console
    from rich.progress import BarColumn, DownloadColumn, Progress, TimeRemainingColumn

    files = [file for path in paths for file in (path.glob("*.jsonl") if path.is_dir() else [path])]
    total = sum(file.stat().st_size for file in files if file.exists())
    columns = (BarColumn(), DownloadColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("reading", total=total)
        yield lambda done: progress.update(task, completed=done)


def _print_findings(findings: list[Finding]) -> None:
    from rich.console import Console

    from logs.findings import describe

    console = Console(soft_wrap=True, highlight=False)
    for finding in findings:
        console.print(describe(finding))


def _write_findings(path: Path, findings: list[Finding], status: int) -> None:
    import msgspec

    from logs.findings import as_plain

    told = {"files": [as_plain(finding) for finding in findings], "exit": status}
    _write(path, msgspec.json.format(msgspec.json.encode(told)) + b"\n")


def _write(path: Path, data: bytes) -> None:
    from logs.errors import AuditError

    try:
        path.write_bytes(data)
    except OSError as error:
        raise AuditError(f"{path} can't be written: {error.strerror}; choose another place.") from error
