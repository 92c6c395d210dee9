"""rleex evaluate gestures, video, preprocessing, speed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from rich.console import Console

    from app.evaluate.gesture_photos import Photo, SeenPhoto
    from kgdfa.images import Image
    from kgdfa.preprocess import Prepare

cli = typer.Typer()

Json = Annotated[Path | None, typer.Option("--json", help="Write the figures here as well.")]
Home = Annotated[Path | None, typer.Option("--home", help="Data directory.")]
FIT_DIGITAL = 40  # digital hands a pose that a fit sees beside the photos


@cli.command()
def gestures(
    directory: Annotated[Path | None, typer.Argument(help="Folder with labels.csv and pictures.")] = None,
    json_file: Json = None,
    errors: Annotated[Path | None, typer.Option(help="Write the misjudged pictures here, drawn upon.")] = None,
    png: Annotated[Path | None, typer.Option(help="Write the confusion matrices here as a PNG.")] = None,
    cross_validate: Annotated[
        bool, typer.Option("--cross-validate", help="Fit anew for each source of photos left out.")
    ] = False,
    keypoints: Annotated[
        Path | None, typer.Option(help="Keep the keypoints in this npz, and use it when it is there.")
    ] = None,
    digital: Annotated[
        int, typer.Option(help="Measure on this many digital hands a pose instead of a folder.", min=0)
    ] = 0,
    single_look: Annotated[bool, typer.Option("--single-look", help="Judge one look, as in video.")] = False,
    prepare: Annotated[str, typer.Option(help="Preprocessing: none, denoise, sharpen or denoise+sharpen.")] = "none",
    home: Home = None,
) -> None:
    """Table 3: how well both rule sets recognise gestures, and refuse what is none."""
    from rich.console import Console

    from app.errors import AppError
    from app.evaluate import gesture_report as report
    from app.evaluate.gestures import CROSS_VALIDATED, SHIPPED, judge_as_shipped, judge_cross_validated, measure_all
    from kgdfa.preprocess import find_preparation

    step = find_preparation(prepare)
    if (directory is None) == (digital == 0):
        raise AppError("Give a folder with labels.csv, or --digital N, and not both.")
    console = Console()
    looks = 1 if single_look else None
    seen = (
        _seen_digital(console, digital, home, step) if digital else looked_at(console, directory, keypoints, home, step)
    )
    if cross_validate:
        with_digital = looked_at_digital_to_fit(console, keypoints, home)
        with console.status("fitting") as status:
            judged = judge_cross_validated(seen, with_digital, status.update, looks=looks)
    else:
        judged = judge_as_shipped(seen, looks=looks)
    figures = measure_all(judged)
    for name, one in figures.items():
        report.print_figures(console, name, one, len(seen))
        report.print_confusion(console, name, one)
    how = CROSS_VALIDATED if cross_validate else SHIPPED
    console.print(f"robust: {how}; {'one look' if single_look or digital else 'up to six looks'} a picture")
    _list_unreadable(console, seen)
    if json_file is not None:
        report.write_json(report.as_json(figures, seen, how), json_file)
    if png is not None:
        report.write_confusion(figures, png)
    if errors is not None and directory is not None:
        count = report.write_errors(judged["robust"], seen, directory, errors)
        console.print(f"{count} misjudged pictures, drawn upon where they can be read, in {errors}")


def _model(home: Path | None) -> Path:
    from app.config import load_config
    from app.model import set_up_model
    from app.paths import find_home

    place = find_home(home)
    return set_up_model(place, load_config(place.config))


def looked_at(
    console: Console,
    directory: Path | None,
    keypoints: Path | None,
    home: Path | None,
    prepare: Prepare | None = None,
) -> list[SeenPhoto]:
    """The photos of a folder, looked at now or read from the keypoint file."""
    from app.cli.progress import bar
    from app.evaluate.gesture_photos import read_labels, see_all
    from app.evaluate.keypoint_file import load_seen, save_seen
    from kgdfa.images import as_bgr8

    assert directory is not None
    photos: list[Photo] = read_labels(directory)
    if keypoints is not None and keypoints.exists():
        return load_seen(keypoints, photos)
    with bar(console, "looking at photos", len(photos)) as tell:
        seen = see_all(photos, directory, _model(home), tell, prepare or as_bgr8)
    if keypoints is not None:
        save_seen(seen, keypoints)
    return seen


def _seen_digital(console: Console, per_pose: int, home: Path | None, prepare: Prepare) -> list[SeenPhoto]:
    from app.cli.progress import bar
    from app.evaluate.digital_hands import MEASURE_SEEDS, digital_scenes, see_digital
    from hal.cameras.hand_poses import POSES

    with bar(console, "looking at digital hands", per_pose * len(POSES)) as tell:
        return see_digital(_model(home), digital_scenes(per_pose, MEASURE_SEEDS), tell, prepare)


def looked_at_digital_to_fit(console: Console, keypoints: Path | None, home: Path | None) -> list[SeenPhoto]:
    """The digital hands that every fit sees, kept beside the photos' keypoints."""
    from app.cli.progress import bar
    from app.evaluate.digital_hands import FIT_SEEDS, digital_scenes, see_digital
    from app.evaluate.digital_near import near_scenes
    from app.evaluate.keypoint_file import load_seen, save_seen

    scenes = [*digital_scenes(FIT_DIGITAL, FIT_SEEDS), *near_scenes()]
    photos = [photo for photo, _, _ in scenes]
    file = keypoints.with_stem(keypoints.stem + "-digital") if keypoints is not None else None
    if file is not None and file.exists():
        return load_seen(file, photos)
    with bar(console, "looking at digital hands to fit on", len(photos)) as tell:
        seen = see_digital(_model(home), scenes, tell)
    if file is not None:
        save_seen(seen, file)
    return seen


def _list_unreadable(console: Console, seen: list[SeenPhoto]) -> None:
    unreadable = [one for one in seen if one.error]
    if unreadable:
        console.print(f"{len(unreadable)} pictures could not be read and count as misjudged:")
        for one in unreadable:
            console.print(f"  {one.photo.path}: {one.error}")


@cli.command()
def video(
    where: Annotated[Path, typer.Argument(help="Folder with frames.csv, or a video file.")],
    labels: Annotated[
        Path | None, typer.Option(help="A video's labels, as lines of frame,label; else the .csv beside it.")
    ] = None,
    json_file: Json = None,
    home: Home = None,
) -> None:
    """How steadily both rule sets tell gestures in labelled footage."""
    import msgspec
    from rich.console import Console
    from rich.table import Table

    from app.cli.progress import bar
    from app.evaluate.footage import read_footage
    from app.evaluate.gesture_report import write_json
    from app.evaluate.video import measure_sequence, run_sequence, said
    from kgdfa.published import PublishedRules
    from kgdfa.robust import RobustRules
    from kgdfa.verdict import RuleSet

    console, footage = Console(), read_footage(where, labels)
    figures = {}
    rule_sets: tuple[RuleSet, ...] = (PublishedRules(), RobustRules())
    for rules in rule_sets:
        with bar(console, f"{rules.name} rules", len(footage.labels)) as tell:
            spoken = [said(report) for report in run_sequence(footage, _model(home), rules, tell)]
        figures[rules.name] = measure_sequence(
            footage.labels, [raw for raw, _ in spoken], [voted for _, voted in spoken]
        )
    table = Table(title=f"{where}: {len(footage.labels)} frames")
    table.add_column("")
    for name in figures:
        table.add_column(name, justify="right")
    plain: dict[str, dict[str, float]] = {name: msgspec.to_builtins(one) for name, one in figures.items()}
    for field in next(iter(plain.values())):
        table.add_row(field.replace("_", " "), *(f"{one[field]:.3g}" for one in plain.values()))
    console.print(table)
    if json_file is not None:
        write_json({"frames": len(footage.labels), "rules": plain}, json_file)


@cli.command()
def preprocessing(
    directory: Annotated[Path | None, typer.Argument(help="Folder with labels.csv; without it, digital hands.")] = None,
    every: Annotated[int, typer.Option(help="Take every so-manieth photo.", min=1)] = 12,
    digital: Annotated[int, typer.Option(help="How many digital hands a pose, without a folder.", min=1)] = 5,
    json_file: Json = None,
    home: Home = None,
) -> None:
    """What denoising, sharpening and brightening are worth on dark, grainy and blurred pictures."""
    import msgspec
    from rich.console import Console
    from rich.table import Table

    from app.cli.progress import bar
    from app.evaluate import preprocessing as worth
    from app.evaluate.digital_hands import MEASURE_SEEDS
    from app.evaluate.gesture_photos import read_labels
    from app.evaluate.gesture_report import write_json
    from hal.cameras.hand_poses import POSES
    from kgdfa.keypoints import HandDetector
    from kgdfa.preprocess import PREPARATIONS

    console = Console()
    photos = read_labels(directory)[::every] if directory is not None else []
    pictures = worth.photo_pictures(photos, directory) if directory else worth.digital_pictures(digital, MEASURE_SEEDS)
    total = len(photos) if directory else digital * len(POSES)
    with bar(console, "preparing and judging", total) as tell, HandDetector(_model(home), still=True) as detector:
        found = worth.measure_worth(pictures, detector, tell)
    costs_ms = {name: worth.cost_ms(prepare) for name, prepare in PREPARATIONS.items()}
    table = Table(title=f"{found[0].pictures} pictures, one look at each; cost at 1280×720")
    for head in ("pictures", "prepared", "hand found", "gestures right", "undefined accepted", "ms"):
        table.add_column(head, justify="left" if head in ("pictures", "prepared") else "right")
    for one in found:
        shares = (f"{100 * share:.1f}%" for share in (one.found, one.right, one.accepted_undefined))
        table.add_row(one.spoilt, one.prepared, *shares, f"{costs_ms[one.prepared]:.1f}")
    console.print(table)
    if json_file is not None:
        write_json({"worth": msgspec.to_builtins(found), "cost_ms": costs_ms}, json_file)


@cli.command()
def speed(
    directory: Annotated[
        Path | None, typer.Argument(help="Folder with frames.csv; without it, the digital hand.")
    ] = None,
    frames: Annotated[int, typer.Option(help="How many frames at most.", min=30)] = 300,
    json_file: Json = None,
    home: Home = None,
) -> None:
    """Table 4's row: the whole chain's speed beside bare MediaPipe's on the same frames."""
    import msgspec
    from rich.console import Console
    from rich.table import Table

    from app.cli.progress import bar
    from app.evaluate.gesture_report import write_json
    from app.evaluate.speed import WARM_UP, measure_speed

    console = Console()
    images, focal_px = _frames_for_speed(directory, frames)
    with bar(console, "timing", len(images) + min(WARM_UP, len(images))) as tell:
        figures = measure_speed(images, _model(home), focal_px=focal_px, tell=tell)
    table = Table(title=f"{figures.frames} frames of {images[0].shape[1]}×{images[0].shape[0]}, ms a frame")
    table.add_column("stage")
    table.add_column("ms", justify="right")
    for stage, spent_ms in figures.stages_ms.items():
        table.add_row(stage, f"{spent_ms:.2f}")
    table.add_section()
    table.add_row("bare MediaPipe", f"{figures.bare_ms:.2f}")
    table.add_row("whole chain", f"{figures.whole_ms:.2f}")
    console.print(table)
    console.print(
        f"whole chain / bare MediaPipe {figures.ratio:.3f}, {figures.fps:.0f} frames a second, "
        f"a hand in {figures.hands} of {figures.frames} (paper, its own laptop: 34 frames a second)"
    )
    if json_file is not None:
        write_json(msgspec.to_builtins(figures), json_file)


def _frames_for_speed(directory: Path | None, count: int) -> tuple[list[Image], float]:
    """Pictures and focal length: of a recording, or of the digital hand showing one gesture after the other."""
    from app.evaluate.sequence import PERIOD_NS, pictures, read_frames

    if directory is not None:
        listed = read_frames(directory)[:count]
        return list(pictures(listed)), listed[0].focal_px
    from hal.cameras.digital_hand import DigitalHandCamera
    from hal.cameras.hand_poses import GESTURES

    camera = DigitalHandCamera(clock_ns=lambda: 0)
    images = []
    for number in range(count):
        if number % 25 == 0:
            camera.command(gesture=GESTURES[number // 25 % len(GESTURES)].name, at_ns=number * PERIOD_NS)
        images.append(camera.render((number + 1) * PERIOD_NS).image_bgr)
    return images, camera.lens.fx_px
