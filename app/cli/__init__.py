"""The `rleex` command. This file stays light: every process of a session reads it again when it is spawned."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from app.system.errors import AppError
from hal.errors import HardwareError
from kgdfa.errors import KgdfaError
from logs.errors import AuditError
from profiles.errors import ProfileError

if TYPE_CHECKING:
    import typer

USER_ERRORS = (AppError, HardwareError, KgdfaError, AuditError, ProfileError)


def main() -> None:
    """Run the command line; an error a user can cause ends with one sentence and exit status 2."""
    from app.cli.tree import tree

    try:
        tree(sys.argv[1:])()
    except USER_ERRORS as error:
        sys.stderr.write(f"rleex: {error}\n")
        raise SystemExit(2) from None


def __getattr__(name: str) -> typer.Typer:
    if name == "cli":  # the whole tree, built when somebody asks for it
        from app.cli.tree import tree

        return tree()
    raise AttributeError(name)
