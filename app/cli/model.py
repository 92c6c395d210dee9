"""rleex model: set up the hand model."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

cli = typer.Typer()


@cli.command()
def model(
    home: Annotated[Path | None, typer.Option(help="Data directory.")] = None,
    again: Annotated[bool, typer.Option("--again", help="Build it anew, whatever is there.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Say nothing when all is well.")] = False,
) -> None:
    """Find the hand model, or fetch and build it (36 MB, once)."""
    from app.system.config import load_config
    from app.system.hand_model import MODEL_NAME, set_up_model
    from app.system.paths import find_home

    place = find_home(home)
    if again:
        (place.models / MODEL_NAME).unlink(missing_ok=True)
    path = set_up_model(place, load_config(place.config))
    if not quiet:
        typer.echo(f"Hand model: {path}")
