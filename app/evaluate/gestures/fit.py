"""Fits the `robust` rules: perceptrons on real and synthetic hands, thresholds by folds within."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from app.evaluate.digital import SOURCE as DIGITAL
from app.evaluate.gestures.folds import ViewSet, inner_folds
from app.evaluate.gestures.simulated import SimulatedHands
from app.evaluate.gestures.synthetic import HandSynthesizer
from app.evaluate.gestures.thresholds import choose_thresholds
from app.evaluate.harness import require_extra
from app.evaluate.readings import GESTURE_NAMES, NO_HAND
from kgdfa.gesture_needs import missing_condition
from kgdfa.hand import FloatArray, Side
from kgdfa.robust import GESTURES, RobustModel

if TYPE_CHECKING:
    from sklearn.neural_network import MLPClassifier

MEMBERS = 8  # figures of three swung from one draw of examples to the next
THRESHOLD_MEMBERS = 3  # in the fits that only choose thresholds: they are many, and sources differ more than draws do
HIDDEN = 64
EPOCHS = 12
PENALTY = 0.03  # L2
DROPOUT = 0.1  # share of features blanked: no verdict shall hang on one of them
SIMULATED_HANDS = 16_000  # that one member sees, each drawn by itself; weight 1 each, as the mean real view's
# More for the one in ten that shows a gesture: unweighted, the others taught that a hand with errors is none, and
# enrolment refused gestures 2, love and rock.
SIMULATED_GESTURE_WEIGHT = 5.0
WRONG_LABELS = 0.05  # share of examples given a label drawn at random: some labels are noise, and none shall be certain
# Each member sees every second view, and synthetic hands of its own: together they see more than one that sees all.
VIEW_STEP = 2
SYNTHETIC_SHARE = 1 / 4
SYNTHETIC_WEIGHT = 2.0  # of one synthetic hand, the mean real view's being 1
LABEL_WEIGHT = {"none:natural_open": 3.0}  # of one view, the mean being 1: few show one, and 5 walks
TIE = 0.10  # lead over the next class below which it is a tie, and none
RANGE_PERCENT = (3.0, 97.0)


def fit(
    views: ViewSet,
    among: NDArray[np.bool_],
    simulated: SimulatedHands,
    progress: Callable[[str], None] = lambda _: None,
    *,
    seed: int = 0,
) -> RobustModel:
    """Fit on some images: first the thresholds, by inner folds of these images alone, then the members.

    progress gets the name of each inner fold, and "" for the final fit. Another seed draws other examples, synthetic
    hands and noise: how far figures differ then is chance.
    """
    require_extra("evaluate", "sklearn", "threadpoolctl")
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1):  # small matrices: on a busy machine threads wait for each other forty times as long
        classified = _inner_chances(views, among, simulated, progress, seed)
        progress("")
        model = _fit_members(views, among, simulated, MEMBERS, seed)
    return replace(model, accept=choose_thresholds(*classified))


def image_probabilities(model: RobustModel, views: ViewSet, of: NDArray[np.bool_]) -> FloatArray:
    """The class probabilities of each image, the mean over its views, (images, K); 0 where no hand was found."""
    rows = np.flatnonzero(of[views.owner])
    sums = np.zeros((len(views.images), len(model.classes)))
    np.add.at(sums, views.owner[rows], model.predict_proba(model.normalize(views.values[rows])) if len(rows) else 0.0)
    counts = np.bincount(views.owner[rows], minlength=len(views.images))
    means: FloatArray = sums / np.maximum(counts, 1)[:, None]
    return means


def _inner_chances(
    views: ViewSet,
    among: NDArray[np.bool_],
    simulated: SimulatedHands,
    progress: Callable[[str], None],
    seed: int,
) -> tuple[NDArray[np.str_], FloatArray, FloatArray, NDArray[np.bool_]]:
    """Labels, chances and weights of these images and digital hands, each classified without its source, and which
    are photos.

    Of those that one source alone shows a third is classified, and weighs three times. What the rules refuse whatever
    the perceptrons say has no chance.
    """
    chances = np.zeros((len(views.images), len(GESTURE_NAMES)))
    classified = np.zeros(len(views.images), dtype=bool)
    for fold in inner_folds(views, among):
        progress(fold.name)
        model = _fit_members(views, fold.fit, simulated, THRESHOLD_MEMBERS, seed)
        chances += image_probabilities(model, views, fold.measure)[:, : len(GESTURE_NAMES)]
        classified |= fold.measure
    chances[_lacking(views, chances)] = 0.0
    pairs = list(zip(views.labels, views.sources, strict=True))
    given, counted = (Counter(pairs[k] for k in np.flatnonzero(some)) for some in (among, classified))
    weights = np.array([given[pairs[k]] / counted[pairs[k]] for k in np.flatnonzero(classified)])
    return views.labels[classified], chances[classified], weights, views.sources[classified] != DIGITAL


def _lacking(views: ViewSet, chances: FloatArray) -> list[int]:
    """The images whose nearest gesture lacks what it needs."""
    views_of = np.split(views.values, np.searchsorted(views.owner, np.arange(1, len(views.images))))
    nearest = [GESTURES[number] for number in chances.argmax(axis=1)]
    found = zip(nearest, views_of, chances.max(axis=1), strict=True)
    return [k for k, (gesture, some, chance) in enumerate(found) if chance > 0 and missing_condition(gesture, some)]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Examples:
    """What one member is fitted on: features (n, F), labels (n,) and weights (n,)."""

    values: FloatArray
    labels: NDArray[np.str_]
    weights: FloatArray


def _fit_members(
    views: ViewSet, among: NDArray[np.bool_], simulated: SimulatedHands, members: int, seed: int
) -> RobustModel:
    seeds = [seed * MEMBERS + k for k in range(members)]
    drawn = [_examples(views, among, simulated, one) for one in seeds]
    labels = np.concatenate([one.labels for one in drawn])
    classes = [*GESTURE_NAMES, *sorted(set(labels) - set(GESTURE_NAMES))]
    centre = np.median(drawn[0].values, axis=0)
    spread = np.subtract(*np.percentile(drawn[0].values, [85, 15], axis=0)) + 1e-6
    fitted = [_member(one, classes, (centre, spread), member) for one, member in zip(drawn, seeds, strict=True)]
    values = np.vstack([one.values for one in drawn])
    ranges = [np.percentile(values[labels == name], [*RANGE_PERCENT, 50], axis=0) for name in classes]
    return RobustModel(
        classes=tuple(classes),
        centre=centre,
        spread=spread,
        weights_in=np.hstack([net.coefs_[0] for net in fitted]),
        bias_in=np.hstack([net.intercepts_[0] for net in fitted]),
        weights_out=np.vstack([net.coefs_[1] for net in fitted]) / members,
        bias_out=np.mean([net.intercepts_[1] for net in fitted], axis=0),
        accept=np.full(len(GESTURE_NAMES), 0.5),
        tie=TIE,
        typical=np.array([one[2] for one in ranges]),
        low=np.array([one[0] for one in ranges]),
        high=np.array([one[1] for one in ranges]),
    )


def _examples(views: ViewSet, among: NDArray[np.bool_], simulated: SimulatedHands, seed: int) -> _Examples:
    """Every second view of these images, synthetic hands made from them, and simulated hands.

    Rare pairs of label and source weigh more a view, by the root of their number; `LABEL_WEIGHT` comes on top.
    """
    shows_hand = views.labels != NO_HAND
    rows = np.flatnonzero((among & shows_hand)[views.owner])[seed % VIEW_STEP :: VIEW_STEP]
    owners = views.owner[rows]
    labels = views.labels[owners]
    pairs = list(zip(labels, views.sources[owners], strict=True))
    often = Counter(pairs)
    weights = np.array([often[pair] ** -0.5 for pair in pairs])
    weights /= weights.mean()
    weights *= [LABEL_WEIGHT.get(label, 1.0) for label in labels]
    made, made_labels = _synthetic(views, np.unique(owners), seed)
    drawn = np.random.default_rng(seed).permutation(len(simulated.labels))[:SIMULATED_HANDS]
    return _Examples(
        values=np.vstack([views.values[rows], made, simulated.values[drawn]]),
        labels=np.concatenate([labels, made_labels, simulated.labels[drawn]]),
        weights=np.concatenate(
            [weights, np.full(len(made), SYNTHETIC_WEIGHT), _simulated_weights(simulated.labels[drawn])]
        ),
    )


def _simulated_weights(labels: NDArray[np.str_]) -> FloatArray:
    return np.where(np.isin(labels, GESTURE_NAMES), SIMULATED_GESTURE_WEIGHT, 1.0)


def _synthetic(views: ViewSet, owners: NDArray[np.int64], seed: int) -> tuple[FloatArray, list[str]]:
    hands = [views.images[owner].hands[0] for owner in owners]
    synthesizer = HandSynthesizer(
        np.array([hand.world_m for hand in hands]),
        np.array([hand.side is Side.RIGHT for hand in hands]),
        views.labels[owners].tolist(),
        seed,
    )
    return synthesizer.make(SYNTHETIC_SHARE)


def _member(
    examples: _Examples, classes: list[str], normalisation: tuple[FloatArray, FloatArray], seed: int
) -> MLPClassifier:
    """One perceptron, on examples drawn anew by their weights, with features blanked at random."""
    centre, spread = normalisation
    normalized = np.tanh((examples.values - centre) / spread).astype(
        np.float32
    )  # as the model is stored; twice as fast
    labels, weights = examples.labels, examples.weights
    random = np.random.default_rng(seed)
    drawn = random.choice(len(labels), len(labels), p=weights / weights.sum())
    observed = normalized[drawn] * (random.random(normalized.shape) >= DROPOUT)
    wanted = np.array([classes.index(label) for label in labels[drawn]])
    noisy = random.random(len(wanted)) < WRONG_LABELS
    wanted[noisy] = random.integers(len(classes), size=int(noisy.sum()))
    missing = sorted(set(range(len(classes))) - set(wanted))
    if missing:  # a class so rare that it was never drawn: show it once
        first = [int(np.flatnonzero(labels == classes[k])[0]) for k in missing]
        observed, wanted = np.vstack([observed, normalized[first]]), np.concatenate([wanted, missing])
    from sklearn.neural_network import MLPClassifier

    net = MLPClassifier((HIDDEN,), alpha=PENALTY, max_iter=EPOCHS, batch_size=256, random_state=seed)
    net.n_iter_no_change = EPOCHS
    _fit_quietly(net, observed, wanted)
    return net


def _fit_quietly(net: MLPClassifier, observed: NDArray[np.float32], wanted: NDArray[np.int64]) -> None:
    """The number of epochs is fixed: sklearn warns of it."""
    import warnings

    from sklearn.exceptions import ConvergenceWarning

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        net.fit(observed, wanted)
