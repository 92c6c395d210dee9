"""rleex evaluate: finding, video, preprocessing, side."""

from __future__ import annotations

from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
import typer

from app.cli.common import MAX_SEED, HomeOption, Json, refuse_options, show, shown_after
from app.cli.evaluate.common import Directory, Keypoints, hand_model, open_detector, progress, unreadable_lines
from app.cli.evaluate.keypoints import detected_images
from app.evaluate.harness import percent, write_json
from app.evaluate.readings import read_footage, read_labels
from app.text.catalogue import tr
from hal.cameras.digital_hand.skeleton import POSES
from kgdfa.gesture import RuleSet
from kgdfa.preprocess import Image
from kgdfa.published import PublishedRules
from kgdfa.robust import RobustRules

if TYPE_CHECKING:
    from collections.abc import Iterator

    from kgdfa.pipeline import Report
    from logs.reason import Reason

cli = typer.Typer()

EVERY, PER_POSE, PEOPLE = 12, 5, 6  # images that `preprocessing` takes, its digital hands, and the people of `side`


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

    listed = [] if directory is None else read_labels(directory)
    total, rooms = digital * len(POSES), redetection.empty_rooms(digital, first_seed)
    unreadable: dict[str, Reason] = {}

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
