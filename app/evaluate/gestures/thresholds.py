"""Each gesture's threshold, from hands that were classified by models which had not seen their source."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from app.evaluate.gestures.synthetic import BETWEEN_LABEL
from app.evaluate.readings import GESTURE_NAMES
from kgdfa.hand import FloatArray

# Thresholds: accepting what is none moves a leg nobody asked to move, so that comes first: the price of such an error,
# one for every kind of undefined hand, rises until few enough are accepted; within that, F1 is as high as can be.
CANDIDATES = np.arange(0.40, 0.951, 0.02)  # a lead over the next class is required as well
MOST_ACCEPTED = 0.010  # of all undefined hands but those halfway; of sources left out a third of that are accepted
# Of each of the paper's five. Of the hands that are naturally open, digital ones for the most part, the straightest are
# nearly a 5: at 2 % of them a quarter of the fives of new people was refused.
MOST_ACCEPTED_LOOK_ALIKES = {
    "none:tiger_claw": 0.02,
    "none:good": 0.02,
    "none:ok": 0.02,
    "none:natural_open": 0.05,
    "none:gun": 0.02,
}
# Hands caught halfway between two poses are synthetic, and as many as one likes, so they count in no F1. Before a
# camera they last a few frames, which the vote refuses as well.
MOST_ACCEPTED_HALFWAY = 0.40
# F1 of a gesture, less than its standard error. The models that choose saw fewer sources than the one to be shipped, so
# what they confuse at a lower threshold says little; which undefined hands they accept there always counts.
AS_GOOD = 0.01
# Log-odds: undefined hands of people and cameras never seen may look that much more like a gesture than those in
# photos. Digital people are drawn from one distribution, those that fit and those that measure, and need none.
MARGIN = 0.4
FIRST_PRICE = 0.1  # of a per cent of undefined hands accepted, in per cent of macro-F1
FIRST_HALFWAY = FIRST_PRICE / 10  # and of those halfway once too many are accepted; until then they are free
DEARER = 1.25
LAST_ROUND = 30  # the price has risen eight hundredfold: no threshold parts what is still accepted


def choose_thresholds(
    labels: NDArray[np.str_],
    chances: FloatArray,
    weights: FloatArray | None = None,
    photos: NDArray[np.bool_] | None = None,
) -> FloatArray:
    """(12,) thresholds from the labels of n hands, their confidence in each gesture, (n, 12), and how many hands each
    one counts for in F1, (n,), one if None. photos: which are of people of whom there are few, (n,), all if None.

    A hand is classified as its most likely gesture, so what one gesture accepts doesn't touch the others' thresholds.
    """
    weights = np.where(labels == BETWEEN_LABEL, 0.0, 1.0 if weights is None else weights)
    undefined = ~np.isin(labels, GESTURE_NAMES)
    kinds = np.array(sorted(set(labels[undefined])), dtype=str)
    doubted = undefined if photos is None else undefined & photos
    chances = np.where(doubted[:, None], _surer(chances), chances)
    of_kind = labels == kinds[:, None]
    limits = np.array([_limit(kind) for kind in kinds])
    halfway = kinds == BETWEEN_LABEL
    counted = undefined & (labels != BETWEEN_LABEL)
    prices = np.where(halfway, 0.0, FIRST_PRICE)
    for _ in range(LAST_ROUND):
        thresholds = _cheapest(labels, chances, weights, prices @ of_kind / max(int(undefined.sum()), 1))
        wrong = _accepted(chances, thresholds) & undefined
        too_many = (of_kind & wrong).sum(axis=1) > limits * of_kind.sum(axis=1)
        if (wrong & counted).sum() > MOST_ACCEPTED * counted.sum():
            too_many |= ~halfway
        if not too_many.any():
            break
        prices = np.where(too_many, np.maximum(prices, FIRST_HALFWAY) * DEARER, prices)
    return thresholds


def _surer(chances: FloatArray) -> FloatArray:
    """Chances with `MARGIN` more of log-odds."""
    more = chances * np.exp(MARGIN)
    surer: FloatArray = more / (more + 1 - chances)
    return surer


def _limit(kind: str) -> float:
    """The share of a kind that may be accepted."""
    return MOST_ACCEPTED_HALFWAY if kind == BETWEEN_LABEL else MOST_ACCEPTED_LOOK_ALIKES.get(kind, 1.0)


def _cheapest(labels: NDArray[np.str_], chances: FloatArray, weights: FloatArray, price: FloatArray) -> FloatArray:
    """Each gesture's best threshold when accepting hand k in error costs price[k] of macro-F1.

    Of those that lose no more than `AS_GOOD` of F1 and pay no more than the best, it is the lowest.
    """
    best, sure = chances.argmax(axis=1), chances.max(axis=1)
    thresholds = np.full(len(GESTURE_NAMES), float(CANDIDATES[-1]))
    for place, name in enumerate(GESTURE_NAMES):
        shown = labels == name
        predicted = (best == place) & (sure >= CANDIDATES[:, None])
        f1 = 2 * (predicted & shown) @ weights / np.maximum(predicted @ weights + shown @ weights, 1)
        paid = predicted @ price
        chosen = int((f1 / len(GESTURE_NAMES) - paid).argmax())
        as_good = (f1 >= f1[chosen] - AS_GOOD) & (paid <= paid[chosen])
        thresholds[place] = CANDIDATES[int(as_good.argmax())]
    return thresholds


def _accepted(chances: FloatArray, thresholds: FloatArray) -> NDArray[np.bool_]:
    accepted: NDArray[np.bool_] = chances.max(axis=1) >= thresholds[chances.argmax(axis=1)]
    return accepted
