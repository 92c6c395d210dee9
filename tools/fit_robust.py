"""Fits the `robust` rules on labelled images and digital hands, prints what it fitted, writes kgdfa/robust.npz.

    python tools/fit_robust.py ../shared/data/gestures --keypoints keypoints.npz

Measured figures never come from here: `rleex evaluate gestures DIR --cross-validate` fits without what it measures.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from app.cli.evaluate.keypoints import detected_images, fitted_beside, fitted_digital
from app.evaluate.gestures.fit import MEMBERS, fit
from app.evaluate.gestures.folds import view_set
from app.evaluate.gestures.simulated import simulate
from kgdfa.features import FEATURES
from kgdfa.robust import GESTURES, RobustModel, save_model
from logs.reading.errors import CodedError

SHIPPED = Path(__file__).resolve().parents[1] / "kgdfa" / "robust.npz"


def main(
    directory: Annotated[Path, typer.Argument(help="Folder with labels.csv and images.")],
    keypoints: Annotated[Path | None, typer.Option(help="Keep the keypoints here; used when there.")] = None,
    beside: Annotated[
        list[Path] | None, typer.Option("--with", help="Further folder; its keypoints.npz is used where it has one.")
    ] = None,
    output: Annotated[Path, typer.Option(help="Where the model goes.")] = SHIPPED,
    home: Annotated[Path | None, typer.Option("--home", help="Data directory.")] = None,
) -> None:
    """Fit, print, write."""
    console = Console()
    images = detected_images(directory, keypoints, home)
    for further in beside or []:
        images += fitted_beside(further, None, home)
    digital = fitted_digital(home, keypoints)
    views, simulated = view_set([*images, *digital]), simulate(digital)
    console.print(
        f"{len(images)} images, {len(digital)} digital hands, {len(views.values)} views, "
        f"{len(simulated.values)} simulated hands"
    )
    with console.status("fitting") as status:
        model = fit(
            views,
            np.ones(len(views.images), dtype=bool),
            simulated,
            lambda source: status.update(f"fitting {source and 'without ' + source}"),
        )
    _print(console, model)
    save_model(model, output)
    console.print(f"written to {output.name}, {output.stat().st_size / 1024:.0f} kB")


def _print(console: Console, model: RobustModel) -> None:
    """Thresholds, and each gesture's ranges of the paper's angles."""
    table = Table(title="fitted: acceptance thresholds, and between which angles 94 % of a gesture's hands lie")
    table.add_column("gesture")
    table.add_column("accept from", justify="right")
    angles = [k for k, feature in enumerate(FEATURES) if feature.name.endswith(" angle")]
    for k in angles:
        table.add_column(FEATURES[k].name, justify="right")
    for number, gesture in enumerate(GESTURES):
        ranges = (f"{model.low[number, k]:.0f}–{model.high[number, k]:.0f}°" for k in angles)
        table.add_row(gesture.value, f"{model.accept[number]:.2f}", *ranges)
    console.print(table)
    features, units = model.weights_in.shape
    console.print(
        f"{MEMBERS} perceptrons of {features} features, {units // MEMBERS} hidden units each and {len(model.classes)} "
        f"classes; a lead of {model.tie:.2f} over the next; kinds of none: {', '.join(model.classes[len(GESTURES) :])}"
    )


if __name__ == "__main__":
    try:
        typer.run(main)
    except CodedError as error:
        sys.stderr.write(f"{error}\n")
        raise SystemExit(2) from None
