"""What the commands share: the option of the data directory, refusals, and text in the language in use."""

from __future__ import annotations

from enum import Enum, auto
from pathlib import Path
from typing import Annotated

import typer

HomeOption = Annotated[Path | None, typer.Option("--home", help="Data directory.")]


class CliFault(Enum):
    """What a command refuses by itself."""

    NO_SUCH_ROLE = auto()  # role
    NO_OPERATORS = auto()
    NOT_AN_ENGINEER = auto()  # name
    NO_QUESTION = auto()  # ready
    NOT_KEPT = auto()  # doubt


def print_text(key: str, **values: object) -> None:
    """Print a text of the catalogues."""
    from app.text.catalogue import tr

    typer.echo(tr(key, **values))
