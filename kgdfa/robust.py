"""Our rule set: the paper's measures, view-independent (`features`), weighed softly (`robust_model`).

A verdict names the constraint that decided it: the group of features (a finger, or tips together) without
which the model would have said otherwise, and in it the measure that lies furthest beyond what the class allows.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kgdfa.features import FEATURES, Feature, Group, Unit, features
from kgdfa.hand import FloatArray, Gesture, Hand
from kgdfa.robust_model import GESTURES, RobustModel, load_model
from kgdfa.verdict import Verdict

_GROUP_MASKS = np.array([[feature.group is group for feature in FEATURES] for group in Group])
_MEMBERS = [np.flatnonzero(mask).tolist() for mask in _GROUP_MASKS]
_DIGITS = {Unit.DEGREES: 0, Unit.PALMS: 2, Unit.SHARE: 2}
_NAMES = frozenset(gesture.value for gesture in Gesture)


class RobustRules:
    """The fitted rules as a RuleSet."""

    name = "robust"

    def __init__(self, model: RobustModel | None = None) -> None:
        """Take a model, or the shipped one. Raises KgdfaError when that can't be read."""
        self._model = model or load_model()
        self._explainer = _Explainer(self._model)

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
        values = np.array([features(hand.image_px, hand.world_m) for hand in hands])
        squashed = self._model.squash(values)
        chances = np.add.reduce(self._model.weigh(squashed), axis=0) / len(hands)
        return self._judge(values[0], squashed[0], chances.tolist()), chances[: len(GESTURES)]

    def _judge(self, values: FloatArray, squashed: FloatArray, chances: list[float]) -> Verdict:
        """The verdict from one look's features, (F,), and the class probabilities, K, of all looks at the hand."""
        nearest = max(range(len(GESTURES)), key=chances.__getitem__)
        sure = chances[nearest]
        rival = max((k for k in range(len(chances)) if k != nearest), key=chances.__getitem__)
        accepted = sure >= float(self._model.accept[nearest]) and sure - chances[rival] >= self._model.tie
        gesture = GESTURES[nearest]
        explain = self._explainer.accepted if accepted else self._explainer.refused
        return Verdict(
            gesture=gesture if accepted else None,
            confidence=sure,
            nearest=gesture,
            explanation=explain(values, squashed, nearest, rival),
        )


class _Explainer:
    """Says which constraint decided; `values` and `squashed` are one look's features, (F,)."""

    def __init__(self, model: RobustModel) -> None:
        self._model = model
        self._typical = model.squash(model.typical)
        self._low, self._high, self._spread = model.low.tolist(), model.high.tolist(), model.spread.tolist()

    def accepted(self, values: FloatArray, squashed: FloatArray, nearest: int, rival: int) -> str:
        """What keeps it from being the rival: the group whose exchange for the rival's costs the most."""
        group = int(self._exchanged(squashed, rival)[:, nearest].argmin())
        measure = self._furthest(values, rival, group)
        names = f"{self._model.classes[nearest]}, not {self._say_class(rival)}"
        return f"{names}: {measure}" if measure else names

    def refused(self, values: FloatArray, squashed: FloatArray, nearest: int, rival: int) -> str:
        """What keeps it from being accepted: the group whose mending for the gesture's own would win the most."""
        group = int(self._exchanged(squashed, nearest)[:, nearest].argmax())
        measure = self._furthest(values, nearest, group) or f"too near to {self._say_class(rival)}"
        return f"not {self._model.classes[nearest]}: {measure}"

    def _exchanged(self, squashed: FloatArray, kind: int) -> FloatArray:
        """The class probabilities, (groups, K), when one group at a time is as is typical of a class."""
        return self._model.weigh(np.where(_GROUP_MASKS, self._typical[kind], squashed))

    def _furthest(self, values: FloatArray, kind: int, group: int) -> str:
        """The measure of a group that lies furthest outside a class's range, in words; "" when all lie inside."""
        low, high, spread, measured = self._low[kind], self._high[kind], self._spread, values.tolist()
        beyond = {k: max(measured[k] - high[k], low[k] - measured[k]) / spread[k] for k in _MEMBERS[group]}
        worst = max(beyond, key=beyond.__getitem__)
        if beyond[worst] <= 0:
            return ""
        above = measured[worst] > high[worst]
        return _say_beyond(FEATURES[worst], measured[worst], high[worst] if above else low[worst], above=above)

    def _say_class(self, kind: int) -> str:
        name = self._model.classes[kind]
        return name if name in _NAMES else "none of them"


def _say_beyond(feature: Feature, value: float, limit: float, *, above: bool) -> str:
    digits, degrees = _DIGITS[feature.unit], "°" if feature.unit is Unit.DEGREES else ""
    said = f"{value:.{digits}f}{feature.unit.value}"
    return f"{feature.text} {said} {'>' if above else '<'} {limit:.{digits}f}{degrees}"
