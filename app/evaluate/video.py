"""How steadily gestures are told in a sequence of frames: accuracy, gestures held and broken, false onsets."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

from app.evaluate.footage import Footage
from app.evaluate.gesture_measures import NONE
from app.evaluate.sequence import SKIP
from kgdfa.button import ButtonPlace
from kgdfa.gesture import END_FRAMES, VOTE_FRAMES, Gesture, RuleSet
from kgdfa.pipeline import Picture, Pipeline, Report
from kgdfa.preprocess import AsNeeded
from kgdfa.robust_distance import RobustRange

PLACE = ButtonPlace.in_the_middle(1280, 720, threshold_m=0.20)
_NAMES = frozenset(gesture.value for gesture in Gesture)


@dataclass(frozen=True, slots=True, kw_only=True)
class SequenceFigures:
    """What a sequence shows. Frames between gestures (skip) count in nothing but false onsets."""

    frames: int
    frame_accuracy: float  # of single verdicts
    voted_accuracy: float  # of the voted gesture
    shown: int  # stretches of one gesture long enough to be voted
    recognised: int  # of those, how many were voted at all
    broken: int  # recognised, and lost again before the stretch ended
    delay_frames: float  # mean, from a stretch's first frame to its vote
    false_onsets: int  # votes for what neither this stretch nor its neighbours show


def run_sequence(
    footage: Footage, model: Path, rules: RuleSet, tell: Callable[[], None] = lambda: None
) -> list[Report]:
    """The whole chain over labelled footage, at its own rate."""
    from kgdfa.keypoints import live_detector

    finder = RobustRange(focal_px=footage.focal_px, reference_m=footage.reference_m)
    reports = []
    with live_detector(model) as detector:
        pipeline = Pipeline(detector=detector, rules=rules, range_finder=finder, place=PLACE, prepare=AsNeeded())
        for number, image in enumerate(footage.frames(), start=1):
            reports.append(pipeline.process(Picture(image_bgr=image, captured_ns=number * footage.period_ns)))
            tell()
    return reports


def measure_sequence(labels: Sequence[str], raw: Sequence[str], voted: Sequence[str]) -> SequenceFigures:
    """Figures from labels (a gesture, none:<what> or skip), single verdicts and votes, one each a frame."""
    truth = [label if label in _NAMES else SKIP if label == SKIP else NONE for label in labels]
    counted = [k for k, label in enumerate(truth) if label != SKIP]
    stretches = _stretches(truth)
    long = [one for one in stretches if one[0] in _NAMES and one[2] - one[1] > VOTE_FRAMES]
    first = [next((k for k in range(start, stop) if voted[k] == name), None) for name, start, stop in long]
    recognised = [(one, k) for one, k in zip(long, first, strict=True) if k is not None]
    return SequenceFigures(
        frames=len(labels),
        frame_accuracy=_share(raw[k] == truth[k] for k in counted),
        voted_accuracy=_share(voted[k] == truth[k] for k in counted),
        shown=len(long),
        recognised=len(recognised),
        broken=sum(any(voted[k] != name for k in range(at, stop)) for (name, _, stop), at in recognised),
        delay_frames=sum(at - start for (_, start, _), at in recognised) / max(len(recognised), 1),
        false_onsets=_false_onsets(truth, voted),
    )


def _stretches(truth: Sequence[str]) -> list[tuple[str, int, int]]:
    """Runs of one label: name, first frame, first frame after."""
    stretches, start = [], 0
    for name, members in groupby(truth):
        stop = start + len(list(members))
        stretches.append((name, start, stop))
        start = stop
    return stretches


def _false_onsets(truth: Sequence[str], voted: Sequence[str]) -> int:
    """Votes that begin where that gesture is not shown, nor just was, nor is about to be."""
    count, reach = 0, END_FRAMES + VOTE_FRAMES
    for k, name in enumerate(voted):
        begins = name != NONE and (k == 0 or voted[k - 1] != name)
        around = set(truth[max(0, k - reach) : k + reach + 1])
        count += begins and name not in around
    return count


def _share(values: Iterable[bool]) -> float:
    listed = list(values)
    return sum(listed) / max(len(listed), 1)


def said(report: Report) -> tuple[str, str]:
    """A report's own verdict and vote by name."""
    raw = report.verdict.gesture if report.verdict else None
    return (raw.value if raw else NONE, report.gesture.value if report.gesture else NONE)
