"""rleex evaluate: gestures, joints, enrolment, finding, video, preprocessing, side."""

from __future__ import annotations

from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
import typer

from app.cli.common import (
    MAX_SEED,
    HomeOption,
    Json,
    check_figure,
    check_output_folder,
    check_replaced,
    refuse_options,
    show,
    shown_after,
)
from app.cli.evaluate.common import (
    Directory,
    Keypoints,
    check_keypoints,
    hand_model,
    open_detector,
    progress,
    status_line,
    unreadable_lines,
)
from app.evaluate.harness import EvaluateFault, percent, require_extra, write_json
from app.evaluate.readings import UNPREPARED, DetectedImage, LabelledImage, read_footage, read_labels
from app.system.errors import AppError
from app.text.catalogue import tr
from hal.cameras.digital_hand.skeleton import POSES
from kgdfa.gesture import RuleSet
from kgdfa.preprocess import Image, Prepare, as_bgr8, find_preparation
from kgdfa.published import PublishedRules
from kgdfa.robust import RobustRules

if TYPE_CHECKING:
    from collections.abc import Generator, Iterator

    from app.evaluate.digital import LabelledScene
    from app.evaluate.gestures.joint_space import Errors
    from app.evaluate.gestures.measures import Classified
    from kgdfa.pipeline import Report
    from logs.reason import Reason


cli = typer.Typer()

MOST_SEED = 1000  # of `joints`: more would draw people that fits know
FIT_DIGITAL = 40  # digital hands a pose that a fit gets beside the images
EVERY, PER_POSE, PEOPLE = 12, 5, 6  # images that `preprocessing` takes, its digital hands, and the people of `side`


@cli.command()
def gestures(
    directory: Directory = None,
    json_file: Json = None,
    errors: Annotated[
        Path | None, typer.Option(callback=check_output_folder, help="Write the misclassified images here, drawn upon.")
    ] = None,
    png: Annotated[
        Path | None, typer.Option(callback=check_figure, help="Write the confusion matrices here as a PNG.")
    ] = None,
    cross_validate: Annotated[
        bool,
        typer.Option(
            "--cross-validate", help="Fit anew for each source of images left out, then for kinds of undefined hands."
        ),
    ] = False,
    seed: Annotated[
        int, typer.Option(help="With --cross-validate: which examples and noise are drawn.", min=0, max=MAX_SEED)
    ] = 0,
    keypoints: Keypoints = None,
    keep: Annotated[
        Path | None,
        typer.Option(
            callback=check_output_folder,
            help="With --cross-validate: keep each fit in this folder, and use those that are there.",
        ),
    ] = None,
    beside: Annotated[
        Path | None,
        typer.Option(
            "--with",
            help="With --cross-validate: fit on this folder's images as well, always. "
            "Keypoints are taken from its keypoints.npz, or --with-keypoints.",
        ),
    ] = None,
    beside_keypoints: Annotated[
        Path | None,
        typer.Option(
            "--with-keypoints",
            callback=check_keypoints,
            help="Keep the keypoints of --with in this npz, and use it when it is there.",
        ),
    ] = None,
    digital: Annotated[
        int, typer.Option(help="Measure on this many digital hands a pose instead of a folder.", min=0)
    ] = 0,
    single_look: Annotated[
        bool, typer.Option("--single-look", help="Classify one view of an image, as in video.")
    ] = False,
    prepare: Annotated[
        str,
        typer.Option(help="Preprocessing: none, denoise, sharpen, denoise+sharpen, brighten, lighten or 'as needed'."),
    ] = UNPREPARED,
    home: HomeOption = None,
) -> None:
    """Table 3: how well both rule sets recognise gestures, and refuse what is none."""
    from app.evaluate.digital import MEASURE_SEEDS, digital_scenes
    from app.evaluate.gestures import images, report
    from app.evaluate.gestures.cross_validation import KINDS_LEFT_OUT
    from app.evaluate.gestures.measures import measure

    require_extra("evaluate", "sklearn")
    if (directory is None) == (not digital):
        raise AppError(EvaluateFault.FOLDER_OR_DIGITAL)
    if digital:  # there is no file to draw upon, and no source to leave out
        unused = {"--cross-validate": cross_validate, "--errors": errors, "--keypoints": keypoints}
        refuse_options("evaluate gestures --digital", unused)
    if (beside or beside_keypoints or keep or seed) and not cross_validate:
        raise AppError(EvaluateFault.WITH_ALONE)
    views = 1 if single_look else None
    if directory is None:
        detected = detected_scenes([*digital_scenes(digital, MEASURE_SEEDS)], home, find_preparation(prepare))
    else:
        detected = detected_images(directory, keypoints, home, prepare)
    if cross_validate:
        fitted = fitted_beside(beside, beside_keypoints, home) if beside else []
        fitted += fitted_digital(home, beside_keypoints, keypoints)
        classified = _cross_validated(detected, fitted, seed, views, keep)
    else:
        classified = images.classify_as_shipped(detected, views=views)
    kinds = classified.pop(KINDS_LEFT_OUT, None)
    figures = {name: measure(some) for name, some in classified.items()}
    corrected = report.corrected_figures(classified)
    kinds_left_out = measure(kinds) if kinds else None
    unreadable = [(one.image.path, one.error) for one in detected if one.error]
    parts = [part for name, one in figures.items() for part in report.shown(name, one, len(detected))]
    parts += report.corrected_shown(corrected, classified)
    parts += report.kinds_shown(kinds_left_out) if kinds_left_out else ()
    parts.append(tr("evaluate.gestures.cross_validated" if cross_validate else "evaluate.gestures.shipped"))
    parts.append(tr("evaluate.gestures.one_view" if single_look or digital else "evaluate.gestures.all_views"))
    parts += unreadable_lines(dict(unreadable), "gestures.unreadable", len(unreadable))
    made = report.as_json(figures, corrected, detected, cross_validated=cross_validate, views=views, prepare=prepare)
    with shown_after(parts):
        write_json(made | report.kinds_json(kinds_left_out), json_file)
        if png is not None:
            report.plot_confusion(figures, png)
        if errors is not None and directory is not None:
            count = report.write_errors(classified["robust"], detected, directory, errors)
            parts.append(tr("evaluate.gestures.errors", count=count, folder=errors))


def _cross_validated(
    detected: list[DetectedImage], fitted_on: list[DetectedImage], seed: int, views: int | None, keep: Path | None
) -> dict[str, list[Classified]]:
    from app.evaluate.gestures.cross_validation import classify_cross_validated

    with status_line() as status:
        return classify_cross_validated(
            detected,
            fitted_on,
            lambda source: status(tr("evaluate.progress.fold", source=source)),
            views=views,
            seed=seed,
            keep=keep,
        )


@cli.command()
def joints(
    hands: Annotated[int, typer.Option(help="Hands drawn from the whole space of joint angles.", min=100)] = 10_000,
    people: Annotated[int, typer.Option(help="Rendered people from whom MediaPipe's errors are taken.", min=1)] = 8,
    seed: Annotated[int, typer.Option(help="Which people, hands and errors are drawn.", min=0, max=MOST_SEED)] = 0,
    json_file: Json = None,
    home: HomeOption = None,
) -> None:
    """What the robust rules accept in joint angles: on hands drawn at random, and joint by joint of every gesture.

    The keypoints are simulated: the digital hand's own, with errors that MediaPipe made on rendered hands like it.
    """
    from app.evaluate.gestures import joint_ranges

    rules, errors = RobustRules(), _errors_of(people, seed * people, home)
    with progress("simulating", hands + joint_ranges.STEPS) as step:
        figures = joint_ranges.measure_joint_space(rules, errors, hands, step, seed=seed)
        ranges = joint_ranges.joint_ranges(rules, errors, step)
    with shown_after([joint_ranges.joint_space_table(figures), joint_ranges.joint_range_table(ranges)]):
        write_json({"space": msgspec.to_builtins(figures), "ranges": msgspec.to_builtins(ranges)}, json_file)


@cli.command()
def enrolment(
    people: Annotated[int, typer.Option(help="Digital patients of each kind.", min=1)] = 10,
    rendered: Annotated[int, typer.Option(help="Rendered people from whom MediaPipe's errors are taken.", min=1)] = 1,
    seed: Annotated[int, typer.Option(help="Which showings and errors are drawn.", min=0, max=MAX_SEED)] = 0,
    json_file: Json = None,
    home: HomeOption = None,
) -> None:
    """Which vocabulary the guided enrolment finds for digital patients who can't extend, spread or hold still.

    The keypoints are simulated as in `joints`. Each patient then shows every gesture and an idle hand once more.
    """
    from app.evaluate.gestures import enrolment as patients
    from hal.cameras.digital_hand.movement import HandLimit

    errors = _errors_of(rendered, 0, home)
    with progress("simulating", people * len(HandLimit)) as step:
        found = patients.measure_enrolment(RobustRules(), errors, people, seed, step)
    with shown_after([patients.enrolment_table(found)]):
        write_json([msgspec.to_builtins(one) for one in found], json_file)


def _errors_of(people: int, first: int, home: Path | None) -> Errors:
    """What MediaPipe is off by on so many rendered people, from this one on."""
    from app.evaluate.digital import MEASURE_SEEDS
    from app.evaluate.gestures.joint_space import errors_of
    from app.evaluate.gestures.synthetic import near_scenes

    scenes = [*near_scenes(people, MEASURE_SEEDS + first)]
    return errors_of((scene for _, scene, _ in scenes), detected_scenes(scenes, home))


@cli.command()
def finding(
    directory: Annotated[
        Path | None, typer.Argument(help="Folder with labels.csv, for its images without a hand.")
    ] = None,
    digital: Annotated[int, typer.Option(help="Digital hands a pose, and empty rooms.", min=1)] = 10,
    first_seed: Annotated[int, typer.Option(help="Number of the first digital person.", min=0, max=MAX_SEED)] = 20_000,
    home: HomeOption = None,
) -> None:
    """What re-detection of a hand wins that the plain image misses, and what it costs."""
    from app.evaluate.gestures import redetection
    from kgdfa.keypoints import HandDetector

    total, rooms = digital * len(POSES), redetection.empty_rooms(digital, first_seed)
    unreadable: dict[str, Reason] = {}
    listed = [] if directory is None else read_labels(directory)

    def empty() -> Iterator[Image]:
        return chain(rooms, redetection.images_without_hand(listed, directory or Path(), unreadable))

    with progress("detecting", total) as step, HandDetector(hand_model(home), still=True) as detector:
        missed = redetection.missed_hands(detector, digital, first_seed, step)
        measured = redetection.measure_redetection(detector, missed, empty())
        near = redetection.near_hands(digital, first_seed)
        measured_near = redetection.measure_near(detector, near, empty())
    show(
        redetection.redetection_table("redetection", measured, total=total, missed=len(missed)),
        redetection.redetection_table("redetection.near", measured_near, total=len(near)),
        *unreadable_lines(unreadable),
    )


@cli.command()
def video(
    where: Annotated[Path, typer.Argument(help="Folder with frames.csv, or a video file.")],
    labels: Annotated[
        Path | None, typer.Option(help="A video's labels, as lines of frame,label; else the .csv beside it.")
    ] = None,
    json_file: Json = None,
    home: HomeOption = None,
) -> None:
    """How steadily both rule sets recognise gestures in labelled footage."""
    from app.evaluate.gestures.measures import measure_sequence, run_sequence, verdicts_and_votes
    from app.evaluate.gestures.report import sequence_shown

    footage, figures = read_footage(where, labels), {}
    reports: list[Report | None] = []
    rule_sets: tuple[RuleSet, ...] = (PublishedRules(), RobustRules())
    for rules in rule_sets:
        with progress("rules", len(footage.labels), rules=rules.name) as step:
            reports = run_sequence(footage, hand_model(home), rules, step)
        figures[rules.name] = measure_sequence(footage.labels, *verdicts_and_votes(reports), footage.period_ns)
    unreadable = [path for path, report in zip(footage.paths, reports, strict=False) if report is None]
    counts = {"frames": len(footage.labels), "claimed_frames": footage.claimed_frames}
    with shown_after(sequence_shown(where, figures, unreadable, footage.claimed_frames)):
        made = {**counts, "unreadable": [*map(str, unreadable)], "rules": msgspec.to_builtins(figures)}
        write_json(made, json_file)


@cli.command()
def preprocessing(
    directory: Annotated[Path | None, typer.Argument(help="Folder with labels.csv; without it, digital hands.")] = None,
    every: Annotated[int, typer.Option(help="Take every n-th image.", min=1)] = EVERY,
    digital: Annotated[int, typer.Option(help="How many digital hands a pose, without a folder.", min=1)] = PER_POSE,
    json_file: Json = None,
    home: HomeOption = None,
) -> None:
    """What denoising, sharpening and brightening are worth on dark, grainy and blurred images."""
    from app.evaluate.digital import MEASURE_SEEDS
    from app.evaluate.gestures import ablation
    from kgdfa.keypoints import HandDetector

    unreadable: dict[str, Reason] = {}
    if directory is None:
        refuse_options("evaluate preprocessing --digital", {"--every": every != EVERY})
        read, total = ablation.digital_images(digital, MEASURE_SEEDS), digital * len(POSES)
    else:
        refuse_options("evaluate preprocessing DIR", {"--digital": digital != PER_POSE})
        listed = read_labels(directory)[::every]
        read, total = ablation.photos(listed, directory, unreadable), len(listed)
    with progress("preparing", total) as step, HandDetector(hand_model(home), still=True) as detector:
        measured = ablation.measure_preparations(read, detector, step)
    costs_ms = ablation.preparation_costs()
    with shown_after([ablation.preparation_table(measured, costs_ms), *unreadable_lines(unreadable)]):
        write_json({"worth": measured, "cost_ms": costs_ms, "unreadable": unreadable}, json_file)


@cli.command()
def side(
    directory: Directory = None,
    every: Annotated[int, typer.Option(help="Take every n-th image.", min=1)] = 1,
    digital: Annotated[
        int, typer.Option(help="Digital people, each with every gesture, without a folder.", min=1)
    ] = PEOPLE,
    keypoints: Keypoints = None,
    json_file: Json = None,
    home: HomeOption = None,
) -> None:
    """How surely the side of a hand is told: on photos beside their mirror images, or on digital hands."""
    from app.evaluate.gestures import side as sides

    if directory is None:
        refuse_options("evaluate side --digital", {"--keypoints": keypoints, "--every": every != 1})
    else:
        refuse_options("evaluate side DIR", {"--digital": digital != PEOPLE})
    if directory is not None and keypoints is not None:
        refuse_options("evaluate side --keypoints", {"--every": every != 1})
        figures = sides.measure_looks(detected_images(directory, keypoints, home))
    elif directory is not None:
        images = [one for one in read_labels(directory) if one.gesture is not None][::every]
        with open_detector(home) as detector, progress("detecting", len(images)) as step:
            figures = sides.measure_photos(detector, images, directory, step)
    else:
        with (
            open_detector(home) as detector,
            progress("detecting", len([*sides.digital_hands(digital)])) as step,
        ):
            figures = sides.measure_digital(detector, digital, step)
    counts = {"frames": figures.frames.total(), "images": figures.images, "without": figures.without}
    summary = tr("evaluate.side.summary", right=percent(figures.right, 2), **counts)
    lines = [summary, *sides.arms_summary(figures), *unreadable_lines(figures.unreadable)]
    with shown_after([sides.side_table(figures), sides.sources_table(figures), *lines]):
        write_json({"right": figures.right, **msgspec.to_builtins(figures)}, json_file)
    if figures.interrupted:
        raise typer.Exit(130)


def detected_images(
    directory: Path, keypoints: Path | None, home: Path | None, prepare: str = UNPREPARED
) -> list[DetectedImage]:
    """The hands in a folder's images: those that the keypoint file does not hold as they are now are detected.

    An interrupted detection keeps what it has, and the next one completes it. prepare: of PREPARATIONS. Raises AppError
    where no image can be read.
    """
    from app.evaluate.gestures.images import load_hands, save_hands, to_detect, unseen_image

    preparation, images = find_preparation(prepare), read_labels(directory)
    kept = load_hands(keypoints, images, prepare) if keypoints is not None and keypoints.exists() else None
    detected = [*map(unseen_image, images)] if kept is None else kept
    numbers = to_detect(detected, directory)
    if keypoints is not None and any(not (detected[k].error and detected[k].contents) for k in numbers):
        check_replaced(keypoints)  # before the work; what could not be read then will probably leave the file as it is
    found, changed = _found([images[k] for k in numbers], directory, home, preparation), 0
    try:
        for number, one in zip(numbers, found, strict=True):
            before, detected[number] = detected[number], one
            changed += (one.error, one.contents) != (before.error, before.contents)
    except KeyboardInterrupt:
        found.close()  # what is under way ends, the others are not begun
        if keypoints is not None and changed:
            save_hands(detected, keypoints, prepare)
            show(tr("evaluate.keypoints.kept", file=keypoints, done=changed, total=len(numbers)))
        raise
    if all(one.error for one in detected):
        raise AppError(EvaluateFault.IMAGE_UNREADABLE, file=images[0].path)
    if keypoints is not None and (changed or kept is None):
        save_hands(detected, keypoints, prepare)
    return detected


def _found(
    images: list[LabelledImage], directory: Path, home: Path | None, preparation: Prepare
) -> Generator[DetectedImage, None, None]:
    """The hands in these images, with a bar; without images no model is needed."""
    from app.evaluate.gestures.images import detect_images

    if images:
        with progress("detecting", len(images)) as step:
            for one in detect_images(images, directory, hand_model(home), preparation):
                yield one
                step()


def fitted_beside(directory: Path, keypoints: Path | None, home: Path | None) -> list[DetectedImage]:
    """The hands of a further folder, whose keypoints may lie in it."""
    own = directory / "keypoints.npz"
    return detected_images(directory, own if keypoints is None and own.exists() else keypoints, home)


def fitted_digital(home: Path | None, *keypoints: Path | None) -> list[DetectedImage]:
    """The digital hands that every fit gets, kept beside the first of these keypoint files that has them, or could."""
    from app.evaluate.digital import FIT_SEEDS, digital_scenes
    from app.evaluate.gestures.images import load_hands, save_hands
    from app.evaluate.gestures.synthetic import near_scenes

    scenes = [*digital_scenes(FIT_DIGITAL, FIT_SEEDS), *near_scenes()]
    files = [file.with_stem(file.stem + "-digital") for file in keypoints if file]
    file = next((file for file in files if file.exists()), files[0] if files else None)
    if file is not None and file.exists():
        return load_hands(file, [labelled for labelled, _, _ in scenes])
    detected = detected_scenes(scenes, home)
    if file is not None:
        save_hands(detected, file)
    return detected


def detected_scenes(scenes: list[LabelledScene], home: Path | None, prepare: Prepare = as_bgr8) -> list[DetectedImage]:
    from app.evaluate.digital import detect_digital

    with progress("digital", len(scenes)) as step:
        return detect_digital(hand_model(home), scenes, step, prepare)
