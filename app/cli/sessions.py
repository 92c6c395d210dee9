"""rleex export, replay, query, outcomes: what recorded sessions hold, in files, as a film, as rows, as measures."""

from __future__ import annotations

from contextlib import closing
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from app.cli.common import (
    HomeOption,
    Json,
    bar,
    check_finite,
    check_output,
    check_output_folder,
    check_replaced,
    print_answer,
    print_text,
    shown_after,
    sql_of,
    wide_console,
)
from app.system.paths import Home, find_home
from app.text.catalogue import render

if TYPE_CHECKING:
    from app.outcomes.session import SessionOutcomes
    from logs.sites import Site

cli = typer.Typer()
SESSIONS = typer.Argument(help="Recordings, or sessions: name, beginning of a name, or last.")


class Format(Enum):
    """What a session can be exported to; FHIR holds its outcomes, and needs no recording."""

    PARQUET = "parquet"
    CSV = "csv"
    C3D = "c3d"
    OPENSIM = "opensim"
    MCAP = "mcap"
    FHIR = "fhir"


@cli.command()
def export(
    sessions: Annotated[list[str], SESSIONS],
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
    from app.outcomes.session import find_outcomes
    from app.recording.read import find_recording

    where = find_home(home)
    if to is Format.FHIR:
        outcomes = [find_outcomes(where.logs, session) for session in sessions]  # all, before the first is written
        key = _key(where) if deidentify else None
        for found in outcomes:
            print_text("export.written", path=_write_outcomes(found, output, key))
    else:
        recordings = [find_recording(where.logs, session) for session in sessions]
        key = _key(where) if deidentify else None
        for path in recordings:
            _write_recording(path, to, output, key)


def _key(home: Home) -> bytes:
    from app.recording.deidentify import KEY_FILE
    from app.recording.encryption import load_or_make_secret
    from app.recording.samples import ExportFault
    from app.system.errors import AppError
    from logs.reading.errors import cause_of

    try:
        return load_or_make_secret(home.keys, KEY_FILE)
    except OSError as error:
        raise AppError(ExportFault.UNWRITABLE, path=home.keys / KEY_FILE, detail=cause_of(error)) from error


def _write_recording(path: Path, to: Format, output: Path, key: bytes | None) -> None:
    from app.recording.deidentify import deidentify_recording
    from app.recording.export import export

    done = export(path, to.value, output, None if key is None else deidentify_recording(path, key))
    for file in done.files:
        print_text("export.written", path=file)
    if not done.recording.complete:
        print_text("export.cut", path=path)


def _write_outcomes(found: SessionOutcomes, output: Path, key: bytes | None) -> Path:
    from app.outcomes.fhir import export_bundle
    from app.recording.deidentify import deidentify

    return export_bundle(found, output, None if key is None else deidentify(found.patient, found.began, key))


@cli.command()
def replay(
    file: Annotated[
        str, typer.Argument(help="A recording, or a session: name, beginning of a name, or last.")
    ] = "last",
    film_file: Annotated[
        Path | None, typer.Option("--film", callback=check_output, help="The MP4 to write; else SESSION.mp4.")
    ] = None,
    from_s: Annotated[
        float | None, typer.Option("--from", callback=check_finite, help="Seconds from the beginning, or the event.")
    ] = None,
    to_s: Annotated[
        float | None, typer.Option("--to", callback=check_finite, help="Seconds from the beginning, or the event.")
    ] = None,
    speed: Annotated[
        float, typer.Option(callback=check_finite, help="Recorded seconds in a second of film.", min=0.05, max=50)
    ] = 1.0,
    event: Annotated[
        str, typer.Option(help="Begin at this record: its number, or the first of an event or a kind by name.")
    ] = "",
    home: HomeOption = None,
) -> None:
    """Make a film of a recording: hand, legs, joints, distance, gait and events on one time axis."""
    from app.playback.film import film, stretch_of
    from app.playback.session import Playback
    from app.recording.read import find_recording

    with closing(Playback(find_recording(find_home(home).logs, file))) as playback:
        target = film_file or check_replaced(Path(f"{playback.name}.mp4"))
        stretch = stretch_of(playback, from_s, to_s, event, speed)
        try:
            with bar(wide_console(), target.name, stretch.frames) as step:
                frames = film(playback, target, stretch, step)
        except KeyboardInterrupt:
            print_text("film.stopped", path=target)
            raise typer.Exit(130) from None
        print_text("film.written", path=target, frames=frames, from_s=stretch.from_s, to_s=stretch.to_s)
        if playback.index.cut:
            print_text("film.cut", path=playback.path)
        if playback.index.damaged_chunks:
            print_text("film.damaged", path=playback.path, chunks=len(playback.index.damaged_chunks))


@cli.command()
def query(
    sites: Annotated[
        list[str] | None, typer.Argument(help="PATH or NAME=PATH of each site: a home, trails or Parquet; none: home.")
    ] = None,
    sql: Annotated[str, typer.Option(help="SQL over the table `records`, whose column `site` names the site.")] = "",
    ask: Annotated[str, typer.Option(help="A ready question: unintended, refusals, response, faults, sites.")] = "",
    spark: Annotated[
        str, typer.Option(help="Ask this Spark master (spark://HOST:PORT, local[2]) instead of DuckDB.")
    ] = "",
    json: Annotated[bool, typer.Option("--json", help="One JSON object a row.")] = False,
    home: HomeOption = None,
) -> None:
    """Query the sessions of several sites. A site that is missing or tampered is refused by name."""
    from app.cli.audit.common import evidence_of
    from logs.sites import SITE_QUESTIONS, check_site, find_sites

    wanted = sql_of(sql, ask, SITE_QUESTIONS)
    found = find_sites(sites or [str(find_home(home).root)])
    for site in found:
        known = check_site(site, lambda path: evidence_of([path], None, None, None if sites else home))
        typer.echo(render(known), err=True)
    print_answer(_answer(found, wanted, spark), json=json)


def _answer(sites: list[Site], sql: str, spark: str) -> Any:
    from logs.query import LIMIT_S, ask
    from logs.sites import connect_sites

    if not spark:
        return ask(connect_sites(sites), sql)
    from logs.spark import ask_spark, spark_session

    with spark_session(spark) as session:
        return ask_spark(session, sites, sql, LIMIT_S)


@cli.command()
def outcomes(
    sessions: Annotated[list[str] | None, SESSIONS] = None,
    patient: Annotated[str, typer.Option(help="Only this patient; without sessions, all that the patient has.")] = "",
    json: Json = None,
    home: HomeOption = None,
) -> None:
    """Steps, distance, speed, cadence, symmetry, up-time, ranges of motion and dose of one patient's sessions."""
    from app.evaluate.harness import write_json
    from app.outcomes.history import outcomes_of, outcomes_of_patient
    from app.outcomes.table import outcomes_table, remarks, sources

    where = find_home(home)
    if patient and not sessions:
        found, refused = outcomes_of_patient(where, patient)
    else:
        found, refused = outcomes_of(where.logs, sessions or ["last"], patient), []

    def print_all() -> None:
        wide_console().print(outcomes_table(found))
        for code, values in remarks(found):
            print_text(code, **values)
        for error in refused:
            typer.echo(render(error))
        for line in sources():
            typer.echo(line)

    with shown_after(print_all):
        write_json(found, json)
