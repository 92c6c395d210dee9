"""What `rleex evaluate gestures` and `video` give: tables, JSON, confusion matrices, the misclassified images drawn."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from app.evaluate.gestures.corrections import corrected
from app.evaluate.gestures.measures import CLASSES, Classified, Figures, SequenceFigures, measure
from app.evaluate.harness import (
    EvaluateFault,
    decimals,
    figure,
    in_english,
    percent,
    plain,
    table,
    write_whole,
    writing,
)
from app.evaluate.readings import UPRIGHT, DetectedImage
from app.text.catalogue import render, tr
from hal.cameras.playback import decode_image
from kgdfa.draw import caption, draw_hand
from kgdfa.errors import KgdfaError
from kgdfa.preprocess import Image, as_bgr8
from logs.reason import reason

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
# Their mean is a tie at four places, 0.89535: only an exact sum shows the same on every Python.
PAPER_MACRO_F1 = math.fsum(row[3] for row in PAPER_TABLE_3.values()) / len(PAPER_TABLE_3)
UNNAMED = "unnamed"
HEADER_OFF_FRAMES = 2  # a video's header estimates how many frames follow
LARGEST_SIDE_PX = 640  # of an image in the errors folder
NAME_BYTES = 80  # of a label and of a path in its name: of 255, what file systems take, with a temporary name's share


def shown(name: str, figures: Figures, images: int) -> Iterator[Table | str]:
    """Table 3 of one rule set beside the paper's, the undefined hands, the sources, the confusion matrix."""
    yield _table_3(name, figures)
    yield tr(
        "evaluate.gestures.summary",
        rules=name,
        f1=decimals(figures.macro_f1, ".4f"),
        paper_f1=PAPER_MACRO_F1 / 100,
        map=decimals(figures.map, ".4f"),
        paper_map=PAPER_MAP / 100,
        accepted=percent(figures.accepted_undefined, 2),
        wrong=percent(figures.wrong_gesture, 2),
        images=images,
    )
    yield table("gestures.undefined", "kind accepted n", _kinds(figures), left=0, rules=name)
    unnamed = tr("evaluate.gestures.unnamed")
    sources = [
        (source or unnamed, row.n, *map(percent, (row.detected, row.right, row.accepted_undefined)))
        for source, row in figures.per_source.items()
    ]
    columns = "source n hand_found gestures_right undefined_accepted"
    yield table("gestures.sources", columns, sources, left=0, rules=name)
    yield _confusion(name, figures)


def corrected_figures(classified: Mapping[str, Sequence[Classified]]) -> dict[str, Figures]:
    """Of every rule set with the labels that the images contradict corrected; {} where there is none."""
    return {
        name: measure([replace(one, image=corrected(one.image)) for one in some])
        for name, some in classified.items()
        if _corrections(some)
    }


def _corrections(classified: Sequence[Classified]) -> int:
    return sum(corrected(one.image) != one.image for one in classified)


def corrected_shown(figures: Mapping[str, Figures], classified: Mapping[str, Sequence[Classified]]) -> Iterator[str]:
    """A line a rule set, with these labels corrected."""
    for name, one in figures.items():
        yield tr(
            "evaluate.gestures.corrected",
            rules=name,
            count=_corrections(classified[name]),
            f1=decimals(one.macro_f1, ".4f"),
            map=decimals(one.map, ".4f"),
            wrong=percent(one.wrong_gesture, 2),
        )


def kinds_shown(figures: Figures) -> Iterator[Table | str]:
    """Undefined hands of kinds that the fit never saw."""
    yield table("gestures.kinds_left_out", "kind accepted n", _kinds(figures), left=0)
    yield tr("evaluate.gestures.kinds_summary", accepted=percent(figures.accepted_undefined, 2))


def _kinds(figures: Figures) -> list[tuple[str, str, int]]:
    return [(kind, percent(share), count) for kind, (share, count) in figures.per_kind.items()]


def kinds_json(figures: Figures | None) -> dict[str, Any]:
    """The same for the machine-readable report; nothing where no kind was left out."""
    return {} if figures is None else {"kinds_left_out": _kinds_json(figures)}


def _table_3(name: str, figures: Figures) -> Table:
    rows = []
    for gesture, row in figures.per_gesture.items():
        ours = [decimals(own and 100 * own, ".1f") for own in (row.pre, row.re, row.iou, row.f1, row.ap)]
        pairs = zip(ours, PAPER_TABLE_3[gesture], strict=True)
        rows.append((gesture, *(f"{own} ({paper:.1f})" for own, paper in pairs), row.n))
    return table("gestures.table_3", "gesture pre re iou f1 ap n", rows, left=0, rules=name)


def _confusion(name: str, figures: Figures) -> Table:
    """The labels by row."""
    made = table("gestures.confusion", "empty", rules=name)
    for heading in CLASSES:
        made.add_column(heading, justify="right")
    for truth, row in zip(CLASSES, figures.confusion, strict=True):
        cells = [str(count) if count else "·" for count in row]
        made.add_row(truth, *(plain(c, "bold" if n == truth else "") for n, c in zip(CLASSES, cells, strict=True)))
    return made


def sequence_shown(
    where: Path, figures: Mapping[str, SequenceFigures], unreadable: Sequence[Path], claimed_frames: int | None
) -> Iterator[Table | str]:
    """The table, frames that can't be read, and a header that claims more of them than its estimate may be off by."""
    yield sequence_table(where, figures)
    frames = next(iter(figures.values())).frames
    if claimed_frames is not None and claimed_frames - frames > HEADER_OFF_FRAMES:
        yield tr("evaluate.sequence.cut", file=where, frames=frames, claimed=claimed_frames)
    yield from (tr("evaluate.sequence.unreadable", file=path) for path in unreadable)


def sequence_table(where: Path, figures: Mapping[str, SequenceFigures]) -> Table:
    """A row a figure, a column a rule set."""
    built = [msgspec.to_builtins(one) for one in figures.values()]
    rows = [(tr(f"evaluate.sequence.{field}"), *(_figure(one[field]) for one in built)) for field in built[0]]
    columns = "empty " + " ".join(figures)
    return table("sequence", columns, rows, file=where, frames=next(iter(figures.values())).frames)


def _figure(value: float | None) -> str:
    """A count as it is; a share to a ten-thousandth."""
    return "–" if value is None else str(value) if isinstance(value, int) else f"{value:.4f}"


def as_json(
    figures: Mapping[str, Figures],
    labels_corrected: Mapping[str, Figures],
    detected: Sequence[DetectedImage],
    *,
    cross_validated: bool,
    views: int | None,
    prepare: str,
) -> dict[str, Any]:
    """The machine-readable report; shares in [0, 1], null: of nothing. views: how many of an image were used, None for
    all. prepare: the name of the preprocessing.

    labels_corrected: the same figures with the labels that the images contradict corrected; {} where none is.
    """
    return {
        "images": len(detected),
        "cross_validated": cross_validated,
        "views": views,
        "prepare": prepare,
        "unreadable": [
            {"path": one.image.path, "error": msgspec.to_builtins(one.error)} for one in detected if one.error
        ],
        "rules": {name: _figures_json(one) for name, one in figures.items()},
        "labels_corrected": {name: _figures_json(one) for name, one in labels_corrected.items()},
    }


def _figures_json(figures: Figures) -> dict[str, Any]:
    return {
        "macro_f1": figures.macro_f1,
        "map": figures.map,
        "accepted_undefined": figures.accepted_undefined,
        "wrong_gesture": figures.wrong_gesture,
        "per_gesture": msgspec.to_builtins(figures.per_gesture),
        "per_kind": _kinds_json(figures),
        "per_source": msgspec.to_builtins({_key(source, figures): one for source, one in figures.per_source.items()}),
        "confusion": {"classes": CLASSES, "counts": figures.confusion.tolist()},
    }


def _key(source: str, figures: Figures) -> str:
    """A source's in the JSON: a name for the empty one, unless a source has it."""
    return source if source or UNNAMED in figures.per_source else UNNAMED


def _kinds_json(figures: Figures) -> dict[str, Any]:
    return {kind: {"accepted": share, "n": count} for kind, (share, count) in figures.per_kind.items()}


def plot_confusion(figures: Mapping[str, Figures], path: Path) -> None:
    """The confusion matrices side by side as a PNG, each row in shares of what was shown."""
    with figure(path, 1, len(figures), size=(7 * len(figures), 6.4)) as (_, axes):
        for axis, (name, one) in zip(np.atleast_1d(axes), figures.items(), strict=True):
            shares = one.confusion / np.maximum(one.confusion.sum(axis=1, keepdims=True), 1)
            axis.imshow(shares, cmap="Blues", vmin=0, vmax=1)
            axis.set(
                title=tr("evaluate.plot.macro_f1", rules=name, f1=decimals(one.macro_f1, ".3f")),
                xlabel=tr("evaluate.plot.predicted"),
                ylabel=tr("evaluate.plot.shown"),
            )
            axis.set_xticks(range(len(CLASSES)), CLASSES)
            axis.set_yticks(range(len(CLASSES)), CLASSES)
            for (row, column), count in np.ndenumerate(one.confusion):
                if count:
                    colour = "white" if shares[row, column] > 0.5 else "black"
                    axis.text(column, row, str(count), ha="center", va="center", fontsize=7, color=colour)


def write_errors(
    classified: Sequence[Classified], detected: Sequence[DetectedImage], directory: Path, errors: Path
) -> int:
    """The misclassified images with skeleton, hulls and explanation, one file each; how many there are.

    A file's name begins with the image's row in labels.csv, the first being 1.
    """
    rows = enumerate(zip(classified, detected, strict=True), start=1)
    wrong = [(row, one, found) for row, (one, found) in rows if one.predicted != one.truth]
    with writing(errors):
        errors.mkdir(parents=True, exist_ok=True)
    for row, one, found in wrong:
        image = decode_image(directory / one.image.path, UPRIGHT)
        if image is not None:
            stem = one.image.path.removesuffix(Path(one.image.path).suffix)
            name = f"{row:05}_{_tail(one.image.label)}_as_{one.predicted}_{_tail(stem)}.png"
            with in_english():
                _, encoded = cv2.imencode(".png", _explained(image, one, found))
            write_whole(errors / name, encoded.tobytes())
    return len(wrong)


def _tail(text: str) -> str:
    """The end of it, as a part of a file's name."""
    return re.sub("[/:]", "-", text.encode()[-NAME_BYTES:].decode(errors="ignore"))


def _explained(image: NDArray[Any], classified: Classified, detected: DetectedImage) -> Image:
    lines = [
        tr("evaluate.gestures.shown_as", shown=classified.image.label, predicted=classified.predicted),
        render(classified.verdict.explanation)
        if classified.verdict
        else render(detected.error or reason(EvaluateFault.NO_HAND)),
    ]
    try:
        bgr = as_bgr8(image)
    except KgdfaError:
        return caption(np.zeros((8, 360, 3), np.uint8), lines)
    scale = max(1.0, 360 / bgr.shape[1]) if max(bgr.shape[:2]) < 360 else 1.0
    scale = min(scale, LARGEST_SIDE_PX / max(bgr.shape[:2]))
    height, width = (max(1, round(side * scale)) for side in bgr.shape[:2])
    large = np.asarray(cv2.resize(bgr, (width, height), interpolation=cv2.INTER_CUBIC), dtype=np.uint8)
    if detected.hands:
        draw_hand(large, replace(detected.hands[0], image_px=detected.hands[0].image_px * scale))
    return caption(large, lines)
