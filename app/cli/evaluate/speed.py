"""rleex evaluate speed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from app.cli.evaluate.looking import hand_model
from app.cli.evaluate.options import Home, Json

if TYPE_CHECKING:
    from rich.console import Console

    from app.evaluate.speed import SpeedFigures
    from kgdfa.preprocess import Image

cli = typer.Typer()


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
    home: Home = None,
) -> None:
    """Table 4's row: the whole chain's speed beside bare MediaPipe's on the same frames."""
    import msgspec
    from rich.console import Console

    from app.cli.progress import bar
    from app.evaluate.gesture_report import write_json
    from app.evaluate.speed import WARM_UP, measure_speed
    from app.evaluate.throughput import frames_for_speed, measure_throughput, worker_counts

    console, model = Console(), hand_model(home)
    images, focal_px = frames_for_speed(directory, frames)
    with bar(console, "timing", len(images) + min(WARM_UP, len(images))) as tell:
        figures = measure_speed(images, model, focal_px=focal_px, tell=tell)
    _print_speed(console, figures, images[0])
    offline = []
    for count in worker_counts(workers):
        with console.status(f"{count} processes at once"):
            offline.append(measure_throughput(directory, frames, model, count))
        console.print(f"offline, {count} at once, a recording each: {offline[-1].fps:.0f} frames a second altogether")
    if json_file is not None:
        write_json({**msgspec.to_builtins(figures), "offline": msgspec.to_builtins(offline)}, json_file)


def _print_speed(console: Console, figures: SpeedFigures, image: Image) -> None:
    from rich.table import Table

    table = Table(title=f"{figures.frames} frames of {image.shape[1]}×{image.shape[0]}, ms a frame")
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
