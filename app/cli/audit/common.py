"""What the audit trail's commands share: whose signatures count, and how results are written."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from os.path import realpath
from pathlib import Path
from typing import Annotated, Any

import typer

from app.system.files import write_whole
from app.system.paths import Home, find_home
from app.text.catalogue import render
from logs.errors import AuditError, AuditFault
from logs.keys import PUBLIC_FILE, by_fingerprint, known_keys, load_public_key, read_anchors
from logs.reason import sanitize_terminal
from logs.verify import Evidence

KeyOption = Annotated[
    list[Path] | None, typer.Option("--key", help="Public key that must have signed; may be repeated.")
]


def evidence_of(paths: list[Path], given: list[Path] | None, copies: Path | None, home: Path | None) -> Evidence:
    """The keys given; else those of the home; else those of the console beside whose keys the trail lies."""
    own = find_home(home)
    beside = _keys_beside(paths[0], own)
    folder = own.keys if home or not beside.is_dir() else beside
    keys = tuple(load_public_key(path) for path in given) if given else known_keys(folder)
    is_own = realpath(folder) == realpath(beside)  # anchors are for the trails of their own home only
    anchors = read_anchors(folder) if is_own else {}
    return Evidence(keys=by_fingerprint(keys), copies=copies, anchors=anchors)


def _keys_beside(path: Path, own: Home) -> Path:
    """The keys of the home in which a trail, or a folder of them, lies.

    A logs folder may be a link to another disk: who can write there must not say whose signatures count.
    """
    named = path if path.is_dir() else path.parent
    real = Path(realpath(path))  # not `resolve`, which raises RuntimeError for links in a circle before Python 3.13
    real = real if real.is_dir() else real.parent
    if realpath(own.logs) in {realpath(named), str(real)}:
        return own.keys
    above = named / ".." if named.name in {"", ".."} else named.parent
    keys = above / own.keys.name
    return keys if (keys / PUBLIC_FILE).is_file() else real.parent / own.keys.name


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
