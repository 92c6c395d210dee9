"""rleex evaluate finding."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from app.cli.evaluate.looking import hand_model
from app.cli.evaluate.options import Home

cli = typer.Typer()


@cli.command()
def finding(
    directory: Annotated[
        Path | None, typer.Argument(help="Folder with labels.csv, for its photos without a hand.")
    ] = None,
    digital: Annotated[int, typer.Option(help="Digital hands a pose, and empty rooms.", min=1)] = 10,
    first_seed: Annotated[int, typer.Option(help="Number of the first digital person.", min=0)] = 20_000,
    home: Home = None,
) -> None:
    """What the search for a hand wins that the plain picture misses, and what it costs."""
    from rich.console import Console
    from rich.table import Table

    from app.cli.progress import bar
    from app.evaluate import finding as worth
    from app.evaluate.gesture_photos import read_labels
    from hal.cameras.digital_hand.skeleton import POSES
    from kgdfa.keypoints import HandDetector

    console, total = Console(), digital * len(POSES)
    empty = worth.empty_rooms(digital, first_seed)
    if directory is not None:
        empty += worth.photos_without_hand(read_labels(directory), directory)
    with bar(console, "looking", total) as tell, HandDetector(hand_model(home), still=True) as detector:
        missed = worth.missed_hands(detector, digital, first_seed, tell)
        measured = worth.measure_glances(detector, missed, empty)
    table = Table(title=f"{total} digital hands, {len(missed)} missed by the plain picture")
    for head in ("scale", "turned", "found of them", "elsewhere", f"hands in {len(empty)} pictures without", "ms"):
        table.add_column(head, justify="right")
    for one in measured:
        figures = (one.right, one.wrong, one.false_hands, f"{one.cost_ms:.1f}")
        table.add_row(f"{one.view.scale:g}", f"{one.view.turn_deg:g}°", *map(str, figures))
    console.print(table)
