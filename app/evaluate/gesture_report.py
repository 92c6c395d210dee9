"""What `rleex evaluate gestures` shows: tables, JSON, the confusion matrix as a picture, the misjudged photos."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from app.evaluate.gesture_measures import CLASSES, Figures, Judged
from app.evaluate.gesture_photos import SeenPhoto
from app.system.errors import AppError
from kgdfa.draw import caption, draw_hand
from kgdfa.errors import KgdfaError
from kgdfa.preprocess import Image, as_bgr8

# Table 3 of the paper, %: Pre, Re, IoU, F1, AP.
PAPER_TABLE_3: dict[str, tuple[float, float, float, float, float]] = {
    "0": (97.92, 93.31, 96.88, 93.13, 96.02),
    "1": (98.43, 87.73, 98.10, 87.75, 96.49),
    "2": (98.99, 93.74, 93.86, 93.63, 98.89),
    "3": (98.94, 94.43, 97.97, 94.01, 98.12),
    "4": (96.71, 83.36, 95.68, 89.14, 96.63),
    "5": (99.08, 95.96, 96.93, 95.16, 99.01),
    "6": (98.97, 93.26, 98.22, 93.21, 98.91),
    "7": (89.01, 76.98, 88.09, 76.81, 88.33),
    "8": (93.71, 86.11, 95.82, 90.31, 95.58),
    "9": (86.78, 71.22, 85.51, 71.27, 85.07),
    "love": (98.86, 94.72, 96.05, 94.16, 96.87),
    "rock": (99.03, 96.09, 97.95, 95.84, 98.02),
}
PAPER_MAP = 95.67  # Table 4
PAPER_MACRO_F1 = sum(row[3] for row in PAPER_TABLE_3.values()) / len(PAPER_TABLE_3)
LARGEST_SIDE_PX = 640  # of a picture in the errors folder


def print_figures(console: Console, name: str, figures: Figures, photos: int) -> None:
    """Table 3 of one rule set with the paper's numbers beside, the undefined ones, the sources."""
    console.print(_table_3(name, figures))
    console.print(
        f"{name}: macro-F1 {figures.macro_f1:.4f} (paper {PAPER_MACRO_F1 / 100:.4f}), "
        f"mAP {figures.map:.4f} (paper {PAPER_MAP / 100:.4f}), "
        f"undefined accepted {figures.accepted_undefined:.2%}, {photos} photos, every one counted"
    )
    console.print(_undefined(name, figures))
    console.print(_sources(name, figures))


def _table_3(name: str, figures: Figures) -> Table:
    table = Table(title=f"{name} rules, % (the paper's Table 3 in brackets)")
    for heading in ("gesture", "Pre", "Re", "IoU", "F1", "AP", "n"):
        table.add_column(heading, justify="right")
    for gesture, row in figures.per_gesture.items():
        ours = (row.pre, row.re, row.iou, row.f1, row.ap)
        pairs = zip(ours, PAPER_TABLE_3[gesture], strict=True)
        table.add_row(gesture, *(f"{100 * own:.1f} ({paper:.1f})" for own, paper in pairs), str(row.n))
    return table


def _undefined(name: str, figures: Figures) -> Table:
    table = Table(title=f"{name} rules: undefined hands taken for a gesture")
    for heading in ("kind", "accepted", "n"):
        table.add_column(heading, justify="right")
    for kind, (share, count) in figures.per_kind.items():
        table.add_row(kind, f"{share:.1%}", str(count))
    return table


def _sources(name: str, figures: Figures) -> Table:
    table = Table(title=f"{name} rules by source of photos")
    for heading in ("source", "n", "hand found", "gestures right", "undefined accepted"):
        table.add_column(heading, justify="right")
    for source, row in figures.per_source.items():
        table.add_row(source, str(row.n), f"{row.detected:.1%}", f"{row.right:.1%}", f"{row.accepted_undefined:.1%}")
    return table


def print_confusion(console: Console, name: str, figures: Figures) -> None:
    """The confusion matrix, truth by row."""
    table = Table(title=f"{name} rules: said (across) for what was shown (down)")
    table.add_column("")
    for heading in CLASSES:
        table.add_column(heading, justify="right")
    for truth, row in zip(CLASSES, figures.confusion, strict=True):
        cells = [str(count) if count else "·" for count in row]
        table.add_row(truth, *(f"[bold]{c}[/]" if n == truth else c for n, c in zip(CLASSES, cells, strict=True)))
    console.print(table)


def as_json(figures: dict[str, Figures], seen: Sequence[SeenPhoto], how: str) -> dict[str, Any]:
    """The machine-readable report; shares in [0, 1]."""
    unreadable = [{"path": one.photo.path, "error": one.error} for one in seen if one.error]
    return {
        "images": len(seen),
        "how": how,
        "unreadable": unreadable,
        "rules": {name: _figures_json(one) for name, one in figures.items()},
    }


def _figures_json(figures: Figures) -> dict[str, Any]:
    return {
        "macro_f1": figures.macro_f1,
        "map": figures.map,
        "accepted_undefined": figures.accepted_undefined,
        "per_gesture": msgspec.to_builtins(figures.per_gesture),
        "per_kind": {kind: {"accepted": share, "n": count} for kind, (share, count) in figures.per_kind.items()},
        "per_source": msgspec.to_builtins(figures.per_source),
        "confusion": {"classes": CLASSES, "counts": figures.confusion.tolist()},
    }


def write_json(content: dict[str, Any], path: Path) -> None:
    """Write a report. Raises AppError when the file can't be written."""
    try:
        path.write_bytes(msgspec.json.format(msgspec.json.encode(content), indent=2))
    except OSError as error:
        raise AppError(f"{path} can't be written ({error}): choose another file.") from error


def write_confusion(figures: dict[str, Figures], path: Path) -> None:
    """The confusion matrices side by side as a PNG, each row in shares of what was shown."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(1, len(figures), figsize=(7 * len(figures), 6.4), squeeze=False)
    for axis, (name, one) in zip(axes[0], figures.items(), strict=True):
        shares = one.confusion / np.maximum(one.confusion.sum(axis=1, keepdims=True), 1)
        axis.imshow(shares, cmap="Blues", vmin=0, vmax=1)
        axis.set(title=f"{name}: macro-F1 {one.macro_f1:.3f}", xlabel="said", ylabel="shown")
        axis.set_xticks(range(len(CLASSES)), CLASSES)
        axis.set_yticks(range(len(CLASSES)), CLASSES)
        for (row, column), count in np.ndenumerate(one.confusion):
            if count:
                colour = "white" if shares[row, column] > 0.5 else "black"
                axis.text(column, row, str(count), ha="center", va="center", fontsize=7, color=colour)
    figure.tight_layout()
    try:
        figure.savefig(path, dpi=110)
    except OSError as error:
        raise AppError(f"{path} can't be written ({error}): choose another file.") from error
    finally:
        plt.close(figure)


def write_errors(
    judged: Sequence[Judged],
    seen: Sequence[SeenPhoto],
    photos: Path,
    errors: Path,
    tell: Callable[[], None] = lambda: None,
) -> int:
    """The misjudged photos with skeleton, hulls and explanation, one file each; how many there are."""
    wrong = [(one, photo) for one, photo in zip(judged, seen, strict=True) if one.said != one.truth]
    try:
        errors.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise AppError(f"{errors} can't be made ({error}): choose another folder.") from error
    for one, photo in wrong:
        image = cv2.imread(str(photos / one.photo.path), cv2.IMREAD_UNCHANGED)
        if image is not None:
            shown = _with_explanation(image, one, photo)
            name = f"{one.photo.label.replace(':', '-')}_as_{one.said}_{Path(one.photo.path).stem}.png"
            cv2.imwrite(str(errors / name.replace("/", "-")), shown)
        tell()
    return len(wrong)


def _with_explanation(image: NDArray[Any], judged: Judged, seen: SeenPhoto) -> Image:
    why = judged.verdict.explanation if judged.verdict else seen.error or "no hand found"
    try:
        picture = as_bgr8(image)
    except KgdfaError:
        return caption(np.zeros((8, 360, 3), np.uint8), [f"shown {judged.photo.label}, said {judged.said}", why])
    scale = max(1.0, 360 / picture.shape[1]) if max(picture.shape[:2]) < 360 else 1.0
    scale = min(scale, LARGEST_SIDE_PX / max(picture.shape[:2]))
    large = np.asarray(cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC), dtype=np.uint8)
    if seen.hands:
        draw_hand(large, replace(seen.hands[0], image_px=seen.hands[0].image_px * scale))
    return caption(large, [f"shown {judged.photo.label}, said {judged.said}", why])
