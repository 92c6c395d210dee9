"""rleex evaluate distance, trigger, idle: how right distance is, and when the virtual button presses."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from rich.console import Console

    from kgdfa.keypoints import HandDetector

cli = typer.Typer()

JsonOption = Annotated[Path | None, typer.Option("--json", help="Write the result here as well.")]
PlotOption = Annotated[Path | None, typer.Option("--plot", help="Write a picture of it (PNG) here.")]
HomeOption = Annotated[Path | None, typer.Option("--home", help="Data directory.")]
WorkersOption = Annotated[int, typer.Option(help="Processes that look at hands at the same time.", min=1, max=64)]
FocalOption = Annotated[
    float, typer.Option(help="Focal length of the digital camera, px at 1280×720.", min=200, max=3000)
]


@cli.command()
def distance(
    folder: Annotated[Path | None, typer.Argument(help="A folder with frames.csv; without it, Table 5.")] = None,
    hands: Annotated[int, typer.Option(help="Digital hands, without a folder.", min=1)] = 6,
    walks: Annotated[int, typer.Option(help="Seconds of random walk, without a folder.", min=1)] = 48,
    focal_px: FocalOption = 650.0,
    workers: WorkersOption = 2,
    json_file: JsonOption = None,
    plot: PlotOption = None,
    home: HomeOption = None,
) -> None:
    """Distance against the truth: on labelled frames, or Table 5 on the digital hand."""
    from rich.console import Console

    console = Console()
    if folder is not None:
        _on_frames(console, folder, json_file, plot, home)
    else:
        _table_5(console, hands, walks, focal_px, workers, json_file, plot, home)


@cli.command()
def trigger(
    changes: Annotated[int, typer.Option(help="Posture changes at each distance.", min=4)] = 20,
    rates: Annotated[bool, typer.Option(help="Measure each camera's frame rate too; wants a quiet machine.")] = True,
    focal_px: FocalOption = 650.0,
    workers: WorkersOption = 2,
    json_file: JsonOption = None,
    plot: PlotOption = None,
    home: HomeOption = None,
) -> None:
    """Table 6: how often posture changes press the button, both cameras, both modes; and each camera's frame rate."""
    from rich.console import Console

    from app.evaluate.distance_tables import table_6
    from app.evaluate.trigger import DISTANCES_CM, evaluate_trigger, measure_rates, steps
    from app.evaluate.watcher import processes
    from kgdfa.keypoints import live_detector

    console, model, measured = Console(), _model(home), {}
    if rates:
        with live_detector(model) as detector, _bar(console, len(DISTANCES_CM)) as step:
            measured = measure_rates(detector, focal_px=focal_px, step=step)
    with processes(model, workers) as pool, _bar(console, steps(changes)) as step:
        rows = evaluate_trigger(pool, changes=changes, focal_px=focal_px, rates=measured, step=step)
    console.print(table_6(rows))
    _write(json_file, {"changes": changes, "focal_px": focal_px, "table_6": [row.as_json() for row in rows]})
    if plot is not None:
        from app.evaluate.distance_plots import plot_table_6

        plot_table_6(rows, plot)


@cli.command()
def idle(
    frames: Annotated[int, typer.Option(help="Frames to simulate.", min=100)] = 100_000,
    seed: Annotated[int, typer.Option(help="Another seed, other hands and movements.")] = 1,
    json_file: JsonOption = None,
    home: HomeOption = None,
) -> None:
    """Hands that move, turn, wave and pass by without pressing: no command may come of it.

    The keypoints are simulated: the digital hand's own, with noise taken from MediaPipe on rendered frames.
    """
    from rich.console import Console

    from app.evaluate.distance_tables import idle_table
    from app.evaluate.idle import NOISE_FRAMES, NOISE_WALKS, evaluate_idle, take_noise

    console = Console()
    with _detector(home) as detector, _bar(console, NOISE_WALKS * NOISE_FRAMES) as step:
        clips = take_noise(detector, step)
    with _bar(console, frames) as step:
        result = evaluate_idle(clips, frames=frames, seed=seed, step=step)
    console.print(idle_table(result))
    _write(json_file, result.as_json())
    if result.commands["robust"]:
        raise typer.Exit(1)


@cli.command("press-zone")
def press_zone(
    hands: Annotated[int, typer.Option(help="Digital hands a gesture.", min=1)] = 3,
    workers: WorkersOption = 2,
    json_file: JsonOption = None,
    home: HomeOption = None,
) -> None:
    """How near each gesture is followed, with two lenses, and whether a push commands."""
    from rich.console import Console

    from app.evaluate.distance_tables import zone_table
    from app.evaluate.press_zone import LENSES_PX, evaluate_press_zone, steps, zone_of
    from app.evaluate.watcher import processes
    from hal.cameras.digital_hand.render import Person, lens_for

    console, model = Console(), _model(home)
    for focal_px in LENSES_PX:
        console.print(f"{focal_px:.0f} px: {zone_of(Person(), lens_for(focal_px=focal_px)).sentence}")
    with processes(model, workers) as pool, _bar(console, steps(hands)) as step:
        rows = evaluate_press_zone(pool, hands=hands, step=step)
    console.print(zone_table(rows))
    _write(json_file, {"hands": hands, "rows": [row.as_json() for row in rows]})


def _on_frames(console: Console, folder: Path, json_file: Path | None, plot: Path | None, home: Path | None) -> None:
    from app.evaluate.distance_frames import FINDERS, measure_frames, read_frames
    from app.evaluate.distance_tables import sequence_table

    frames = read_frames(folder)
    with _detector(home) as detector, _bar(console, len(frames)) as step:
        result = measure_frames(frames, detector, step)
    console.print(sequence_table(result))
    for path in result.unreadable:
        console.print(f"unreadable, counted as missing: {path}", markup=False)
    _write(json_file, {"frames": len(frames), **{name: result.figures(name).as_json() for name in FINDERS}})
    if plot is not None:
        from app.evaluate.distance_plots import plot_sequence

        plot_sequence(result, plot)


def _table_5(
    console: Console,
    hands: int,
    walks: int,
    focal_px: float,
    workers: int,
    json_file: Path | None,
    plot: Path | None,
    home: Path | None,
) -> None:
    from app.evaluate.distance_table import evaluate_table_5, steps
    from app.evaluate.distance_tables import table_5, tilt_table, walk_table
    from app.evaluate.watcher import processes

    with processes(_model(home), workers) as pool, _bar(console, steps(hands, walks)) as step:
        table = evaluate_table_5(pool, hands=hands, walks=walks, focal_px=focal_px, step=step)
    for part in (table_5(table), tilt_table(table), walk_table(table)):
        console.print(part)
    _write(json_file, table.as_json())
    if plot is not None:
        from app.evaluate.distance_plots import plot_table_5

        plot_table_5(table, plot)


@contextmanager
def _detector(home: Path | None) -> Iterator[HandDetector]:
    from kgdfa.keypoints import live_detector

    with live_detector(_model(home)) as detector:
        yield detector


def _model(home: Path | None) -> Path:
    from app.system.config import load_config
    from app.system.hand_model import set_up_model
    from app.system.paths import find_home

    place = find_home(home)
    return set_up_model(place, load_config(place.config))


@contextmanager
def _bar(console: Console, total: int) -> Iterator[Callable[..., None]]:
    """A progress bar; the yielded function advances it by one, or by the number given."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeElapsedColumn, TimeRemainingColumn

    columns = (BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("", total=total)
        yield lambda count=1: progress.advance(task, count)


def _write(path: Path | None, result: dict[str, Any]) -> None:
    if path is not None:
        path.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
