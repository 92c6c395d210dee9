"""The `robust` rules: the paper's measures, view-independent (`features`), classified by a few small perceptrons.

`tools/fit_robust.py` fits the model; here it is only evaluated, in numpy alone. A verdict names the constraint that
decided it: the group of features (a finger, or tips together) without which the model would have decided otherwise,
and in it the measure that lies furthest beyond the class's range. What a gesture needs besides: `gesture_needs`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from importlib import resources
from pathlib import Path
from typing import IO, Any

import numpy as np

from kgdfa.errors import KgdfaError, KgdfaFault
from kgdfa.features import FEATURES, Unit, features
from kgdfa.gesture import GESTURE_NAMED, Decision, Explanation, Finger, Gesture, Verdict
from kgdfa.gesture_needs import missing_condition
from kgdfa.hand import FloatArray, Hand
from logs.reading.arrays import check_finite, read_arrays
from logs.reading.errors import cause_of

GESTURES = tuple(Gesture)


class Limit(Enum):
    """How a measure lies outside a class's range, by its unit: `measure`, and its value and limit in that unit."""

    ABOVE_DEGREES = "above degrees"  # value_deg, limit_deg
    BELOW_DEGREES = "below degrees"
    ABOVE_PALMS = "above palms"  # value, limit: in palm lengths
    BELOW_PALMS = "below palms"
    ABOVE_SHARE = "above share"  # value, limit
    BELOW_SHARE = "below share"


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

    def predict_proba(self, normalized: FloatArray) -> FloatArray:
        """(n, F) normalized features to (n, K)."""
        hidden = normalized @ self.weights_in + self.bias_in
        logits = np.maximum(hidden, 0.0, out=hidden) @ self.weights_out + self.bias_out
        powers = np.exp(logits - np.maximum.reduce(logits, axis=1, keepdims=True))
        shares: FloatArray = powers / np.add.reduce(powers, axis=1, keepdims=True)
        return shares


def save_model(model: RobustModel, to: Path | IO[bytes]) -> None:
    """Write it as a compressed npz of single-precision arrays."""
    arrays = {name: getattr(model, name) for name in RobustModel.__slots__ if name not in ("classes", "tie")}
    stored: dict[str, Any] = {name: np.asarray(array, dtype=np.float32) for name, array in arrays.items()}
    stored |= {"classes": np.array(model.classes), "tie": np.array(model.tie)}
    np.savez_compressed(to, **stored)


def load_model(path: Path | None = None) -> RobustModel:
    """The model in a file, or the one that is shipped. Raises KgdfaError when it doesn't fit the features."""
    where = path or Path(str(resources.files("kgdfa") / "robust.npz"))
    try:
        stored = read_arrays(where)
        arrays = {name: stored[name] for name in RobustModel.__slots__}
        classes = tuple(str(name) for name in arrays.pop("classes"))
        tie = float(arrays.pop("tie"))
        check_finite(arrays | {"tie": np.array(tie)})
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise KgdfaError(KgdfaFault.GESTURE_MODEL_UNREADABLE, path=where, detail=cause_of(error)) from error
    wanted = tuple(gesture.value for gesture in GESTURES)
    if classes[: len(wanted)] != wanted or arrays["centre"].shape != (len(FEATURES),):
        raise KgdfaError(KgdfaFault.GESTURE_MODEL_OUTDATED, path=where)
    for name in ("centre", "spread"):  # as precise as the features they meet: numpy needs not convert them each time
        arrays[name] = arrays[name].astype(np.float64)
    return RobustModel(classes=classes, tie=tie, **arrays)


_GROUPS = (*Finger, None)
_GROUP_MASKS = np.array([[feature.group is group for feature in FEATURES] for group in _GROUPS])
_MEMBERS = [np.flatnonzero(mask).tolist() for mask in _GROUP_MASKS]
_EXPLAINED = [feature.explain() for feature in FEATURES]
_LIMITS: dict[Unit, tuple[Limit, Limit, str]] = {
    Unit.DEGREES: (Limit.BELOW_DEGREES, Limit.ABOVE_DEGREES, "_deg"),
    Unit.PALMS: (Limit.BELOW_PALMS, Limit.ABOVE_PALMS, ""),
    Unit.SHARE: (Limit.BELOW_SHARE, Limit.ABOVE_SHARE, ""),
}


class RobustRules:
    """The fitted model as a RuleSet."""

    name = "robust"

    def __init__(self, model: RobustModel | None = None) -> None:
        """Take a model, or the shipped one. Raises KgdfaError when that can't be read."""
        self._model = model or load_model()
        self._explainer = _Explainer(self._model)

    def predict_proba(self, hand: Hand) -> FloatArray:
        """Confidence in each gesture, (12,) in the order of `Gesture`; together with none's they sum to 1."""
        return self.classify_augmented((hand,))[1]

    def classify(self, hand: Hand) -> Verdict:
        """The most probable gesture if it is sure enough and no other is near, else none."""
        return self.classify_augmented((hand,))[0]

    def classify_augmented(self, hands: Sequence[Hand]) -> tuple[Verdict, FloatArray]:
        """The verdict on several augmentations of one hand, and its mean confidences, (12,).

        The first one is the plain hand: the explanation is about it.
        """
        values = np.array([features(hand.image_px, hand.world_m) for hand in hands])
        normalized = self._model.normalize(values)
        probabilities = np.add.reduce(self._model.predict_proba(normalized), axis=0) / len(hands)
        verdict = self._classify(values, normalized[0], probabilities)
        return verdict, probabilities[: len(GESTURES)]

    def _classify(self, values: FloatArray, normalized: FloatArray, probabilities: FloatArray) -> Verdict:
        """The verdict from the features of all augmentations, (n, F), and their mean K class probabilities."""
        nearest = int(probabilities[: len(GESTURES)].argmax())
        others = probabilities.copy()
        others[nearest] = -1.0
        rival = int(others.argmax())
        confidence = float(probabilities[nearest])
        lead = confidence - float(probabilities[rival])
        accepted = confidence >= float(self._model.accept[nearest]) and lead >= self._model.tie
        missing = missing_condition(GESTURES[nearest], values) if accepted else None
        if missing is not None:
            explanation = Explanation(Decision.NOT, {"gesture": GESTURES[nearest], "measure": missing})
        else:
            explain = self._explainer.accepted if accepted else self._explainer.refused
            explanation = explain(values[0], normalized, nearest, rival)
        return Verdict(
            gesture=GESTURES[nearest] if accepted and missing is None else None,
            confidence=confidence,
            explanation=explanation,
        )


class _Explainer:
    """Finds the constraint that decided; `values` and `normalized` are one hand's features, (F,)."""

    def __init__(self, model: RobustModel) -> None:
        self._model = model
        self._typical = model.normalize(model.typical)
        self._low, self._high, self._spread = model.low.tolist(), model.high.tolist(), model.spread.tolist()
        self._classes = [GESTURE_NAMED.get(name, Decision.NO_GESTURE) for name in model.classes]

    def accepted(self, values: FloatArray, normalized: FloatArray, nearest: int, rival: int) -> Explanation:
        """What keeps it from being the rival: the group whose exchange for the rival's costs the most."""
        group = int(self._exchanged(normalized, rival)[:, nearest].argmin())
        measure = self._furthest(values, rival, group)
        classes = {"gesture": self._classes[nearest], "rival": self._classes[rival]}
        if measure is None:
            return Explanation(Decision.OVER, classes)
        return Explanation(Decision.OVER_BY, classes | {"measure": measure})

    def refused(self, values: FloatArray, normalized: FloatArray, nearest: int, rival: int) -> Explanation:
        """What keeps it from being accepted: the group whose exchange for the gesture's own would win the most."""
        group = int(self._exchanged(normalized, nearest)[:, nearest].argmax())
        measure = self._furthest(values, nearest, group)
        measure = measure or Explanation(Decision.TOO_SIMILAR, {"rival": self._classes[rival]})
        return Explanation(Decision.NOT, {"gesture": self._classes[nearest], "measure": measure})

    def _exchanged(self, normalized: FloatArray, kind: int) -> FloatArray:
        """The class probabilities, (groups, K), when one group at a time is as is typical of a class."""
        return self._model.predict_proba(np.where(_GROUP_MASKS, self._typical[kind], normalized))

    def _furthest(self, values: FloatArray, kind: int, group: int) -> Explanation | None:
        """The measure of a group that lies furthest outside a class's range; None when all lie inside."""
        low, high, spread, measured = self._low[kind], self._high[kind], self._spread, values.tolist()
        beyond = {k: max(measured[k] - high[k], low[k] - measured[k]) / spread[k] for k in _MEMBERS[group]}
        worst = max(beyond, key=beyond.__getitem__)
        if not 0 < beyond[worst] < math.inf:
            return None
        above = measured[worst] > high[worst]
        *codes, unit = _LIMITS[FEATURES[worst].unit]
        limit = high[worst] if above else low[worst]
        return Explanation(
            codes[above],
            {"measure": _EXPLAINED[worst], f"value{unit}": measured[worst], f"limit{unit}": limit},
        )
