"""rleex doctor."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

cli = typer.Typer()


@cli.command()
def doctor(home: Annotated[Path | None, typer.Option(help="Data directory.")] = None) -> None:
    """Is this machine fit for a session? Each finding with the command that mends it; ends 0 when nothing is bad."""
    from rich.console import Console

    from app.diagnostics.doctor import examine
    from app.diagnostics.findings import show
    from app.system.paths import find_home

    raise typer.Exit(0 if show(Console(), examine(find_home(home))) else 1)
