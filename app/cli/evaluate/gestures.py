"""rleex evaluate: gestures, joints, enrolment."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
import typer

from app.cli.common import MAX_SEED, HomeOption, Json, check_figure, check_output_folder, refuse_options, shown_after
from app.cli.evaluate.common import Directory, Keypoints, check_keypoints, progress, status_line, unreadable_lines
from app.cli.evaluate.keypoints import detected_images, detected_scenes, fitted_beside, fitted_digital
from app.evaluate.harness import EvaluateFault, require_extra, write_json
from app.evaluate.readings import UNPREPARED, DetectedImage
from app.system.errors import AppError
from app.text.catalogue import tr
from kgdfa.preprocess import find_preparation
from kgdfa.robust import RobustRules

if TYPE_CHECKING:
    from app.evaluate.gestures.joint_space import Errors
    from app.evaluate.gestures.measures import Classified

cli = typer.Typer()

MOST_SEED = 1000  # of `joints`: more would draw people that fits know


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
