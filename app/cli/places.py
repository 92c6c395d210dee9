"""rleex locate, rleex version: where everything is kept, and what this is."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

cli = typer.Typer()


@cli.command()
def locate(home: Annotated[Path | None, typer.Option(help="Data directory.")] = None) -> None:
    """Tell where everything is kept."""
    from app.system.paths import find_home

    place = find_home(home)
    for what, path in (
        ("home", place.root),
        ("configuration", place.config),
        ("patients", place.profiles),
        ("audit trails", place.logs),
        ("hand model", place.models),
        ("keys and operators", place.keys),
        ("recordings", place.recordings),
    ):
        typer.echo(f"{what:<20}{path}{'' if path.exists() else '  (not there yet)'}")  # a path is never cut short
