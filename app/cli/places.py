"""rleex locate, rleex version: where everything is kept, and what this is."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

cli = typer.Typer()


@cli.command()
def locate(home: Annotated[Path | None, typer.Option(help="Data directory.")] = None) -> None:
    """Tell where everything is kept."""
    from rich.console import Console
    from rich.table import Table

    from app.paths import find_home

    place = find_home(home)
    table = Table(box=None, show_header=False)
    for what, path in (
        ("home", place.root),
        ("configuration", place.config),
        ("patients", place.profiles),
        ("audit trails", place.logs),
        ("hand model", place.models),
        ("keys and operators", place.keys),
        ("recordings", place.recordings),
    ):
        table.add_row(what, str(path), "" if path.exists() else "(not there yet)")
    Console(soft_wrap=True).print(table)
