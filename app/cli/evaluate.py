"""rleex evaluate: measures what the documents claim. The evaluations are in `app/evaluate`, loaded when they run."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from app.cli.common import MAX_SEED, check_finite, check_output, check_output_folder

if TYPE_CHECKING:
    from concurrent.futures import ProcessPoolExecutor

    from rich.table import Table

    from app.evaluate.digital import LabelledScene
    from app.evaluate.readings import DetectedImage
    from kgdfa.keypoints import HandDetector
    from kgdfa.preprocess import Prepare

cli = typer.Typer(no_args_is_help=True)

FIT_DIGITAL = 40  # digital hands a pose that a fit gets beside the images

Json = Annotated[Path | None, typer.Option("--json", callback=check_output, help="Write the figures here as well.")]
Plot = Annotated[Path | None, typer.Option("--plot", callback=check_output, help="Write a plot of it (PNG) here.")]
HomeFolder = Annotated[Path | None, typer.Option("--home", help="Data directory.")]
Workers = Annotated[int, typer.Option(help="Processes that detect hands at the same time.", min=1, max=64)]
Focal = Annotated[
    float,
    typer.Option(callback=check_finite, help="Focal length of the digital camera, px at 1280×720.", min=200, max=3000),
]
Seeds = Annotated[str, typer.Option(help="Digital hands: seeds and ranges of seeds, separated by commas.")]
Click = Annotated[str, typer.Option(help="Seconds to press and withdraw: 0.3, or a range, 0.3-0.8.")]


@cli.command()
def gestures(
    directory: Annotated[Path | None, typer.Argument(help="Folder with labels.csv and images.")] = None,
    json_file: Json = None,
    errors: Annotated[
        Path | None, typer.Option(callback=check_output_folder, help="Write the misclassified images here, drawn upon.")
    ] = None,
    png: Annotated[
        Path | None, typer.Option(callback=check_output, help="Write the confusion matrices here as a PNG.")
    ] = None,
    cross_validate: Annotated[
        bool, typer.Option("--cross-validate", help="Fit anew for each source of images left out.")
    ] = False,
    seed: Annotated[
        int, typer.Option(help="With --cross-validate: which examples and noise are drawn.", min=0, max=MAX_SEED)
    ] = 0,
    keypoints: Annotated[
        Path | None,
        typer.Option(callback=check_output, help="Keep the keypoints in this npz, and use it when it is there."),
    ] = None,
    digital: Annotated[
        int, typer.Option(help="Measure on this many digital hands a pose instead of a folder.", min=0)
    ] = 0,
    single_look: Annotated[
        bool, typer.Option("--single-look", help="Classify one view of an image, as in video.")
    ] = False,
    prepare: Annotated[str, typer.Option(help="Preprocessing: none, denoise, sharpen or denoise+sharpen.")] = "none",
    home: HomeFolder = None,
) -> None:
    """Table 3: how well both rule sets recognise gestures, and refuse what is none."""
    from app.evaluate.gestures import images, report
    from app.evaluate.gestures.measures import measure
    from app.evaluate.harness import EvaluateFault, require_extra, write_json
    from app.system.errors import AppError
    from app.text.catalogue import render, tr
    from kgdfa.preprocess import find_preparation

    require_extra("evaluate", "sklearn")
    if (directory is None) == (not digital):
        raise AppError(EvaluateFault.FOLDER_OR_DIGITAL)
    step, views = find_preparation(prepare), 1 if single_look else None
    if directory is None:
        detected = measured_digital(digital, home, step)
    else:
        detected = detected_images(directory, keypoints, home, step)
    if cross_validate:
        fitted_on = fitted_digital(keypoints, home)
        with _status() as show:
            classified = images.classify_cross_validated(
                detected,
                fitted_on,
                lambda source: show(tr("evaluate.progress.fold", source=source)),
                views=views,
                seed=seed,
            )
    else:
        classified = images.classify_as_shipped(detected, views=views)
    figures = {name: measure(some) for name, some in classified.items()}
    for name, one in figures.items():
        _show(*report.shown(name, one, len(detected)))
    _show(
        tr("evaluate.gestures.cross_validated" if cross_validate else "evaluate.gestures.shipped"),
        tr("evaluate.gestures.one_view" if single_look or digital else "evaluate.gestures.all_views"),
    )
    unreadable = [one for one in detected if one.error]
    if unreadable:
        _show(tr("evaluate.gestures.unreadable", count=len(unreadable)))
        _show(*(f"  {one.image.path}: {render(one.error)}" for one in unreadable if one.error))
    write_json(report.as_json(figures, detected, cross_validated=cross_validate, views=views), json_file)
    if png is not None:
        report.plot_confusion(figures, png)
    if errors is not None and directory is not None:
        count = report.write_errors(classified["robust"], detected, directory, errors)
        _show(tr("evaluate.gestures.errors", count=count, folder=errors))


@cli.command()
def joints(
    hands: Annotated[int, typer.Option(help="Hands drawn from the whole space of joint angles.", min=100)] = 10_000,
    people: Annotated[int, typer.Option(help="Rendered people from whom MediaPipe's errors are taken.", min=1)] = 8,
    json_file: Json = None,
    home: HomeFolder = None,
) -> None:
    """What the robust rules accept in joint angles: on hands drawn at random, and joint by joint of every gesture.

    The keypoints are simulated: the digital hand's own, with errors that MediaPipe made on rendered hands like it.
    """
    import msgspec

    from app.evaluate.digital import MEASURE_SEEDS
    from app.evaluate.gestures import joint_ranges, joint_space
    from app.evaluate.gestures.synthetic import near_scenes
    from app.evaluate.harness import write_json
    from kgdfa.preprocess import as_bgr8
    from kgdfa.robust import RobustRules

    scenes, rules = [*near_scenes(people, MEASURE_SEEDS)], RobustRules()
    errors = joint_space.errors_of((scene for _, scene, _ in scenes), _detected_scenes(scenes, home, as_bgr8))
    with _bar("simulating", hands + joint_ranges.STEPS) as step:
        figures = joint_ranges.measure_joint_space(rules, errors, hands, step)
        ranges = joint_ranges.joint_ranges(rules, errors, step)
    _show(joint_ranges.joint_space_table(figures), joint_ranges.joint_range_table(ranges))
    write_json({"space": msgspec.to_builtins(figures), "ranges": msgspec.to_builtins(ranges)}, json_file)


@cli.command()
def finding(
    directory: Annotated[
        Path | None, typer.Argument(help="Folder with labels.csv, for its images without a hand.")
    ] = None,
    digital: Annotated[int, typer.Option(help="Digital hands a pose, and empty rooms.", min=1)] = 10,
    first_seed: Annotated[int, typer.Option(help="Number of the first digital person.", min=0, max=MAX_SEED)] = 20_000,
    home: HomeFolder = None,
) -> None:
    """What re-detection of a hand wins that the plain image misses, and what it costs."""
    from app.evaluate.gestures import ablation
    from app.evaluate.readings import read_labels
    from hal.cameras.digital_hand.skeleton import POSES
    from kgdfa.keypoints import HandDetector

    total, empty = digital * len(POSES), ablation.empty_rooms(digital, first_seed)
    if directory is not None:
        empty += ablation.images_without_hand(read_labels(directory), directory)
    with _bar("detecting", total) as step, HandDetector(hand_model(home), still=True) as detector:
        missed = ablation.missed_hands(detector, digital, first_seed, step)
        measured = ablation.measure_redetection(detector, missed, empty)
    _show(ablation.redetection_table(measured, total, len(missed), len(empty)))


@cli.command()
def video(
    where: Annotated[Path, typer.Argument(help="Folder with frames.csv, or a video file.")],
    labels: Annotated[
        Path | None, typer.Option(help="A video's labels, as lines of frame,label; else the .csv beside it.")
    ] = None,
    json_file: Json = None,
    home: HomeFolder = None,
) -> None:
    """How steadily both rule sets recognise gestures in labelled footage."""
    import msgspec

    from app.evaluate.gestures.measures import measure_sequence, run_sequence, verdict_and_vote
    from app.evaluate.gestures.report import sequence_table
    from app.evaluate.harness import write_json
    from app.evaluate.readings import read_footage
    from kgdfa.gesture import RuleSet
    from kgdfa.published import PublishedRules
    from kgdfa.robust import RobustRules

    footage, figures = read_footage(where, labels), {}
    rule_sets: tuple[RuleSet, ...] = (PublishedRules(), RobustRules())
    for rules in rule_sets:
        with _bar("rules", len(footage.labels), rules=rules.name) as step:
            pairs = [verdict_and_vote(report) for report in run_sequence(footage, hand_model(home), rules, step)]
        raw, voted = ([pair[number] for pair in pairs] for number in (0, 1))
        figures[rules.name] = measure_sequence(footage.labels, raw, voted)
    _show(sequence_table(where, figures))
    write_json({"frames": len(footage.labels), "rules": msgspec.to_builtins(figures)}, json_file)


@cli.command()
def preprocessing(
    directory: Annotated[Path | None, typer.Argument(help="Folder with labels.csv; without it, digital hands.")] = None,
    every: Annotated[int, typer.Option(help="Take every n-th image.", min=1)] = 12,
    digital: Annotated[int, typer.Option(help="How many digital hands a pose, without a folder.", min=1)] = 5,
    json_file: Json = None,
    home: HomeFolder = None,
) -> None:
    """What denoising, sharpening and brightening are worth on dark, grainy and blurred images."""
    import msgspec

    from app.evaluate.digital import MEASURE_SEEDS
    from app.evaluate.gestures import ablation
    from app.evaluate.harness import write_json
    from app.evaluate.readings import read_labels
    from hal.cameras.digital_hand.skeleton import POSES
    from kgdfa.keypoints import HandDetector

    listed = read_labels(directory)[::every] if directory is not None else []
    read = ablation.read_images(listed, directory) if directory else ablation.digital_images(digital, MEASURE_SEEDS)
    total = len(listed) if directory else digital * len(POSES)
    with _bar("preparing", total) as step, HandDetector(hand_model(home), still=True) as detector:
        measured = ablation.measure_preparations(read, detector, step)
    costs_ms = ablation.preparation_costs()
    _show(ablation.preparation_table(measured, costs_ms))
    write_json({"worth": msgspec.to_builtins(measured), "cost_ms": costs_ms}, json_file)


@cli.command()
def speed(
    directory: Annotated[
        Path | None, typer.Argument(help="Folder with frames.csv; without it, the digital hand.")
    ] = None,
    frames: Annotated[int, typer.Option(help="How many frames at most.", min=30)] = 300,
    workers: Annotated[
        int | None,
        typer.Option(help="Time also 1 and N processes at once, each with a recording of its own [cores].", min=0),
    ] = None,
    json_file: Json = None,
    home: HomeFolder = None,
) -> None:
    """Table 4's row: the whole pipeline's speed beside bare MediaPipe's on the same frames."""
    import msgspec

    from app.evaluate.harness import write_json
    from app.evaluate.loop import speed as timing
    from app.text.catalogue import tr

    model = hand_model(home)
    images, focal_px = timing.frames_for_speed(directory, frames)
    with _bar("timing", len(images) + min(timing.WARM_UP, len(images))) as step:
        figures = timing.measure_speed(images, model, focal_px=focal_px, step=step)
    height, width = images[0].shape[:2]
    _show(timing.speed_table(figures, width, height), tr("evaluate.speed.summary", **msgspec.to_builtins(figures)))
    offline = []
    for count in timing.worker_counts(workers):
        with _status() as show:
            show(tr("evaluate.progress.processes", count=count))
            offline.append(timing.measure_throughput(directory, frames, model, count))
        _show(tr("evaluate.speed.offline", workers=count, fps=offline[-1].fps))
    write_json({**msgspec.to_builtins(figures), "offline": msgspec.to_builtins(offline)}, json_file)


@cli.command()
def distance(
    folder: Annotated[Path | None, typer.Argument(help="A folder with frames.csv; without it, Table 5.")] = None,
    hands: Annotated[int, typer.Option(help="Digital hands, without a folder.", min=1)] = 6,
    walks: Annotated[int, typer.Option(help="Seconds of random walk, without a folder.", min=1)] = 48,
    focal_px: Focal = 650.0,
    workers: Workers = 2,
    json_file: Json = None,
    plot: Plot = None,
    home: HomeFolder = None,
) -> None:
    """Distance against the truth: on labelled frames, or Table 5 on the digital hand."""
    from app.evaluate.harness import write_json

    if folder is not None:
        _distance_on_frames(folder, json_file, plot, home)
        return
    from app.evaluate.distance.table5 import evaluate_table_5, plot_table_5, steps, tables

    with _pool(home, workers, steps(hands, walks)) as (pool, step):
        result = evaluate_table_5(pool, hands=hands, walks=walks, focal_px=focal_px, step=step)
    _show(*tables(result))
    write_json(result.as_json(), json_file)
    if plot is not None:
        plot_table_5(result, plot)


@cli.command()
def trigger(
    changes: Annotated[int, typer.Option(help="Posture changes at each distance.", min=4)] = 20,
    rates: Annotated[bool, typer.Option(help="Measure each camera's frame rate too; needs a quiet machine.")] = True,
    focal_px: Focal = 650.0,
    workers: Workers = 2,
    json_file: Json = None,
    plot: Plot = None,
    home: HomeFolder = None,
) -> None:
    """Table 6: how often posture changes press the button, both cameras, both modes; and each camera's frame rate."""
    from app.evaluate.harness import write_json
    from app.evaluate.trigger import table6

    measured: table6.CameraRates = {}
    if rates:
        with _detector(home) as detector, _bar("timing", len(table6.DISTANCES_CM)) as step:
            measured = table6.measure_rates(detector, focal_px=focal_px, step=step)
    with _pool(home, workers, table6.steps(changes)) as (pool, step):
        rows = table6.evaluate_trigger(pool, changes=changes, focal_px=focal_px, rates=measured, step=step)
    _show(table6.table_6(rows))
    write_json({"changes": changes, "focal_px": focal_px, "table_6": [row.as_json() for row in rows]}, json_file)
    if plot is not None:
        table6.plot_table_6(rows, plot)


@cli.command()
def idle(
    frames: Annotated[int, typer.Option(help="Frames to simulate.", min=100)] = 100_000,
    holes: Annotated[
        float | None,
        typer.Option(
            callback=check_finite, help="Command by depth too; its share of frames that miss the hand.", min=0, max=1
        ),
    ] = None,
    threshold_cm: Annotated[
        float, typer.Option("--threshold", callback=check_finite, help="Nearer is pressed, cm.", min=10, max=40)
    ] = 20.0,
    seed: Annotated[int, typer.Option(help="Another seed, other hands and movements.", min=0, max=MAX_SEED)] = 1,
    progress: Annotated[
        Path | None, typer.Option(callback=check_output, help="Keep the progress here, and go on from it.")
    ] = None,
    json_file: Json = None,
    home: HomeFolder = None,
) -> None:
    """Hands that move, turn, wave and pass by without pressing: no command may come of it.

    The keypoints are simulated: the digital hand's own, with noise taken from MediaPipe on rendered frames.
    """
    import msgspec

    from app.evaluate.harness import write_json
    from app.evaluate.trigger import idle as idling
    from app.evaluate.trigger.idle import NOISE_FRAMES, NOISE_WALKS, evaluate_idle, idle_table, take_noise

    settings = idling.IdleSettings(seed=seed, threshold_m=threshold_cm / 100, holes=holes)
    before = idling.kept_progress(progress, settings)
    with _detector(home) as detector, _bar("detecting", NOISE_WALKS * NOISE_FRAMES) as step:
        clips = take_noise(detector, step)
    with _bar("simulating", max(0, frames - before.frames)) as step:
        result = evaluate_idle(clips, before, frames=frames, step=step, keep=progress)
    _show(idle_table(result))
    write_json(msgspec.to_builtins(result), json_file)
    if not result.passed:
        raise typer.Exit(1)


@cli.command()
def side(
    directory: Annotated[Path | None, typer.Argument(help="Folder with labels.csv and images.")] = None,
    every: Annotated[int, typer.Option(help="Take every n-th image.", min=1)] = 1,
    digital: Annotated[int, typer.Option(help="Digital people, each with every gesture, without a folder.", min=1)] = 6,
    keypoints: Annotated[
        Path | None,
        typer.Option(callback=check_output, help="Keep the keypoints in this npz, and use it when it is there."),
    ] = None,
    json_file: Json = None,
    home: HomeFolder = None,
) -> None:
    """How surely the side of a hand is told: on photos beside their mirror images, or on digital hands."""
    import msgspec

    from app.evaluate.gestures import side as sides
    from app.evaluate.harness import percent, write_json
    from app.evaluate.readings import read_labels
    from app.text.catalogue import tr

    if directory is not None and keypoints is not None:
        figures = sides.measure_looks(detected_images(directory, keypoints, home))
    elif directory is not None:
        images = [one for one in read_labels(directory) if one.gesture is not None][::every]
        with _detector(home) as detector, _bar("detecting", len(images)) as step:
            figures = sides.measure_photos(detector, images, directory, step)
    else:
        with _detector(home) as detector, _bar("detecting", len([*sides.digital_hands(digital)])) as step:
            figures = sides.measure_digital(detector, digital, step)
    write_json({"right": figures.right, **msgspec.to_builtins(figures)}, json_file)
    total = figures.frames.total()
    right = percent(figures.right, 2) if total else "–"
    summary = tr("evaluate.side.summary", right=right, frames=total, images=figures.images, without=figures.without)
    _show(sides.side_table(figures), sides.sources_table(figures), summary)
    if figures.interrupted:
        raise typer.Exit(130)


@cli.command()
def foreign(
    frames: Annotated[int, typer.Option(help="Frames with a foreign hand.", min=0)] = 10_000,
    attempts: Annotated[
        int, typer.Option("--trials", help="Pushes of the enrolled hand, alone and beside a foreign one.", min=0)
    ] = 24,
    seed: Annotated[int, typer.Option(help="Another seed, other hands and movements.", min=0, max=MAX_SEED)] = 1,
    json_file: Json = None,
    home: HomeFolder = None,
) -> None:
    """A second person's hand that signs and pushes: no command may come of it, none of the enrolled hand's be lost."""
    import msgspec

    from app.evaluate.harness import write_json
    from app.evaluate.trigger.foreign import costs_table, evaluate_foreign, foreign_table, measure_costs, steps, summary
    from app.text.catalogue import tr

    with _detector(home) as detector, _bar("simulating", steps(frames, attempts)) as step:
        result = evaluate_foreign(detector, frames=frames, pushes=attempts, seed=seed, step=step)
    costs = measure_costs(hand_model(home))
    write_json({**msgspec.to_builtins(result), "cpu_ms": costs}, json_file)
    _show(foreign_table(result), summary(result), costs_table(costs))
    if result.interrupted:
        _show(tr("evaluate.foreign.interrupted"))
    if result.interrupted or result.commands:
        raise typer.Exit(130 if result.interrupted else 1)


@cli.command("press-zone")
def press_zone(
    hands: Annotated[int, typer.Option(help="Digital hands a gesture.", min=1)] = 3,
    workers: Workers = 2,
    json_file: Json = None,
    home: HomeFolder = None,
) -> None:
    """How near each gesture is tracked, with two lenses, and whether a push commands."""
    import msgspec

    from app.evaluate.harness import write_json
    from app.evaluate.trigger.press_zone import evaluate_press_zone, steps, zone_lines, zone_table

    _show(*zone_lines())
    with _pool(home, workers, steps(hands)) as (pool, step):
        rows = evaluate_press_zone(pool, hands=hands, step=step)
    _show(zone_table(rows))
    write_json({"hands": hands, "rows": msgspec.to_builtins(rows)}, json_file)


@cli.command()
def pushes(
    attempts: Annotated[
        int, typer.Option("--trials", help="Pushes of each gesture, shared among the hands.", min=1)
    ] = 12,
    seeds: Seeds = "1-6",
    click: Click = "0.3",
    workers: Workers = 2,
    json_file: Json = None,
    home: HomeFolder = None,
) -> None:
    """Quick pushes of many hands with all twelve gestures: which command, and the others frame by frame."""
    from app.evaluate.harness import click_range, seed_numbers, write_json
    from app.evaluate.trigger.pushes import bouts, evaluate_pushes, shown

    wanted = bouts(seed_numbers(seeds), attempts=attempts, click_s=click_range(click))
    with _pool(home, workers, len(wanted)) as (pool, step):
        run = evaluate_pushes(pool, wanted, step)
    write_json({"seeds": seeds, "click_s": click, **run.as_json()}, json_file)
    _show(*shown(run))
    if run.interrupted or run.unrequested:
        raise typer.Exit(130 if run.interrupted else 1)


@cli.command()
def response(
    attempts: Annotated[int, typer.Option("--trials", help="Attempts a gesture.", min=1)] = 50,
    seeds: Seeds = "1-3",
    click: Click = "0.3",
    json_file: Json = None,
    home: HomeFolder = None,
) -> None:
    """Table 7: success and response of the whole system, real processes, several hands."""
    from app.cli.progress import spinner, wide_console
    from app.demo.scenario import ALL_TWELVE
    from app.evaluate.harness import click_range, seed_numbers, write_json
    from app.evaluate.loop.response import evaluate_response, shown
    from app.system.config import load_config
    from app.system.hand_model import set_up_model
    from app.system.paths import find_home, hold_home

    place = find_home(home)
    base = load_config(place.config)
    numbers, click_s = seed_numbers(seeds), click_range(click)
    with hold_home(place), spinner(wide_console(), total=attempts * len(ALL_TWELVE)) as watch:
        set_up_model(place, base)
        result = evaluate_response(place, base, attempts=attempts, seeds=numbers, click_s=click_s, watch=watch)
    write_json(result.as_json(), json_file)
    _show(*shown(result))
    if result.interrupted or result.gave_up:
        raise typer.Exit(130 if result.interrupted else 1)


def _distance_on_frames(folder: Path, json_file: Path | None, plot: Path | None, home: Path | None) -> None:
    from app.evaluate.distance.frames import frames_table, measure_frames, plot_frames
    from app.evaluate.harness import write_json
    from app.evaluate.readings import DISTANCE_COLUMNS, read_frames
    from app.text.catalogue import tr

    frames = read_frames(folder, DISTANCE_COLUMNS)
    with _detector(home) as detector, _bar("detecting", len(frames)) as step:
        result = measure_frames(frames, detector, step)
    _show(frames_table(result), *(tr("evaluate.distance.unreadable", file=path) for path in result.unreadable))
    write_json(result.as_json(), json_file)
    if plot is not None:
        plot_frames(result, plot)


def hand_model(home: Path | None) -> Path:
    """Where the hand model is, fetched first if it must be. Raises AppError when it can't be had."""
    from app.system.config import load_config
    from app.system.hand_model import set_up_model
    from app.system.paths import find_home

    place = find_home(home)
    return set_up_model(place, load_config(place.config))


def detected_images(
    directory: Path, keypoints: Path | None, home: Path | None, prepare: Prepare | None = None
) -> list[DetectedImage]:
    """The hands in a folder's images, detected now or read from the keypoint file."""
    from app.evaluate.gestures.images import detect_images, load_hands, save_hands
    from app.evaluate.readings import read_labels
    from kgdfa.preprocess import as_bgr8

    images = read_labels(directory)
    if keypoints is not None and keypoints.exists():
        return load_hands(keypoints, images)
    with _bar("detecting", len(images)) as step:
        detected = detect_images(images, directory, hand_model(home), step, prepare or as_bgr8)
    if keypoints is not None:
        save_hands(detected, keypoints)
    return detected


def measured_digital(per_pose: int, home: Path | None, prepare: Prepare) -> list[DetectedImage]:
    """So many digital hands a pose that measure, detected and tracked as before a camera."""
    from app.evaluate.digital import MEASURE_SEEDS, digital_scenes

    return _detected_scenes([*digital_scenes(per_pose, MEASURE_SEEDS)], home, prepare)


def fitted_digital(keypoints: Path | None, home: Path | None) -> list[DetectedImage]:
    """The digital hands that every fit gets, kept beside the images' keypoints."""
    from app.evaluate.digital import FIT_SEEDS, digital_scenes
    from app.evaluate.gestures.images import load_hands, save_hands
    from app.evaluate.gestures.synthetic import near_scenes
    from kgdfa.preprocess import as_bgr8

    scenes = [*digital_scenes(FIT_DIGITAL, FIT_SEEDS), *near_scenes()]
    file = keypoints.with_stem(keypoints.stem + "-digital") if keypoints is not None else None
    if file is not None and file.exists():
        return load_hands(file, [labelled for labelled, _, _ in scenes])
    detected = _detected_scenes(scenes, home, as_bgr8)
    if file is not None:
        save_hands(detected, file)
    return detected


def _detected_scenes(scenes: list[LabelledScene], home: Path | None, prepare: Prepare) -> list[DetectedImage]:
    from app.evaluate.digital import detect_digital

    with _bar("digital", len(scenes)) as step:
        return detect_digital(hand_model(home), scenes, step, prepare)


@contextmanager
def _detector(home: Path | None) -> Iterator[HandDetector]:
    from kgdfa.keypoints import live_detector

    with live_detector(hand_model(home)) as detector:
        yield detector


@contextmanager
def _pool(home: Path | None, workers: int, total: int) -> Iterator[tuple[ProcessPoolExecutor, Callable[[], None]]]:
    """Processes with a detector each, and a bar for the pieces of work."""
    from app.evaluate.digital import detector_pool

    with detector_pool(hand_model(home), workers) as pool, _bar("simulating", total) as step:
        yield pool, step


def _bar(what: str, total: int, **values: object) -> AbstractContextManager[Callable[..., None]]:
    from app.cli.progress import bar, wide_console
    from app.text.catalogue import tr

    return bar(wide_console(), tr(f"evaluate.progress.{what}", **values), total)


@contextmanager
def _status() -> Iterator[Callable[[str], Any]]:
    """A spinner; the yielded function sets the text beside it."""
    from app.cli.progress import wide_console
    from app.text.catalogue import tr

    with wide_console().status(tr("evaluate.progress.fitting")) as status:
        yield status.update


def _show(*parts: Table | str) -> None:
    from app.cli.progress import wide_console

    console = wide_console()
    for part in parts:
        console.print(part, markup=not isinstance(part, str))
