"""Our rule set: the paper's measures, view-independent (`features`), weighed softly (`robust_model`).

A verdict names the constraint that decided it: the group of features (a finger, or tips together) without
which the model would have said otherwise, and in it the measure that lies furthest beyond what the class allows.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kgdfa.features import FEATURES, Group, Unit, features
from kgdfa.hand import FloatArray, Gesture, Hand
from kgdfa.robust_model import GESTURES, RobustModel, load_model
from kgdfa.verdict import Verdict

_GROUP_MASKS = np.array([[feature.group is group for feature in FEATURES] for group in Group])
_DIGITS = {Unit.DEGREES: 0, Unit.PALMS: 2, Unit.SHARE: 2}


class RobustRules:
    """The fitted rules as a RuleSet."""

    name = "robust"

    def __init__(self, model: RobustModel | None = None) -> None:
        """Take a model, or the shipped one. Raises KgdfaError when that can't be read."""
        self._model = model or load_model()

    def score(self, hand: Hand) -> FloatArray:
        """Confidence in each gesture, (12,) in the order of `Gesture`; together with none's they sum to 1."""
        return self.score_looks((hand,))

    def judge(self, hand: Hand) -> Verdict:
        """The most probable gesture if it is sure enough and no other is near, else none."""
        return self.judge_looks((hand,))

    def score_looks(self, hands: Sequence[Hand]) -> FloatArray:
        """The mean of `score` over several looks at one hand."""
        return self.weigh_looks(hands)[1]

    def judge_looks(self, hands: Sequence[Hand]) -> Verdict:
        """The verdict on several looks at one hand, the plain one first: the explanation is about that one."""
        return self.weigh_looks(hands)[0]

    def weigh_looks(self, hands: Sequence[Hand]) -> tuple[Verdict, FloatArray]:
        """Both at once, from one measuring of the hands."""
        values = _features(hands)
        chances = self._model.probabilities(values).mean(axis=0)
        return judge_features(self._model, values[0], chances), chances[: len(GESTURES)]


def _features(hands: Sequence[Hand]) -> FloatArray:
    return np.array([features(hand.image_px, hand.world_m) for hand in hands])


def judge_features(model: RobustModel, values: FloatArray, chances: FloatArray) -> Verdict:
    """The verdict from one look's features, (F,), and the class probabilities, (K,), of all looks at the hand."""
    order = [int(k) for k in np.argsort(chances)[::-1]]
    nearest = next(k for k in order if k < len(GESTURES))
    rival = next(k for k in order if k != nearest)
    sure = float(chances[nearest])
    accepted = sure >= float(model.accept[nearest]) and sure - float(chances[rival]) >= model.tie
    gesture = GESTURES[nearest]
    explain = _explain_accepted if accepted else _explain_refused
    return Verdict(
        gesture=gesture if accepted else None,
        confidence=sure,
        nearest=gesture,
        explanation=explain(model, values, nearest, rival),
    )


def _explain_accepted(model: RobustModel, values: FloatArray, nearest: int, rival: int) -> str:
    """What keeps it from being the rival: the group whose exchange for the rival's costs the most."""
    exchanged = model.probabilities(np.where(_GROUP_MASKS, model.typical[rival], values))
    group = int(np.argmin(exchanged[:, nearest]))
    measure = _furthest(model, values, rival, group)
    names = f"{model.classes[nearest]}, not {_say_class(model.classes[rival])}"
    return f"{names}: {measure}" if measure else names


def _explain_refused(model: RobustModel, values: FloatArray, nearest: int, rival: int) -> str:
    """What keeps it from being accepted: the group whose mending for the gesture's own would win the most."""
    mended = model.probabilities(np.where(_GROUP_MASKS, model.typical[nearest], values))
    group = int(np.argmax(mended[:, nearest]))
    measure = _furthest(model, values, nearest, group)
    if measure:
        return f"not {model.classes[nearest]}: {measure}"
    return f"not {model.classes[nearest]}: too near to {_say_class(model.classes[rival])}"


def _furthest(model: RobustModel, values: FloatArray, kind: int, group: int) -> str:
    """The measure of a group that lies furthest outside a class's range, in words; "" when all lie inside."""
    over, under = values - model.high[kind], model.low[kind] - values
    beyond = np.where(_GROUP_MASKS[group], np.maximum(over, under) / model.spread, -np.inf)
    worst = int(np.argmax(beyond))
    if beyond[worst] <= 0:
        return ""
    feature, above = FEATURES[worst], bool(over[worst] > 0)
    limit = float(model.high[kind, worst] if above else model.low[kind, worst])
    digits = _DIGITS[feature.unit]
    value = float(values[worst])
    return f"{feature.text} {value:.{digits}f}{feature.unit.value} {'>' if above else '<'} {limit:.{digits}f}" + (
        "°" if feature.unit is Unit.DEGREES else ""
    )


def _say_class(name: str) -> str:
    return name if name in {gesture.value for gesture in Gesture} else "none of them"
