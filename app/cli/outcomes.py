"""rleex outcomes: what a patient's sessions came to, measure by measure."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from app.cli.common import HomeOption, check_output, print_text

cli = typer.Typer()


@cli.command()
def outcomes(
    sessions: Annotated[
        list[str] | None, typer.Argument(help="Recordings, or sessions: name, beginning of a name, or last.")
    ] = None,
    patient: Annotated[str, typer.Option(help="Only this patient; without sessions, all that the patient has.")] = "",
    json: Annotated[Path | None, typer.Option(callback=check_output, help="Write the figures here as well.")] = None,
    home: HomeOption = None,
) -> None:
    """Steps, distance, speed, cadence, symmetry, up-time, ranges of motion and dose of one patient's sessions."""
    from msgspec import json as text

    from app.cli.progress import wide_console
    from app.outcomes.history import outcomes_of, outcomes_of_patient
    from app.outcomes.table import outcomes_table, remarks, sources
    from app.system.paths import find_home
    from app.text.catalogue import render

    where = find_home(home)
    if patient and not sessions:
        found, refused = outcomes_of_patient(where, patient)
    else:
        found, refused = outcomes_of(where.logs, sessions or ["last"], patient), []
    wide_console().print(outcomes_table(found))
    for code, values in remarks(found):
        print_text(code, **values)
    for error in refused:
        typer.echo(render(error))
    for line in sources():
        typer.echo(line)
    if json is not None:
        json.write_bytes(text.format(text.encode(found), indent=1) + b"\n")
