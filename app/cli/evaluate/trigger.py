"""rleex evaluate: distance, trigger, idle, foreign, press-zone, pushes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import msgspec
import typer

from app.cli.common import (
    MAX_SEED,
    HomeOption,
    Json,
    check_appended,
    check_finite,
    refuse_options,
    shown_after,
)
from app.cli.evaluate.common import (
    Click,
    Focal,
    Plot,
    Seeds,
    Workers,
    detector_processes,
    hand_model,
    open_detector,
    progress,
)
from app.evaluate.harness import DISTANCES_CM, click_range, seed_numbers, write_json
from app.evaluate.readings import DISTANCE_COLUMNS, read_frames
from app.text.catalogue import tr
from profiles.schema import HandUsed

cli = typer.Typer()
LeftOut = Annotated[
    float,
    typer.Option(help="Share of the frames that a busy machine leaves out.", min=0, max=0.9, callback=check_finite),
]
HANDS, WALKS, FOCAL_PX, WORKERS = 6, 48, 650.0, 2  # of Table 5


@cli.command()
def distance(
    folder: Annotated[Path | None, typer.Argument(help="A folder with frames.csv; without it, Table 5.")] = None,
    hands: Annotated[int, typer.Option(help="Digital hands, without a folder.", min=1)] = HANDS,
    walks: Annotated[int, typer.Option(help="Seconds of random walk, without a folder.", min=1)] = WALKS,
    focal_px: Focal = FOCAL_PX,
    workers: Workers = WORKERS,
    json_file: Json = None,
    plot: Plot = None,
    home: HomeOption = None,
) -> None:
    """Distance against the truth: on labelled frames, or Table 5 on the digital hand."""
    if folder is not None:
        simulated = {"--hands": hands != HANDS, "--walks": walks != WALKS}
        simulated |= {"--focal-px": focal_px != FOCAL_PX, "--workers": workers != WORKERS}
        refuse_options("evaluate distance DIR", simulated)
        _distance_on_frames(folder, json_file, plot, home)
        return
    from app.evaluate.distance.table5 import evaluate_table_5, steps
    from app.evaluate.distance.table5_results import plot_table_5, tables

    with detector_processes(home, workers, steps(hands, walks)) as (pool, step):
        result = evaluate_table_5(pool, hands=hands, walks=walks, focal_px=focal_px, step=step)
    with shown_after(tables(result)):
        write_json(result.as_json(), json_file)
        if plot is not None:
            plot_table_5(result, plot)


def _distance_on_frames(folder: Path, json_file: Path | None, plot: Path | None, home: Path | None) -> None:
    from app.evaluate.distance.frames import frames_table, measure_frames, plot_frames

    frames = read_frames(folder, DISTANCE_COLUMNS)
    with open_detector(home) as detector, progress("detecting", len(frames)) as step:
        result = measure_frames(frames, detector, step)
    unreadable = (tr("evaluate.distance.unreadable", file=path) for path in result.unreadable)
    with shown_after([frames_table(result), *unreadable]):
        write_json(result.as_json(), json_file)
        if plot is not None:
            plot_frames(result, plot)


@cli.command()
def trigger(
    changes: Annotated[int, typer.Option(help="Posture changes at each distance.", min=4)] = 20,
    rates: Annotated[bool, typer.Option(help="Measure each camera's frame rate too; needs a quiet machine.")] = True,
    focal_px: Focal = 650.0,
    workers: Workers = 2,
    json_file: Json = None,
    plot: Plot = None,
    home: HomeOption = None,
) -> None:
    """Table 6: how often posture changes press the button, both cameras, both modes; and each camera's frame rate."""
    from app.evaluate.trigger import frame_rates, table6

    measured: table6.CameraRates = {}
    if rates:
        with open_detector(home) as detector, progress("timing", len(DISTANCES_CM)) as step:
            measured = frame_rates.measure_rates(detector, focal_px=focal_px, step=step)
    with detector_processes(home, workers, table6.steps(changes)) as (pool, step):
        rows = table6.evaluate_trigger(pool, changes=changes, focal_px=focal_px, rates=measured, step=step)
    with shown_after([table6.table_6(rows)]):
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
    left_out: LeftOut = 0.0,
    together: Annotated[int, typer.Option(help="Frames left out at a time.", min=1, max=90)] = 1,
    seed: Annotated[int, typer.Option(help="Another seed, other hands and movements.", min=0, max=MAX_SEED)] = 1,
    keep: Annotated[
        Path | None,
        typer.Option("--progress", callback=check_appended, help="Keep the progress here, and go on from it."),
    ] = None,
    json_file: Json = None,
    home: HomeOption = None,
) -> None:
    """Hands that move, turn, wave and pass by without pressing: no command may come of it.

    The keypoints are simulated: the digital hand's own, with noise taken from MediaPipe on rendered frames.
    """
    from app.evaluate.noise import NOISE_FRAMES, NOISE_WALKS, take_noise
    from app.evaluate.trigger import idle as idling
    from app.system.program import PROGRAM, program_identity

    program = program_identity()[PROGRAM]
    settings = idling.IdleSettings(
        seed=seed,
        threshold_m=threshold_cm / 100,
        holes=holes,
        left_out=left_out,
        together=together,
        program=program,
    )
    before = idling.kept_progress(keep, settings)
    with open_detector(home) as detector, progress("detecting", NOISE_WALKS * NOISE_FRAMES) as step:
        clips = take_noise(detector, step)
    with progress("simulating", max(0, frames - before.frames)) as step:
        result = idling.evaluate_idle(clips, before, frames=frames, step=step, keep=keep)
    with shown_after([idling.idle_table(result)]):
        write_json(msgspec.to_builtins(result), json_file)
    if not result.passed:
        raise typer.Exit(1)


@cli.command()
def foreign(
    frames: Annotated[int, typer.Option(help="Frames of the clips with a foreign hand, 105 each.", min=0)] = 10_000,
    attempts: Annotated[
        int,
        typer.Option(
            "--trials",
            help="Pushes of the enrolled hand: alone, beside a foreign one, after one crossed it.",
            min=0,
        ),
    ] = 100,
    seed: Annotated[int, typer.Option(help="Another seed, other hands and movements.", min=0, max=MAX_SEED)] = 1,
    keep: Annotated[
        Path | None,
        typer.Option(callback=check_appended, help="Keep each clip's figures in this file; go on where it ends."),
    ] = None,
    workers: Workers = 2,
    json_file: Json = None,
    home: HomeOption = None,
) -> None:
    """A second person's hand that signs and pushes: no command may come of it, none of the enrolled hand's be lost."""
    from app.evaluate.trigger import foreign as scenes
    from app.evaluate.trigger.foreign_clips import clips

    wanted = clips(frames=frames, pushes=attempts, seed=seed)
    with detector_processes(home, workers, len(wanted)) as (pool, step):
        result = scenes.evaluate_foreign(pool, wanted, step, keep)
    costs = scenes.measure_costs(hand_model(home))
    parts = [scenes.foreign_table(result), scenes.pushes_table(result), scenes.costs_table(costs)]
    with shown_after([*parts, *([tr("evaluate.foreign.interrupted")] if result.interrupted else [])]):
        write_json({**msgspec.to_builtins(result), "cpu_ms": costs}, json_file)
    if result.interrupted or result.commands:
        raise typer.Exit(130 if result.interrupted else 1)


@cli.command("press-zone")
def press_zone(
    hands: Annotated[int, typer.Option(help="Digital hands a gesture.", min=1)] = 3,
    workers: Workers = 2,
    json_file: Json = None,
    home: HomeOption = None,
) -> None:
    """How near each gesture is tracked, with two lenses, and whether a push commands."""
    from app.evaluate.trigger.press_zone import evaluate_press_zone, steps, zone_lines, zone_table

    with detector_processes(home, workers, steps(hands)) as (pool, step):
        rows = evaluate_press_zone(pool, hands=hands, step=step)
    with shown_after([*zone_lines(), zone_table(rows)]):
        write_json({"hands": hands, "rows": msgspec.to_builtins(rows)}, json_file)


@cli.command()
def pushes(
    attempts: Annotated[
        int, typer.Option("--trials", help="Pushes of each gesture, shared among the hands.", min=1)
    ] = 12,
    seeds: Seeds = "1-6",
    click: Click = "0.3",
    left_out: LeftOut = 0.0,
    tremor_cm: Annotated[
        float,
        typer.Option(help="Tremor of the hand, peak to peak, at 4 to 8 Hz.", min=0, max=10, callback=check_finite),
    ] = 0.0,
    hand: Annotated[
        HandUsed, typer.Option(help="Which hand pushes; either: as the seed draws it. A session's is the patient's.")
    ] = HandUsed.EITHER,
    workers: Workers = 2,
    json_file: Json = None,
    home: HomeOption = None,
) -> None:
    """Quick pushes of many hands with all twelve gestures: which command, and the others frame by frame."""
    from app.evaluate.trigger.push_results import shown
    from app.evaluate.trigger.pushes import LEFT, bouts, evaluate_pushes

    wanted = bouts(
        seed_numbers(seeds),
        attempts=attempts,
        click_s=click_range(click),
        left_out=left_out,
        tremor_m=tremor_cm / 100,
        left=LEFT[hand],
    )
    with detector_processes(home, workers, len(wanted)) as (pool, step):
        run = evaluate_pushes(pool, wanted, step)
    settings = {"seeds": seeds, "click_s": click, "left_out": left_out, "tremor_cm": tremor_cm, "hand": hand.value}
    with shown_after(shown(run)):
        write_json({**settings, **run.as_json()}, json_file)
    if run.interrupted or run.unrequested:
        raise typer.Exit(130 if run.interrupted else 1)
