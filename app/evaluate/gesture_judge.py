"""Rule sets at work on looked-at photos."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from app.evaluate.gesture_measures import GESTURE_NAMES, Judged
from app.evaluate.gesture_photos import SeenPhoto
from kgdfa.gesture import Verdict
from kgdfa.hand import FloatArray, Hand
from kgdfa.published import PublishedRules
from kgdfa.robust import RobustRules


class PhotoJudge(Protocol):
    """Judges one photo from the hands that its looks found, at least one, the plain look's first."""

    name: str

    def judge(self, hands: Sequence[Hand]) -> tuple[Verdict, FloatArray]:
        """The verdict, and the confidence in each gesture, (12,)."""
        ...


class PublishedJudge:
    """The paper's rules on the plain look alone: they know no confidence that could be averaged."""

    name = PublishedRules.name

    def __init__(self) -> None:
        self._rules = PublishedRules()

    def judge(self, hands: Sequence[Hand]) -> tuple[Verdict, FloatArray]:
        """Table 2 on the first hand."""
        return self._rules.classify(hands[0]), self._rules.predict_proba(hands[0])


class RobustJudge:
    """Our rules on all looks, their confidence averaged."""

    name = RobustRules.name

    def __init__(self, rules: RobustRules | None = None, *, looks: int | None = None) -> None:
        self._rules = rules or RobustRules()
        self._looks = looks

    def judge(self, hands: Sequence[Hand]) -> tuple[Verdict, FloatArray]:
        """The mean over the looks (the first `looks`, if said)."""
        return self._rules.classify_augmented(hands[: self._looks])


def judge_all(seen: Sequence[SeenPhoto], judge: PhotoJudge) -> list[Judged]:
    """Every photo judged; one without a hand is none, with no confidence in anything."""
    return [judge_photo(one, judge) for one in seen]


def judge_photo(one: SeenPhoto, judge: PhotoJudge) -> Judged:
    """One photo judged."""
    if not one.hands:
        return Judged(photo=one.photo, detected=False, verdict=None, scores=np.zeros(len(GESTURE_NAMES)))
    verdict, scores = judge.judge(one.hands)
    return Judged(photo=one.photo, detected=True, verdict=verdict, scores=scores)
