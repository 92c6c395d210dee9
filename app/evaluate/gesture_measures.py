"""The paper's measures (Eqs. 5-10) of a rule set on labelled photos, every photo counted.

A photo without a hand, or that can't be read, is judged "none" with confidence 0 in every gesture. Pre, Re, IoU
and F1 follow Eqs. 5-8 on the counts of judged photos (Eq. 7's IoU is TP / (TP + FP + FN), not an overlap of
boxes). AP (Eq. 9) is the area under precision over recall when all photos are ranked by their confidence in
the gesture; mAP (Eq. 10) is its mean over the twelve.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from sklearn.metrics import (
    average_precision_score,
    confusion_matrix,
    jaccard_score,
    precision_recall_fscore_support,
)

from app.evaluate.gesture_photos import Photo
from kgdfa.gesture import Gesture, Verdict
from kgdfa.hand import FloatArray

NONE = "none"
CLASSES = [*(gesture.value for gesture in Gesture), NONE]
GESTURE_NAMES = CLASSES[:-1]


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """What a rule set said of one photo. scores: (12,) confidence in each gesture."""

    photo: Photo
    detected: bool
    verdict: Verdict | None
    scores: FloatArray

    @property
    def said(self) -> str:
        """The gesture's name, or none."""
        accepted = self.verdict.gesture if self.verdict else None
        return accepted.value if accepted else NONE

    @property
    def truth(self) -> str:
        """The label, all kinds of none as one."""
        return self.photo.label if self.photo.gesture else NONE


@dataclass(frozen=True, slots=True, kw_only=True)
class GestureFigures:
    """One line of Table 3; shares in [0, 1]."""

    pre: float
    re: float
    iou: float
    f1: float
    ap: float
    n: int


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceFigures:
    """How one source of photos fares."""

    n: int
    detected: float  # share of the photos that show a hand
    right: float  # share of the gestures' photos judged right
    accepted_undefined: float  # share of the undefined ones taken for a gesture


@dataclass(frozen=True, slots=True, kw_only=True)
class Figures:
    """Everything measured of one rule set. confusion: (13, 13) counts, truth by row, in the order of CLASSES."""

    macro_f1: float
    map: float
    accepted_undefined: float
    per_gesture: dict[str, GestureFigures]
    per_kind: dict[str, tuple[float, int]]  # of undefined: share accepted, and how many there are
    per_source: dict[str, SourceFigures]
    confusion: NDArray[np.int64]


def measure(judged: Sequence[Judged]) -> Figures:
    """Eqs. 5-10 on judged photos."""
    truth, said = [one.truth for one in judged], [one.said for one in judged]
    names = GESTURE_NAMES
    pre, re, f1, n = precision_recall_fscore_support(truth, said, labels=names, zero_division=0.0)
    iou = jaccard_score(truth, said, labels=names, average=None, zero_division=0.0)
    ap = _average_precisions(truth, np.array([one.scores for one in judged]).reshape(-1, len(names)))
    per_gesture = {
        name: GestureFigures(
            pre=float(pre[k]), re=float(re[k]), iou=float(iou[k]), f1=float(f1[k]), ap=ap[k], n=int(n[k])
        )
        for k, name in enumerate(names)
    }
    shown = [figures for figures in per_gesture.values() if figures.n]
    undefined = [one for one in judged if one.truth == NONE]
    return Figures(
        macro_f1=_mean(figures.f1 for figures in shown),
        map=_mean(figures.ap for figures in shown),
        accepted_undefined=_mean(one.said != NONE for one in undefined),
        per_gesture=per_gesture,
        per_kind={kind: (_accepted(some), len(some)) for kind, some in _grouped(undefined, "label").items()},
        per_source={source: _source(some) for source, some in _grouped(judged, "source").items()},
        confusion=confusion_matrix(truth, said, labels=CLASSES),
    )


def _average_precisions(truth: list[str], scores: FloatArray) -> list[float]:
    """AP a gesture; 0 for those that no photo shows (they don't count in the mean)."""
    found = [np.array([label == name for label in truth]) for name in GESTURE_NAMES]
    return [
        float(average_precision_score(is_it, scores[:, k])) if is_it.any() else 0.0 for k, is_it in enumerate(found)
    ]


def _source(some: list[Judged]) -> SourceFigures:
    gestures = [one for one in some if one.truth != NONE]
    return SourceFigures(
        n=len(some),
        detected=_mean(one.detected for one in some if one.photo.label != "none:nohand"),
        right=_mean(one.said == one.truth for one in gestures),
        accepted_undefined=_accepted([one for one in some if one.truth == NONE]),
    )


def _accepted(some: list[Judged]) -> float:
    return _mean(one.said != NONE for one in some)


def _grouped(judged: Iterable[Judged], attribute: str) -> dict[str, list[Judged]]:
    groups: dict[str, list[Judged]] = defaultdict(list)
    for one in judged:
        groups[getattr(one.photo, attribute) or "unnamed"].append(one)
    return dict(sorted(groups.items()))


def _mean(values: Iterable[float]) -> float:
    listed = [float(value) for value in values]
    return float(np.mean(listed)) if listed else 0.0
