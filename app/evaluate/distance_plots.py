"""Pictures of the distance evaluations, as PNG."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")
from matplotlib import pyplot as plt

from app.evaluate.distance_frames import SequenceResult
from app.evaluate.distance_results import PAPER_TABLE_5, Table5
from app.evaluate.trigger import PAPER_TABLE_6, TriggerRow

SIZE = (9.0, 4.8)
STYLES: dict[str, dict[str, Any]] = {
    "published": {"color": "tab:orange", "linestyle": "--", "marker": "s"},
    "robust": {"color": "tab:blue", "linestyle": "-", "marker": "o"},
    "paper": {"color": "0.4", "linestyle": ":", "marker": "^"},
}


def plot_sequence(result: SequenceResult, path: Path) -> None:
    """Distance over the frames: truth, both finders, and the distance that the button uses."""
    figure, axes = plt.subplots(figsize=SIZE, layout="constrained")
    axes.plot(result.true_m * 100, color="black", label="truth")
    for name, shown_m in result.shown_m.items():
        style = {key: value for key, value in STYLES[name].items() if key != "marker"}
        axes.plot(shown_m * 100, label=name, linewidth=1, **style)
    axes.plot(result.safe_m["robust"] * 100, color="tab:blue", alpha=0.4, linewidth=1, label="robust, for the button")
    _finish(figure, axes, path, xlabel="frame", ylabel="distance, cm", title=f"{len(result.true_m)} labelled frames")


def plot_table_5(table: Table5, path: Path) -> None:
    """Error over distance, the paper's beside ours."""
    figure, axes = plt.subplots(figsize=SIZE, layout="constrained")
    distance = [row.distance_cm for row in table.rows]
    axes.plot(distance, [paper for paper, _ in PAPER_TABLE_5.values()], label="paper, monocular", **STYLES["paper"])
    for name in ("published", "robust"):
        axes.plot(distance, [row.mono_percent[name] for row in table.rows], label=f"monocular, {name}", **STYLES[name])
    axes.plot(
        distance, [row.depth_percent["robust"] for row in table.rows], "x-", color="tab:green", label="D435i, robust"
    )
    axes.axhspan(-2.5, 2.5, alpha=0.12, color="tab:blue")
    _finish(
        figure,
        axes,
        path,
        xlabel="true distance, cm",
        ylabel="error, %",
        title="Table 5 on the digital hand; band ± 2.5 %",
    )


def plot_table_6(rows: list[TriggerRow], path: Path) -> None:
    """Press probability over distance for both cameras and both modes."""
    figure, (left, right) = plt.subplots(1, 2, figsize=SIZE, sharey=True, layout="constrained")
    distance = [row.distance_cm for row in rows]
    for axes, camera, column in ((left, "monocular", 0), (right, "D435i", 1)):
        axes.plot(distance, [PAPER_TABLE_6[cm][column] for cm in distance], label="paper", **STYLES["paper"])
        for mode in ("published", "robust"):
            pressed = [100 * row.pressed[camera, mode] for row in rows]
            axes.plot(distance, pressed, label=mode, **STYLES[mode])
        axes.axvline(20, color="0.7", linewidth=1)
        axes.set_title(camera)
        axes.set_xlabel("true distance, cm")
        axes.legend()
    left.set_ylabel("presses, % of posture changes")
    figure.savefig(path, dpi=120)
    plt.close(figure)


def _finish(figure: Any, axes: Any, path: Path, **words: str) -> None:
    axes.set(**words)
    axes.grid(alpha=0.3)
    axes.legend()
    figure.savefig(path, dpi=120)
    plt.close(figure)
