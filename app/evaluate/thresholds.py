"""From which confidence each gesture is accepted: chosen on hands that the model judging them never saw.

Accepting what is none moves a leg nobody asked to move, so that comes first: the price of such an error, for every
kind of undefined hand its own, rises until few enough are accepted; within that, F1 is as good as it can be.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from app.evaluate.digital_near import BETWEEN_LABEL
from app.evaluate.gesture_measures import GESTURE_NAMES
from kgdfa.hand import FloatArray

CANDIDATES = np.arange(0.40, 0.951, 0.02)  # a lead over the next class is asked for besides
MOST_ACCEPTED = 0.008  # of all undefined hands but those halfway; 1 % is promised, this leaves a margin
MOST_ACCEPTED_LOOK_ALIKES = 0.02  # of each of the paper's five
# Hands caught halfway between two poses are made, not photographed, and as many as one likes. Before a camera they
# last a few frames, which the vote refuses as well.
MOST_ACCEPTED_HALFWAY = 0.25
LOOK_ALIKES = ("none:tiger_claw", "none:good", "none:ok", "none:natural_open", "none:gun")
FIRST_PRICE = 0.1  # of a per cent of undefined hands accepted, in per cent of macro-F1
DEARER = 1.25
LAST_ROUND = 30  # the price has risen eight hundredfold: no threshold parts what is still accepted


def choose_thresholds(labels: NDArray[np.str_], chances: FloatArray) -> FloatArray:
    """(12,) thresholds from the labels of n hands and their confidence in each gesture, (n, 12).

    A hand is said to be its most likely gesture, so what one gesture accepts doesn't touch the others' thresholds.
    """
    undefined = ~np.isin(labels, GESTURE_NAMES)
    kinds = np.array(sorted(set(labels[undefined])), dtype=str)
    of_kind = labels == kinds[:, None]
    limits = np.array([_limit(kind) for kind in kinds])
    halfway = kinds == BETWEEN_LABEL
    counted = undefined & (labels != BETWEEN_LABEL)
    prices = np.where(halfway, FIRST_PRICE / 10, FIRST_PRICE)
    for _ in range(LAST_ROUND):
        thresholds = _cheapest(labels, chances, prices @ of_kind / max(int(undefined.sum()), 1))
        wrong = _accepted(chances, thresholds) & undefined
        too_many = (of_kind @ wrong) > limits * of_kind.sum(axis=1)
        if (wrong & counted).sum() > MOST_ACCEPTED * counted.sum():
            too_many |= ~halfway
        if not too_many.any():
            break
        prices = np.where(too_many, prices * DEARER, prices)
    return thresholds


def _limit(kind: str) -> float:
    """The share of a kind that may be accepted."""
    if kind in LOOK_ALIKES:
        return MOST_ACCEPTED_LOOK_ALIKES
    return MOST_ACCEPTED_HALFWAY if kind == BETWEEN_LABEL else 1.0


def _cheapest(labels: NDArray[np.str_], chances: FloatArray, price: FloatArray) -> FloatArray:
    """Each gesture's best threshold when accepting hand k in error costs price[k] of macro-F1."""
    best, sure = chances.argmax(axis=1), chances.max(axis=1)
    thresholds = np.full(len(GESTURE_NAMES), float(CANDIDATES[-1]))
    for place, name in enumerate(GESTURE_NAMES):
        shown = labels == name
        said = (best == place) & (sure >= CANDIDATES[:, None])
        f1 = 2 * (said & shown).sum(axis=1) / np.maximum(said.sum(axis=1) + shown.sum(), 1)
        merit = f1 / len(GESTURE_NAMES) - said @ price
        thresholds[place] = CANDIDATES[int(merit.argmax())]
    return thresholds


def _accepted(chances: FloatArray, thresholds: FloatArray) -> NDArray[np.bool_]:
    accepted: NDArray[np.bool_] = chances.max(axis=1) >= thresholds[chances.argmax(axis=1)]
    return accepted
