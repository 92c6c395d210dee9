"""rleex export: recordings and outcomes in other people's formats."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from app.cli.common import HomeOption, check_output_folder, print_text

if TYPE_CHECKING:
    from app.system.paths import Home

cli = typer.Typer()


class Format(Enum):
    """What a session can be exported to; FHIR holds its outcomes, and needs no recording."""

    PARQUET = "parquet"
    CSV = "csv"
    C3D = "c3d"
    OPENSIM = "opensim"
    MCAP = "mcap"
    FHIR = "fhir"


@cli.command("export")
def export_recordings(
    sessions: Annotated[list[str], typer.Argument(help="Recordings, or sessions: name, beginning of a name, or last.")],
    to: Annotated[
        Format,
        typer.Option(help="File format; opensim writes .mot and .sto, fhir the outcomes as an HL7 FHIR R5 bundle."),
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", callback=check_output_folder, help="Folder to write into.")
    ] = Path(),
    deidentify: Annotated[
        bool,
        typer.Option(
            "--deidentify", help="Shift a patient's dates by the same days, and leave out trail and operators."
        ),
    ] = False,
    home: HomeOption = None,
) -> None:
    """Hand recordings and outcomes on, units and axes in each file."""
    from app.system.paths import find_home

    where = find_home(home)
    key = _key(where) if deidentify else None
    for session in sessions:
        if to is Format.FHIR:
            print_text("export.written", path=_write_outcomes(where, session, output, key))
        else:
            _write_recording(where, session, to, output, key)


def _key(home: Home) -> bytes:
    from app.recording.deidentify import KEY_FILE
    from app.recording.encryption import load_or_make_secret
    from app.recording.export import ExportFault
    from app.system.errors import AppError
    from logs.reading.errors import cause_of

    try:
        return load_or_make_secret(home.keys, KEY_FILE)
    except OSError as error:
        raise AppError(ExportFault.UNWRITABLE, path=home.keys / KEY_FILE, detail=cause_of(error)) from error


def _write_recording(home: Home, session: str, to: Format, output: Path, key: bytes | None) -> None:
    from app.recording.deidentify import deidentify_recording
    from app.recording.export import export, is_cut
    from app.recording.read import find_recording

    path = find_recording(home.logs, session)
    target = export(path, to.value, output, None if key is None else deidentify_recording(path, key))
    print_text("export.written", path=target)
    if is_cut(path):
        print_text("export.cut", path=path)


def _write_outcomes(home: Home, session: str, output: Path, key: bytes | None) -> Path:
    from app.outcomes.fhir import export_bundle
    from app.outcomes.session import find_outcomes
    from app.recording.deidentify import deidentify

    found = find_outcomes(home.logs, session)
    return export_bundle(found, output, None if key is None else deidentify(found.patient, found.began, key))
