"""rleex profile: patients, one TOML file each."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from hal.cameras.camera import Camera
    from kgdfa.keypoints import HandDetector
    from profiles.store import ProfileStore

cli = typer.Typer(no_args_is_help=True)

HomeOption = Annotated[Path | None, typer.Option("--home", help="Data directory.")]
Patient = Annotated[str, typer.Argument(help="The patient's pseudonym, such as P-0042.")]
ByOption = Annotated[str, typer.Option("--by", help="Who makes the change; your user name unless told.")]


def _store(home: Path | None) -> ProfileStore:
    from app.motion.preflight import refuse_unfit
    from app.system.config import load_config
    from app.system.paths import find_home
    from hal.joints.device import DEFAULT_DEVICE, load_exoskeleton
    from profiles.store import ProfileStore

    place = find_home(home)
    described = load_config(place.config).joints.device
    device = load_exoskeleton(Path(described) if described else DEFAULT_DEVICE)
    return ProfileStore(place.profiles, checks=(refuse_unfit(device),))


def _who(by: str) -> str:
    import getpass

    return by or getpass.getuser()


@cli.command("list")
def list_patients(
    archived: Annotated[bool, typer.Option("--archived", help="The archived ones as well.")] = False,
    home: HomeOption = None,
) -> None:
    """All patients, and files that can't be used."""
    from rich.console import Console
    from rich.table import Table

    from profiles.palm import reference_segment

    listing = _store(home).list(archived=archived)
    table = Table("patient", "sex", "stature", "mass", "hand", "palm anchor", "note")
    for one in listing.profiles:
        palm = reference_segment(one)
        table.add_row(
            one.identifier + (" (archived)" if one.archived else ""),
            one.sex.value,
            f"{one.stature_m * 100:.0f} cm",
            f"{one.mass_kg:.0f} kg",
            one.hand.value,
            f"{palm.length_m * 100:.1f} ± {palm.sd_m * 100:.1f} cm, {palm.source.value}",
            one.note.splitlines()[0][:40] if one.note else "",
        )
    console = Console()
    console.print(table)
    for name, why in listing.broken:
        console.print(f"[red]not usable:[/red] {name}: ", end="")
        console.print(why, markup=False)


@cli.command()
def show(patient: Patient, home: HomeOption = None) -> None:
    """One patient as in the file, with what is known of the palm."""
    from rich.console import Console

    from profiles.files import encode
    from profiles.palm import palm_estimate, reference_segment

    profile = _store(home).load(patient)
    console = Console()
    console.print(encode(profile), markup=False, highlight=True)
    console.print(f"In use without a calibrated camera: {reference_segment(profile).sentence}.")
    console.print(f"By sex and stature: {palm_estimate(profile).sentence}.")


@cli.command()
def new(
    patient: Patient,
    sex: Annotated[str, typer.Option(help="female or male: chooses the anthropometric table.")],
    stature: Annotated[float, typer.Option(help="Stature, cm.")],
    mass: Annotated[float, typer.Option(help="Body mass, kg.")],
    more: Annotated[list[str] | None, typer.Argument(help="More fields: gait.step_length_cm=35 hand=left …")] = None,
    by: ByOption = "",
    home: HomeOption = None,
) -> None:
    """A new patient; everything else has sensible defaults that `set` changes."""
    from datetime import UTC, datetime

    from profiles.files import edit, parse_assignments
    from profiles.palm import reference_segment
    from profiles.schema import Profile, Sex

    blank = Profile(identifier=patient, sex=Sex.FEMALE, stature_m=1.7, mass_kg=70.0)
    typed = {"sex": sex, "stature_cm": str(stature), "mass_kg": str(mass), **parse_assignments(more or [])}
    profile = edit(blank, typed)
    _store(home).create(profile, by=_who(by), at=datetime.now(UTC))
    typer.echo(f"Patient {patient} is set up: {reference_segment(profile).sentence}.")


@cli.command("set")
def set_fields(
    patient: Patient,
    changes: Annotated[list[str], typer.Argument(help="gait.step_length_cm=35 palm.measured_width_cm=8.2 note=… ")],
    by: ByOption = "",
    why: Annotated[str, typer.Option(help="Kept in the history.")] = "",
    home: HomeOption = None,
) -> None:
    """Change fields, in the names and units that `show` shows; `none` takes an optional value away."""
    from datetime import UTC, datetime

    from profiles.files import edit, parse_assignments

    store = _store(home)
    profile = edit(store.load(patient), parse_assignments(changes))
    if profile.identifier != patient:
        from profiles.errors import ProfileError

        raise ProfileError("The identifier can't be changed: it ties the patient to the audit trail; make a new one.")
    change = store.save(profile, by=_who(by), at=datetime.now(UTC), why=why)
    if change is None:
        typer.echo("Nothing changed.")
        return
    for field, (before, after) in change.changes.items():
        typer.echo(f"{field}: {_shown(before)} → {_shown(after)}")


@cli.command()
def calibrate(
    patient: Patient,
    distance: Annotated[float, typer.Option(help="From the camera's front to the palm, cm; 30 is best.")],
    anyway: Annotated[bool, typer.Option("--anyway", help="Keep it even when it is not plausible.")] = False,
    by: ByOption = "",
    home: HomeOption = None,
) -> None:
    """Solve focal length × palm for this patient and the configured camera, at a distance measured by ruler."""
    from datetime import UTC, datetime

    from rich.console import Console

    from app.perception.palm_calibration import WANTED_SAMPLES, sample_palm
    from app.system.errors import AppError
    from profiles.palm import reference_segment, with_calibration

    store, console = _store(home), Console(soft_wrap=True)
    profile = store.load(patient)
    console.print(f"Hold the flat palm {distance:g} cm before the camera, fingers up, and keep still.")
    with _watching(home) as (camera, detector), console.status("Looking …") as status:
        sampler = sample_palm(
            profile,
            camera,
            detector,
            lambda now, _: status.update(f"{len(now.samples_m)} of {WANTED_SAMPLES} samples. {now.hint}"),
        )
        made = sampler.solve(camera.name, distance / 100, datetime.now(UTC))
    if made.doubt and not anyway:
        raise AppError(f"Not kept: {made.doubt} --anyway keeps it.")
    known = with_calibration(profile, made.calibration)
    store.save(known, by=_who(by), at=datetime.now(UTC), why=f"calibrated with {camera.name}")
    console.print(f"Kept for {camera.name}: {reference_segment(known, camera=camera.name).sentence};", highlight=False)
    console.print(f"samples scatter by {made.calibration.residual * 100:.1f} %. {made.doubt or 'Plausible.'}")


@contextmanager
def _watching(home: Path | None) -> Iterator[tuple[Camera, HandDetector]]:
    """The configured camera, open, and a hand detector."""
    from app.system.config import load_config
    from app.system.hand_model import set_up_model
    from app.system.paths import find_home
    from hal.cameras.factory import open_camera
    from kgdfa.keypoints import HandDetector

    place = find_home(home)
    config = load_config(place.config)
    seen = config.camera
    camera = open_camera(
        seen.kind,
        device=seen.device,
        width_px=seen.width_px,
        height_px=seen.height_px,
        rate_hz=seen.rate_hz,
        focal_px=seen.focal_px,
        mirrored=seen.mirrored,
        seed=seen.seed,
    )
    with HandDetector(set_up_model(place, config)) as detector:
        camera.open()
        try:
            yield camera, detector
        finally:
            camera.close()


@cli.command()
def export(patient: Patient, file: Path, home: HomeOption = None) -> None:
    """Copy a patient's profile to a file."""
    _store(home).export(patient, file)
    typer.echo(f"{patient} is in {file}.")


@cli.command("import")
def import_file(file: Path, by: ByOption = "", home: HomeOption = None) -> None:
    """Take in an exported profile; one that exists is changed, and its history kept."""
    from datetime import UTC, datetime

    profile = _store(home).import_file(file, by=_who(by), at=datetime.now(UTC))
    typer.echo(f"{profile.identifier} is taken in.")


@cli.command()
def archive(
    patient: Patient,
    back: Annotated[bool, typer.Option("--back", help="Take the patient back into the list.")] = False,
    by: ByOption = "",
    home: HomeOption = None,
) -> None:
    """Take a patient out of the list; nothing is ever deleted."""
    from datetime import UTC, datetime

    _store(home).archive(patient, by=_who(by), at=datetime.now(UTC), archived=not back)
    typer.echo(f"{patient} is {'back in the list' if back else 'archived; --back brings it back'}.")


@cli.command()
def history(patient: Patient, home: HomeOption = None) -> None:
    """Every change of a patient's profile: when, by whom, from what to what."""
    changes = _store(home).history(patient)
    if not changes:
        typer.echo(f"No changes of {patient} are kept.")
    for change in changes:
        typer.echo(f"{change.at} {change.by}{': ' + change.why if change.why else ''}")
        for field, (before, after) in change.changes.items():
            typer.echo(f"    {field}: {_shown(before)} → {_shown(after)}")


def _shown(value: object) -> str:
    return "–" if value is None else f"{value:g}" if isinstance(value, float) else str(value)
