"""rleex export: recordings in other people's formats."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from app.cli.common import HomeOption, check_output_folder, print_text

cli = typer.Typer()


class Format(Enum):
    """What a recording can be exported to."""

    PARQUET = "parquet"
    CSV = "csv"
    C3D = "c3d"
    OPENSIM = "opensim"
    MCAP = "mcap"


@cli.command("export")
def export_recordings(
    sessions: Annotated[list[str], typer.Argument(help="Recordings, or sessions: name, beginning of a name, or last.")],
    to: Annotated[Format, typer.Option(help="File format; opensim writes .mot and .sto.")],
    output: Annotated[
        Path, typer.Option("--output", "-o", callback=check_output_folder, help="Folder to write into.")
    ] = Path(),
    home: HomeOption = None,
) -> None:
    """Hand recordings on, units and axes in each file."""
    from app.recording.export import export
    from app.recording.read import find_recording
    from app.system.paths import find_home

    for session in sessions:
        path = find_recording(find_home(home).logs, session)
        print_text("export.written", path=export(path, to.value, output))
