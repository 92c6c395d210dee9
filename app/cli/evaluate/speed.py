"""rleex evaluate speed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from app.cli.evaluate.looking import hand_model
from app.cli.evaluate.options import Home, Json

if TYPE_CHECKING:
    from kgdfa.images import Image

cli = typer.Typer()


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
        figures = measure_speed(images, hand_model(home), focal_px=focal_px, tell=tell)
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
