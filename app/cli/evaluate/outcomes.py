"""rleex evaluate outcomes: the outcome measures beside MuJoCo's truth."""

from __future__ import annotations

import typer

from app.cli.common import HomeOption
from app.cli.evaluate.common import Json, progress, show
from app.evaluate.harness import write_json
from app.system.config import load_config, load_device
from app.system.paths import find_home
from app.text.catalogue import tr

cli = typer.Typer()


@cli.command()
def outcomes(json_file: Json = None, home: HomeOption = None) -> None:
    """Outcome measures of simulated patients beside MuJoCo's feet and clock; exit status 1 beyond 1 %."""
    from app.evaluate.outcomes.compare import CASES, LIMIT, compare, errors_table

    device = load_device(load_config(find_home(home).config).joints)
    with progress("walks", len(CASES)) as step:
        found = compare(CASES, device, step)
    show(errors_table(found))
    worst = max(abs(error) for one in found for error in one.errors.values())
    show(tr("evaluate.outcomes.worst", worst=worst, limit=LIMIT))
    write_json([one.as_json() for one in found], json_file)
    if not all(one.passed for one in found):
        raise typer.Exit(1)
