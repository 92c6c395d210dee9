"""What the audit trail's commands share: whose signatures count, and how results are written."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from app.system.files import write_whole
from app.system.paths import find_home
from app.text.catalogue import render
from logs.errors import AuditError, AuditFault
from logs.keys import by_fingerprint, known_keys, load_public_key, read_anchors
from logs.reason import sanitize_terminal
from logs.verify import Evidence

KeyOption = Annotated[
    list[Path] | None, typer.Option("--key", help="Public key that must have signed; may be repeated.")
]


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


def print_json(values: Any) -> None:
    """One object as a line of pure ASCII."""
    from json import dumps

    typer.echo(dumps(values, ensure_ascii=True, sort_keys=True))


def write_output(path: Path, data: bytes) -> None:
    """A whole file, or what was there stays. Raises AuditError."""
    try:
        write_whole(path, data)
    except OSError as error:
        raise AuditError(AuditFault.UNWRITABLE, path=path, detail=error.strerror) from error


@contextmanager
def skip_unreadable() -> Iterator[None]:
    """Name a session that can't be read on standard error, and go on with the others."""
    try:
        yield
    except AuditError as error:
        typer.echo(sanitize_terminal(render(error)), err=True)
