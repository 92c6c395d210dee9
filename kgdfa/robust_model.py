"""The fitted part of the `robust` rules: a few small perceptrons over the features, as plain arrays.

`tools/fit_robust.py` fits them and says what it fitted; here they are only evaluated, in numpy alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from kgdfa.errors import KgdfaError
from kgdfa.features import FEATURES
from kgdfa.hand import FloatArray, Gesture

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

    def squash(self, values: FloatArray) -> FloatArray:
        """(n, F) features as they enter the perceptrons."""
        squashed: FloatArray = np.tanh((values - self.centre) / self.spread).astype(self.weights_in.dtype)
        return squashed  # single precision, as the weights are: else those would be copied to be multiplied

    def probabilities(self, values: FloatArray) -> FloatArray:
        """(n, F) features to (n, K): the class probabilities."""
        return self.weigh(self.squash(values))

    def weigh(self, squashed: FloatArray) -> FloatArray:
        """(n, F) squashed features to (n, K)."""
        hidden = squashed @ self.weights_in + self.bias_in
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
