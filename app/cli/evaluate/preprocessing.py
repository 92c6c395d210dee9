"""rleex evaluate preprocessing."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from app.cli.evaluate.looking import hand_model
from app.cli.evaluate.options import Home, Json

cli = typer.Typer()


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
    from hal.cameras.digital_hand.skeleton import POSES
    from kgdfa.keypoints import HandDetector
    from kgdfa.preprocess import PREPARATIONS

    console = Console()
    photos = read_labels(directory)[::every] if directory is not None else []
    pictures = worth.photo_pictures(photos, directory) if directory else worth.digital_pictures(digital, MEASURE_SEEDS)
    total = len(photos) if directory else digital * len(POSES)
    with bar(console, "preparing and judging", total) as tell, HandDetector(hand_model(home), still=True) as detector:
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
