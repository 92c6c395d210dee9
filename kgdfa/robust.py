"""The fitted part of the `robust` rules: a few small perceptrons over the features, as plain arrays.

`tools/fit_robust.py` fits them and says what it fitted; here they are only evaluated, in numpy alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from kgdfa.errors import KgdfaError
from kgdfa.features import FEATURES, Feature, Group, Unit, features
from kgdfa.gesture import Gesture, Verdict
from kgdfa.hand import FloatArray, Hand

GESTURES = tuple(Gesture)


@dataclass(frozen=True, slots=True, kw_only=True)
class RobustModel:
    """M perceptrons of one hidden layer with H units on F features, voting on K classes.

    They vote by the mean of their log-odds, so side by side they are one perceptron of M x H units.

    classes: K names; the twelve gestures first, in the order of `Gesture`, then kinds of "none".
    centre, spread: (F,) of the training hands; a feature enters as tanh((value - centre) / spread).
    weights_in (F, M x H), bias_in (M x H,), weights_out (M x H, K), bias_out (K,).
    accept: (12,) confidence from which a gesture is accepted. tie: least lead over the next gesture.
    typical (K, F): each class's median hand. low, high (K, F): between them lie 94 % of its hands.
    """

    classes: tuple[str, ...]
    centre: FloatArray
    spread: FloatArray
    weights_in: FloatArray
    bias_in: FloatArray
    weights_out: FloatArray
    bias_out: FloatArray
    accept: FloatArray
    tie: float
    typical: FloatArray
    low: FloatArray
    high: FloatArray

    def normalize(self, values: FloatArray) -> FloatArray:
        """(n, F) features as they enter the perceptrons."""
        normalized: FloatArray = np.tanh((values - self.centre) / self.spread).astype(self.weights_in.dtype)
        return normalized  # single precision, as the weights are: else those would be copied to be multiplied

    def probabilities(self, values: FloatArray) -> FloatArray:
        """(n, F) features to (n, K): the class probabilities."""
        return self.predict_proba(self.normalize(values))

    def predict_proba(self, normalized: FloatArray) -> FloatArray:
        """(n, F) squashed features to (n, K)."""
        hidden = normalized @ self.weights_in + self.bias_in
        logits = np.maximum(hidden, 0.0, out=hidden) @ self.weights_out + self.bias_out
        powers = np.exp(logits - np.maximum.reduce(logits, axis=1, keepdims=True))
        shares: FloatArray = powers / np.add.reduce(powers, axis=1, keepdims=True)
        return shares


def save_model(model: RobustModel, path: Path) -> None:
    """Write it as a compressed npz of single-precision arrays."""
    arrays = {name: getattr(model, name) for name in RobustModel.__slots__ if name not in ("classes", "tie")}
    stored: dict[str, Any] = {name: np.asarray(array, dtype=np.float32) for name, array in arrays.items()}
    stored |= {"classes": np.array(model.classes), "tie": np.array(model.tie)}
    np.savez_compressed(path, **stored)


def load_model(path: Path | None = None) -> RobustModel:
    """The model in a file, or the one that is shipped. Raises KgdfaError when it doesn't fit the features."""
    where = path or Path(str(resources.files("kgdfa") / "robust.npz"))
    try:
        with np.load(where, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in RobustModel.__slots__}
    except (OSError, ValueError, KeyError) as error:
        raise KgdfaError(f"The gesture model {where} can't be read ({error}): fit it again.") from error
    classes = tuple(str(name) for name in arrays.pop("classes"))
    tie = float(arrays.pop("tie"))
    wanted = tuple(gesture.value for gesture in GESTURES)
    if classes[: len(wanted)] != wanted or arrays["centre"].shape != (len(FEATURES),):
        raise KgdfaError(f"The gesture model {where} was fitted for other gestures or features: fit it again.")
    for name in ("centre", "spread"):  # as precise as the features they meet: numpy needs not convert them each time
        arrays[name] = arrays[name].astype(np.float64)
    return RobustModel(classes=classes, tie=tie, **arrays)


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

    def predict_proba(self, hand: Hand) -> FloatArray:
        """Confidence in each gesture, (12,) in the order of `Gesture`; together with none's they sum to 1."""
        return self.score_looks((hand,))

    def classify(self, hand: Hand) -> Verdict:
        """The most probable gesture if it is sure enough and no other is near, else none."""
        return self.judge_looks((hand,))

    def score_looks(self, hands: Sequence[Hand]) -> FloatArray:
        """The mean of `predict_proba` over several looks at one hand."""
        return self.classify_augmented(hands)[1]

    def judge_looks(self, hands: Sequence[Hand]) -> Verdict:
        """The verdict on several looks at one hand, the plain one first: the explanation is about that one."""
        return self.classify_augmented(hands)[0]

    def classify_augmented(self, hands: Sequence[Hand]) -> tuple[Verdict, FloatArray]:
        """Both at once, from one measuring of the hands."""
        values = np.array([features(hand.image_px, hand.world_m) for hand in hands])
        normalized = self._model.normalize(values)
        chances = np.add.reduce(self._model.predict_proba(normalized), axis=0) / len(hands)
        return self._classify(values[0], normalized[0], chances.tolist()), chances[: len(GESTURES)]

    def _classify(self, values: FloatArray, normalized: FloatArray, chances: list[float]) -> Verdict:
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
            explanation=explain(values, normalized, nearest, rival),
        )


class _Explainer:
    """Says which constraint decided; `values` and `normalized` are one look's features, (F,)."""

    def __init__(self, model: RobustModel) -> None:
        self._model = model
        self._typical = model.normalize(model.typical)
        self._low, self._high, self._spread = model.low.tolist(), model.high.tolist(), model.spread.tolist()

    def accepted(self, values: FloatArray, normalized: FloatArray, nearest: int, rival: int) -> str:
        """What keeps it from being the rival: the group whose exchange for the rival's costs the most."""
        group = int(self._exchanged(normalized, rival)[:, nearest].argmin())
        measure = self._furthest(values, rival, group)
        names = f"{self._model.classes[nearest]}, not {self._say_class(rival)}"
        return f"{names}: {measure}" if measure else names

    def refused(self, values: FloatArray, normalized: FloatArray, nearest: int, rival: int) -> str:
        """What keeps it from being accepted: the group whose mending for the gesture's own would win the most."""
        group = int(self._exchanged(normalized, nearest)[:, nearest].argmax())
        measure = self._furthest(values, nearest, group) or f"too near to {self._say_class(rival)}"
        return f"not {self._model.classes[nearest]}: {measure}"

    def _exchanged(self, normalized: FloatArray, kind: int) -> FloatArray:
        """The class probabilities, (groups, K), when one group at a time is as is typical of a class."""
        return self._model.predict_proba(np.where(_GROUP_MASKS, self._typical[kind], normalized))

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
