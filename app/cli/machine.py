"""rleex doctor, rleex model, rleex locate: this machine, the hand model, and where everything is kept."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.console import Console

from app.cli.common import HomeOption, print_text
from app.cli.permission import sign_in
from app.diagnostics.findings import show
from app.system.config import load_config
from app.system.hand_model import set_up_model
from app.system.operators import Permission
from app.system.paths import find_home
from app.text.catalogue import tr, use_language
from logs.reason import sanitize_terminal

cli = typer.Typer()


@cli.command()
def doctor(home: HomeOption = None) -> None:
    """Check this machine for a session, with a remedy for each finding; exit status 0 if there is no fault."""
    from app.diagnostics.doctor import examine

    raise typer.Exit(0 if show(Console(), examine(find_home(home))) else 1)


@cli.command()
def model(
    home: HomeOption = None,
    again: Annotated[
        bool, typer.Option("--again", help="Build it again, even if it is there. An engineer signs in first.")
    ] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print nothing when all is well.")] = False,
) -> None:
    """Find the hand model, or download and build it (36 MB, once)."""
    place = find_home(home)
    if again:
        sign_in(home, Permission.CONFIGURE)
    path = set_up_model(place, load_config(place.config), again=again)
    if not quiet:
        print_text("cli.model", path=path)


@cli.command()
def configure(
    changes: Annotated[list[str], typer.Argument(help="camera.kind=webcam joints.kind=can language=zh … ")],
    home: HomeOption = None,
) -> None:
    """Change the configuration, in its own names and units; `none` takes a value away. An engineer signs in first."""
    from app.system.configure import change_config
    from profiles.files import CLEARED, parse_assignments

    by = sign_in(home, Permission.CONFIGURE)
    typed = parse_assignments(changes)
    if typed.get("language", CLEARED) != CLEARED:
        use_language(typed["language"])  # refuses one that does not exist
    changed = change_config(by, typed)
    for field, (before, after) in changed.items():
        typer.echo(sanitize_terminal(f"{field}: {before} → {after}"))
    if not changed:
        print_text("cli.profile.unchanged")


@cli.command()
def locate(home: HomeOption = None) -> None:
    """Print where data, configuration and model are stored."""
    from rich.cells import set_cell_size

    place = find_home(home)
    places = {
        "home": place.root,
        "configuration": place.config,
        "patients": place.profiles,
        "trails": place.logs,
        "model": place.models,
        "keys": place.keys,
    }
    for name, path in places.items():  # a path is never cut short
        missing = "" if path.exists() else f"  ({tr('cli.locate.missing')})"
        label = set_cell_size(tr(f"cli.locate.{name}"), 20)
        typer.echo(f"{label}{path}{missing}")
