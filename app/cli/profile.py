"""rleex profile: patients, one TOML file each."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from app.cli.common import CliFault, HomeOption, check_finite, check_output, print_text
from app.cli.permission import sign_in
from app.system.config import load_config, load_device
from app.system.errors import AppError
from app.system.hand_model import set_up_model
from app.system.operators import Permission
from app.system.paths import find_home
from app.text.catalogue import knows, render, tr
from logs.reason import sanitize_terminal
from profiles.files import edit, encode, parse_assignments
from profiles.palm import (
    calibrated_camera,
    check_distance,
    explain_estimate,
    palm_estimate,
    reference_segment,
    with_calibration,
)
from profiles.schema import Profile, Sex
from profiles.store import ChangeCause, ProfileStore

if TYPE_CHECKING:
    from hal.cameras.camera import Camera
    from kgdfa.keypoints import HandDetector

cli = typer.Typer(no_args_is_help=True)

Patient = Annotated[str, typer.Argument(help="The patient's pseudonym, such as P-0042.")]


def _store(home: Path | None) -> ProfileStore:
    from app.motion.preflight import refuse_unfit

    place = find_home(home)
    device = load_device(load_config(place.config).joints)
    return ProfileStore(place.profiles, checks=(refuse_unfit(device),))


@cli.command("list")
def list_patients(
    archived: Annotated[bool, typer.Option("--archived", help="The archived ones as well.")] = False,
    home: HomeOption = None,
) -> None:
    """List all patients, and files that cannot be used."""
    listing = _store(home).list(archived=archived)
    columns = ("patient", "sex", "stature", "mass", "hand", "palm", "note")
    table = Table(*(tr(f"cli.profile.{column}") for column in columns))
    for one in listing.profiles:
        table.add_row(
            tr("cli.profile.archived_name", patient=one.identifier) if one.archived else one.identifier,
            tr(one.sex),
            f"{one.stature_m * 100:.0f} cm",
            f"{one.mass_kg:.0f} kg",
            tr(one.hand),
            _palm_text(one),
            Text(sanitize_terminal(one.note.splitlines()[0][:40] if one.note else "")),
        )
    console = Console()
    console.print(table)
    for name, why in listing.broken:
        console.print(f"{tr('cli.profile.not_usable')} {sanitize_terminal(name)}: ", end="", style="red", markup=False)
        console.print(sanitize_terminal(render(why)), markup=False)


@cli.command()
def show(patient: Patient, home: HomeOption = None) -> None:
    """Show one patient's profile, with the palm estimate and its error."""
    profile = _store(home).load(patient)
    console = Console()
    for line in encode(profile).split("\n"):
        console.print(sanitize_terminal(line), markup=False, highlight=True)
    console.print(tr("cli.profile.palm_in_use", palm=reference_segment(profile).explain()))
    console.print(tr("cli.profile.palm_by_table", palm=explain_estimate(palm_estimate(profile))))


@cli.command()
def new(
    patient: Patient,
    sex: Annotated[Sex, typer.Option(help="female or male: chooses the anthropometric table.")],
    stature: Annotated[float, typer.Option(callback=check_finite, help="Stature, cm.")],
    mass: Annotated[float, typer.Option(callback=check_finite, help="Body mass, kg.")],
    more: Annotated[list[str] | None, typer.Argument(help="More fields: gait.step_length_cm=35 hand=left …")] = None,
    home: HomeOption = None,
) -> None:
    """Create a patient; other fields have defaults that `set` changes. A therapist signs in first."""
    by = sign_in(home, Permission.EDIT_PATIENTS)

    blank = Profile(identifier=patient, sex=Sex.FEMALE, stature_m=1.7, mass_kg=70.0)
    typed = {"sex": sex.value, "stature_cm": str(stature), "mass_kg": str(mass), **parse_assignments(more or [])}
    profile = edit(blank, typed)
    _store(home).create(profile, by=by, at=datetime.now(UTC))
    print_text("cli.profile.created", patient=patient, palm=reference_segment(profile).explain())


@cli.command("set")
def set_fields(
    patient: Patient,
    changes: Annotated[list[str], typer.Argument(help="gait.step_length_cm=35 palm.measured_width_cm=8.2 note=… ")],
    why: Annotated[str, typer.Option(help="Kept in the history.")] = "",
    home: HomeOption = None,
) -> None:
    """Change fields, in the names and units that `show` shows; `none` takes an optional value away.

    A therapist signs in first.
    """
    by = sign_in(home, Permission.EDIT_PATIENTS)

    store = _store(home)
    profile = edit(store.load(patient), parse_assignments(changes))
    change = store.save(profile, by=by, at=datetime.now(UTC), why=why)
    if change is None:
        print_text("cli.profile.unchanged")
        return
    for field, (before, after) in change.changes.items():
        typer.echo(f"{field}: {_shown(before)} → {_shown(after)}")


@cli.command()
def calibrate(
    patient: Patient,
    distance: Annotated[
        float, typer.Option(callback=check_finite, help="From the camera's front to the palm, cm; 30 is best.")
    ],
    anyway: Annotated[bool, typer.Option("--anyway", help="Keep it even when it is not plausible.")] = False,
    home: HomeOption = None,
) -> None:
    """Solve focal length × palm for this patient and the configured camera, at a distance measured by ruler.

    A therapist or engineer signs in first.
    """
    by = sign_in(home, Permission.CALIBRATE)
    check_distance(distance / 100)

    from app.perception.palm_calibration import WANTED_SAMPLES, sample_palm

    store, console = _store(home), Console(soft_wrap=True)
    profile = store.load(patient)
    console.print(tr("cli.profile.hold_palm", distance_cm=distance))
    with _watching(home) as (camera, detector), console.status(tr("cli.profile.sampling")) as status:
        sampler = sample_palm(
            profile,
            camera,
            detector,
            lambda now, _: status.update(
                tr("cli.profile.samples", samples=len(now.samples_m), wanted=WANTED_SAMPLES, hint=now.hint)
            ),
        )
        made = sampler.solve(camera.name, distance / 100, datetime.now(UTC))
    if made.doubt and not anyway:
        raise AppError(CliFault.NOT_KEPT, doubt=made.doubt)
    known = with_calibration(store.load(patient), made.calibration)  # others may have changed it meanwhile
    store.save(known, by=by, at=datetime.now(UTC), why=ChangeCause.CALIBRATED.key)
    kept = {"camera": camera.name, "palm": reference_segment(known, camera=camera.name).explain()}
    line = tr("cli.profile.kept", scatter=made.calibration.residual, **kept)
    console.print(sanitize_terminal(line), highlight=False, markup=False)
    console.print(render(made.doubt) if made.doubt else tr("cli.profile.plausible"))


@contextmanager
def _watching(home: Path | None) -> Iterator[tuple[Camera, HandDetector]]:
    """The configured camera, open, with its measured intrinsics, and a hand detector."""
    from app.cli.camera import open_as
    from kgdfa.keypoints import live_detector

    place = find_home(home)
    config = load_config(place.config)
    with closing(open_as(config.camera, config.camera.kind, config.camera.device, place.cameras)) as camera:
        camera.open()
        with live_detector(set_up_model(place, config)) as detector:
            yield camera, detector


@cli.command()
def export(
    patient: Patient,
    file: Annotated[Path, typer.Argument(callback=check_output, help="Where to; a TOML file.")],
    home: HomeOption = None,
) -> None:
    """Copy a patient's profile to a file."""
    _store(home).export(patient, file)
    print_text("cli.profile.exported", patient=patient, path=file)


@cli.command("import")
def import_file(
    file: Annotated[Path, typer.Argument(help="An exported profile, TOML.")], home: HomeOption = None
) -> None:
    """Import an exported profile; one that exists is changed, and its history kept. A therapist signs in first."""
    by = sign_in(home, Permission.EDIT_PATIENTS)

    profile = _store(home).import_file(file, by=by, at=datetime.now(UTC))
    print_text("cli.profile.imported", patient=profile.identifier)


@cli.command()
def archive(
    patient: Patient,
    back: Annotated[bool, typer.Option("--back", help="Put the patient back on the list.")] = False,
    home: HomeOption = None,
) -> None:
    """Remove a patient from the list; nothing is ever deleted. A therapist signs in first."""
    by = sign_in(home, Permission.EDIT_PATIENTS)

    _store(home).archive(patient, by=by, at=datetime.now(UTC), archived=not back)
    print_text("cli.profile.restored" if back else "cli.profile.archived", patient=patient)


@cli.command()
def history(patient: Patient, home: HomeOption = None) -> None:
    """Every change of a patient's profile: when, by whom, from what to what."""
    changes = _store(home).history(patient)
    if not changes:
        print_text("cli.profile.no_history", patient=patient)
    for change in changes:
        why = tr(change.why) if knows(change.why) else change.why
        typer.echo(sanitize_terminal(f"{change.at} {change.by or tr('history.nobody')}{': ' + why if why else ''}"))
        for field, (before, after) in change.changes.items():
            typer.echo(sanitize_terminal(f"    {field}: {_shown(before)} → {_shown(after)}"))


def _palm_text(profile: Profile) -> Text:
    camera = calibrated_camera(profile)
    palm = reference_segment(profile, camera=camera)
    source = f"{tr(palm.source)}, {camera}" if camera else tr(palm.source)
    return Text(sanitize_terminal(f"{palm.length_m * 100:.1f} ± {palm.sd_m * 100:.1f} cm, {source}"))


def _shown(value: object) -> str:
    return "–" if value is None else f"{value:g}" if isinstance(value, float) else str(value)
