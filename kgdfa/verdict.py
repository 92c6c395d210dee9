"""What a rule set says of one hand, and why."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from kgdfa.hand import FloatArray, Gesture, Hand


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """A gesture or none, with the constraint that decided it.

    confidence: in [0, 1]; of the named gesture, or of the best one where the verdict is none.
    nearest: the gesture that came closest, also when it was refused.
    explanation: one sentence for people, such as "not 4: thumb open, 74° > 53°".
    """

    gesture: Gesture | None
    confidence: float
    nearest: Gesture | None
    explanation: str


class RuleSet(Protocol):
    """A named way to judge a hand: `published` or `robust`."""

    name: str

    def judge(self, hand: Hand) -> Verdict:
        """The verdict on one hand, from its keypoints alone."""
        ...

    def score(self, hand: Hand) -> FloatArray:
        """Confidence in each gesture, (12,) in the order of `Gesture`, each in [0, 1]."""
        ...
