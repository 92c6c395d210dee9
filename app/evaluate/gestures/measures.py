"""The paper's measures (Eqs. 5-10) of a rule set on labelled images, every image counted; and those of a sequence.

An image without a hand, or that can't be read, is classified "none" with confidence 0 in every gesture; but one of an
undefined hand that can't be read was not refused, and is left out of the shares accepted. Pre, Re, IoU and F1 are those
of Eqs. 5-8 on the counts of classified images (Eq. 7's IoU is TP / (TP + FP + FN), not an overlap of boxes). AP (Eq. 9)
is the area under precision over recall when all images are ranked by their confidence in the gesture; mAP (Eq. 10) is
its mean over the twelve.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.evaluate.harness import FRAME_NS, EvaluateFault, Step, mean, require_extra
from app.evaluate.readings import GESTURE_NAMES, NO_HAND, SKIP, Footage, LabelledImage
from app.system.errors import AppError
from kgdfa.button_state import ButtonPlace
from kgdfa.frame_time import have_lasted
from kgdfa.gesture import END_FRAMES, VOTE_FRAMES, RuleSet, Verdict
from kgdfa.hand import FloatArray
from kgdfa.pipeline import Pipeline, PipelineInput, Report
from kgdfa.preprocess import AsNeeded
from kgdfa.robust_distance import RobustRange

NONE = "none"
CLASSES = [*GESTURE_NAMES, NONE]
PLACE = ButtonPlace.in_the_middle(1280, 720, threshold_m=0.20)


@dataclass(frozen=True, slots=True, kw_only=True)
class Classified:
    """A rule set's verdict on one image. scores: (12,) confidence in each gesture."""

    image: LabelledImage
    detected: bool
    verdict: Verdict | None
    scores: FloatArray
    readable: bool = True

    @property
    def predicted(self) -> str:
        """The gesture's name, or none."""
        accepted = self.verdict.gesture if self.verdict else None
        return accepted.value if accepted else NONE

    @property
    def truth(self) -> str:
        """The label, all kinds of none as one."""
        return self.image.label if self.image.gesture else NONE


@dataclass(frozen=True, slots=True, kw_only=True)
class GestureFigures:
    """One line of Table 3; shares in [0, 1]. None: no image shows the gesture; pre too where none was taken for it."""

    pre: float | None
    re: float | None
    iou: float | None
    f1: float | None
    ap: float | None
    n: int


NOT_SHOWN = GestureFigures(pre=None, re=None, iou=None, f1=None, ap=None, n=0)


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceFigures:
    """One source of images; None: a share of nothing."""

    n: int
    detected: float | None  # share of the images that show a hand
    right: float | None  # share of the gestures' images classified right
    accepted_undefined: float | None  # share of the readable undefined ones taken for a gesture


@dataclass(frozen=True, slots=True, kw_only=True)
class Figures:
    """Everything measured of one rule set; None: a mean or share of nothing.

    confusion: (13, 13) counts, truth by row, in the order of CLASSES.
    """

    macro_f1: float | None
    map: float | None
    accepted_undefined: float | None
    wrong_gesture: float | None  # share of the gestures' images taken for another gesture
    per_gesture: dict[str, GestureFigures]
    per_kind: dict[str, tuple[float | None, int]]  # of undefined, readable: share accepted, and how many there are
    per_source: dict[str, SourceFigures]  # "": of images whose source is left empty
    confusion: NDArray[np.int64]


def measure(classified: Sequence[Classified]) -> Figures:
    """Eqs. 5-10 on classified images. Raises AppError without the extra `evaluate`."""
    require_extra("evaluate", "sklearn")
    from sklearn.metrics import confusion_matrix, jaccard_score, precision_recall_fscore_support

    truth, predicted = [one.truth for one in classified], [one.predicted for one in classified]
    names = GESTURE_NAMES
    pre, re, f1, n = precision_recall_fscore_support(truth, predicted, labels=names, zero_division=0.0)
    iou = jaccard_score(truth, predicted, labels=names, average=None, zero_division=0.0)
    ap = _average_precisions(truth, np.array([one.scores for one in classified]).reshape(-1, len(names)))
    per_gesture = {
        name: GestureFigures(
            pre=float(pre[k]) if name in predicted else None,
            re=float(re[k]),
            iou=float(iou[k]),
            f1=float(f1[k]),
            ap=ap[k],
            n=int(n[k]),
        )
        if n[k]
        else NOT_SHOWN
        for k, name in enumerate(names)
    }
    undefined = [one for one in classified if one.truth == NONE and one.readable]
    gestures = [one for one in classified if one.truth != NONE]
    return Figures(
        macro_f1=mean(f1[n > 0]),
        map=mean(np.array(ap)[n > 0]),
        accepted_undefined=_accepted(undefined),
        wrong_gesture=mean(one.predicted not in (NONE, one.truth) for one in gestures),
        per_gesture=per_gesture,
        per_kind={kind: (_accepted(some), len(some)) for kind, some in _grouped(undefined, "label").items()},
        per_source={source: _source(some) for source, some in _grouped(classified, "source").items()},
        confusion=confusion_matrix(truth, predicted, labels=CLASSES),
    )


def _average_precisions(truth: list[str], scores: FloatArray) -> list[float]:
    """AP a gesture; 0 for those that no image shows (of which nothing is measured)."""
    from sklearn.metrics import average_precision_score

    found = [np.array([label == name for label in truth]) for name in GESTURE_NAMES]
    return [
        float(average_precision_score(is_it, scores[:, k])) if is_it.any() else 0.0 for k, is_it in enumerate(found)
    ]


def _source(some: list[Classified]) -> SourceFigures:
    gestures = [one for one in some if one.truth != NONE]
    return SourceFigures(
        n=len(some),
        detected=mean(one.detected for one in some if one.image.label != NO_HAND),
        right=mean(one.predicted == one.truth for one in gestures),
        accepted_undefined=_accepted([one for one in some if one.truth == NONE and one.readable]),
    )


def _accepted(some: list[Classified]) -> float | None:
    return mean(one.predicted != NONE for one in some)


def _grouped(classified: Iterable[Classified], attribute: str) -> dict[str, list[Classified]]:
    groups: dict[str, list[Classified]] = defaultdict(list)
    for one in classified:
        groups[getattr(one.image, attribute)].append(one)
    return dict(sorted(groups.items()))


@dataclass(frozen=True, slots=True, kw_only=True)
class SequenceFigures:
    """What a sequence shows. Frames between gestures (skip) count in nothing but false onsets; None: a share or mean of
    nothing.
    """

    frames: int
    frame_accuracy: float | None  # of single verdicts
    voted_accuracy: float | None  # of the voted gesture
    shown: int  # stretches of one gesture long enough to be voted
    recognised: int  # of those, how many were voted at all
    broken: int  # recognised, and lost again before the stretch ended
    delay_frames: float | None  # mean, from a stretch's first frame to its vote
    delay_ms: float | None  # the same: a faster camera's vote takes more frames
    false_onsets: int  # votes for what neither this stretch nor its neighbours show


def run_sequence(footage: Footage, model: Path, rules: RuleSet, step: Step = lambda: None) -> list[Report | None]:
    """The whole chain over labelled footage, at its own rate; None for a frame that can't be read.

    Raises AppError where none can be read.
    """
    from kgdfa.keypoints import live_detector

    finder = RobustRange(focal_px=footage.focal_px, reference_m=footage.reference_m)
    reports: list[Report | None] = []
    with live_detector(model) as detector:
        pipeline = Pipeline(
            detector=detector,
            rules=rules,
            range_finder=finder,
            place=PLACE,
            prepare=AsNeeded(),
            follow=detector.follow,
        )
        for number, image in enumerate(footage.frames(), start=1):
            given = None if image is None else PipelineInput(image_bgr=image, captured_ns=number * footage.period_ns)
            reports.append(None if given is None else pipeline.process(given))
            step()
    if footage.paths and not any(reports):
        raise AppError(EvaluateFault.IMAGE_UNREADABLE, file=footage.paths[0])
    return reports


def measure_sequence(
    labels: Sequence[str], raw: Sequence[str | None], voted: Sequence[str], period_ns: int = FRAME_NS
) -> SequenceFigures:
    """Figures from labels (a gesture, none:<what> or skip), single verdicts and votes, one each a frame.

    period_ns: of a frame. As in the vote, what is counted in frames lasts as long as so many at 30 Hz.
    A frame that can't be read (verdict None) counts in no share where no gesture is shown: nothing was refused.
    """
    truth = [label if label in GESTURE_NAMES else SKIP if label == SKIP else NONE for label in labels]
    counted = [k for k, label in enumerate(truth) if label in GESTURE_NAMES or (label == NONE and raw[k] is not None)]
    stretches = _stretches(truth)
    long = [one for one in stretches if one[0] in GESTURE_NAMES and _can_be_voted(one[2] - one[1], period_ns)]
    first = [next((k for k in range(start, stop) if voted[k] == name), None) for name, start, stop in long]
    recognised = [(one, k) for one, k in zip(long, first, strict=True) if k is not None]
    delay_frames = mean(at - start for (_, start, _), at in recognised)
    return SequenceFigures(
        frames=len(labels),
        frame_accuracy=mean(raw[k] == truth[k] for k in counted),
        voted_accuracy=mean(voted[k] == truth[k] for k in counted),
        shown=len(long),
        recognised=len(recognised),
        broken=sum(any(voted[k] != name for k in range(at, stop)) for (name, _, stop), at in recognised),
        delay_frames=delay_frames,
        delay_ms=None if delay_frames is None else delay_frames * period_ns / 1e6,
        false_onsets=_false_onsets(truth, voted, period_ns),
    )


def _can_be_voted(frames: int, period_ns: int) -> bool:
    """One frame more than a vote needs, at 30 Hz."""
    return have_lasted(frames, VOTE_FRAMES + 1, frames * period_ns)


def _stretches(truth: Sequence[str]) -> list[tuple[str, int, int]]:
    """Runs of one label: name, first frame, first frame after."""
    stretches, start = [], 0
    for name, members in groupby(truth):
        stop = start + len(list(members))
        stretches.append((name, start, stop))
        start = stop
    return stretches


def _false_onsets(truth: Sequence[str], voted: Sequence[str], period_ns: int) -> int:
    """Votes that begin where that gesture is not shown, nor just was, nor is about to be."""
    frames = END_FRAMES + VOTE_FRAMES
    count, reach = 0, max(frames, round(frames * FRAME_NS / period_ns))
    for k, name in enumerate(voted):
        begins = name != NONE and (k == 0 or voted[k - 1] != name)
        around = set(truth[max(0, k - reach) : k + reach + 1])
        count += begins and name not in around
    return count


def verdicts_and_votes(reports: Iterable[Report | None]) -> tuple[list[str | None], list[str]]:
    """Single verdicts and voted gestures, by name; a frame without a report has no verdict and leaves the vote."""
    raw, voted = list[str | None](), list[str]()
    for report in reports:
        if report is None:
            raw.append(None)
            voted.append(voted[-1] if voted else NONE)
        else:
            accepted = report.verdict.gesture if report.verdict else None
            raw.append(accepted.value if accepted else NONE)
            voted.append(report.gesture.value if report.gesture else NONE)
    return raw, voted
