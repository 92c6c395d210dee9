"""Fits the `robust` rules: perceptrons over the features of real and synthetic hands, thresholds by cross-validation.

Folds leave a whole source of images out; of gestures that only one source shows, a contiguous third of it
(images taken one after another resemble each other), so that no image serves both fitting and measuring.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from app.evaluate.digital import SOURCE as DIGITAL
from app.evaluate.gestures.synthetic import BETWEEN_LABEL, HandSynthesizer
from app.evaluate.harness import require_extra
from app.evaluate.readings import GESTURE_NAMES, NO_HAND, DetectedImage
from kgdfa.features import features
from kgdfa.hand import FloatArray, Side
from kgdfa.robust import RobustModel

if TYPE_CHECKING:
    from sklearn.neural_network import MLPClassifier

MEMBERS = 8  # figures of three swung from one draw of examples to the next
THRESHOLD_MEMBERS = 4  # in the fits that only choose thresholds: they are many, and sources differ more than draws do
HIDDEN = 64
EPOCHS = 12
PENALTY = 0.03  # L2
DROPOUT = 0.1  # share of features blanked: no verdict shall hang on one of them
WRONG_LABELS = 0.05  # share of examples given a label drawn at random: some labels are noise, and none shall be certain
# Each member sees every second view, and synthetic hands of its own: together they see more than one that sees all.
VIEW_STEP = 2
SYNTHETIC_SHARE = 1 / 4
SYNTHETIC_WEIGHT = 2.0  # of one synthetic hand, the mean real view's being 1
THIRDS = 3
LABEL_WEIGHT = {"none:natural_open": 3.0}  # of one view, the mean being 1: few show one, and 5 walks
TIE = 0.10  # lead over the next class below which it is a tie, and none
RANGE_PERCENT = (3.0, 97.0)

# Thresholds: accepting what is none moves a leg nobody asked to move, so that comes first: the price of such an error,
# one for every kind of undefined hand, rises until few enough are accepted; within that, F1 is as high as can be.
CANDIDATES = np.arange(0.40, 0.951, 0.02)  # a lead over the next class is required as well
MOST_ACCEPTED = 0.008  # of all undefined hands but those halfway; 1 % is promised, this leaves a margin
MOST_ACCEPTED_LOOK_ALIKES = 0.02  # of each of the paper's five
# Hands caught halfway between two poses are synthetic, and as many as one likes. Before a camera they
# last a few frames, which the vote refuses as well.
MOST_ACCEPTED_HALFWAY = 0.25
LOOK_ALIKES = ("none:tiger_claw", "none:good", "none:ok", "none:natural_open", "none:gun")
# F1 of a gesture, less than its standard error. The models that choose saw fewer sources than the one to be shipped, so
# what they confuse at a lower threshold says little; which undefined hands they accept there always counts.
AS_GOOD = 0.01
MARGIN = 0.4  # log-odds: undefined hands of people and cameras never seen may look that much more like a gesture
FIRST_PRICE = 0.1  # of a per cent of undefined hands accepted, in per cent of macro-F1
DEARER = 1.25
LAST_ROUND = 30  # the price has risen eight hundredfold: no threshold parts what is still accepted


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewSet:
    """Images as the fit sees them. values (n, F): features of every view; owner (n,): its image's place."""

    images: tuple[DetectedImage, ...]
    values: FloatArray
    owner: NDArray[np.int64]

    @property
    def labels(self) -> NDArray[np.str_]:
        """(images,) labels."""
        return np.array([one.image.label for one in self.images])

    @property
    def sources(self) -> NDArray[np.str_]:
        """(images,) sources."""
        return np.array([one.image.source for one in self.images])


@dataclass(frozen=True, slots=True, kw_only=True)
class Fold:
    """Which images fit and which measure, (images,) masks."""

    name: str
    fit: NDArray[np.bool_]
    measure: NDArray[np.bool_]


def view_set(images: Sequence[DetectedImage]) -> ViewSet:
    """The features of every view of every image."""
    rows = [(number, hand) for number, one in enumerate(images) for hand in one.hands]
    return ViewSet(
        images=tuple(images),
        values=np.array([features(hand.image_px, hand.world_m) for _, hand in rows]),
        owner=np.array([number for number, _ in rows], dtype=np.int64),
    )


def folds(views: ViewSet) -> Iterator[Fold]:
    """Leave-one-source-out folds over the images; digital hands always fit."""
    labels, sources = views.labels, views.sources
    always = sources == DIGITAL
    among = ~always
    lonely = [name for name in GESTURE_NAMES if len(set(sources[among & (labels == name)])) == 1]
    third = _thirds(labels, sources)
    for source in sorted(set(sources[among])):
        here = among & (sources == source)
        own = [name for name in lonely if np.any(here & (labels == name))]
        if not own:
            yield Fold(name=source, fit=always | (among & ~here), measure=here)
            continue
        for part in range(THIRDS):
            kept = here & np.isin(labels, own) & (third != part)
            yield Fold(
                name=f"{source} {part + 1}/{THIRDS}",
                fit=always | (among & ~here) | kept,
                measure=here & (third == part),
            )


def _inner_folds(views: ViewSet, of: NDArray[np.bool_]) -> Iterator[Fold]:
    """As `folds`, but each source once (many such fits are made only to choose thresholds), with its share of the
    digital people left out besides, and by one third for every label that no other source shows: the model that is
    to be judged by them has seen such hands, so one that hasn't would ask for thresholds too high.
    """
    labels, sources = views.labels, views.sources
    digital = of & (sources == DIGITAL)
    among = of & ~digital
    names = sorted(set(sources[among]))
    third = _thirds(labels, sources)
    people = sorted({one.image.group for one in views.images})
    fold_of_person = {person: k % max(len(names), 1) for k, person in enumerate(people)}
    person_fold = np.array([fold_of_person[one.image.group] for one in views.images])
    for number, source in enumerate(names):
        here = among & (sources == source)
        only_here = sorted(set(labels[here]) - set(labels[among & ~here]))
        kept = here & np.isin(labels, only_here) & (third != number % THIRDS)
        aside = digital & (person_fold == number)
        yield Fold(name=source, fit=(digital & ~aside) | (among & ~here) | kept, measure=(here & ~kept) | aside)


def _thirds(labels: NDArray[np.str_], sources: NDArray[np.str_]) -> NDArray[np.int64]:
    """Which contiguous third of its label and source each image belongs to, in the order of the list."""
    third = np.zeros(len(labels), dtype=np.int64)
    for source, label in set(zip(sources, labels, strict=True)):
        members = np.flatnonzero((sources == source) & (labels == label))
        third[members] = np.arange(len(members)) * THIRDS // len(members)
    return third


def fit(
    views: ViewSet, among: NDArray[np.bool_], progress: Callable[[str], None] = lambda _: None, *, seed: int = 0
) -> RobustModel:
    """Fit on some images: first the thresholds, by inner folds of these images alone, then the members.

    progress gets the name of each inner fold, and "" for the final fit. Another seed draws other examples, synthetic
    hands and noise: how far figures differ then is chance.
    """
    require_extra("evaluate", "sklearn", "threadpoolctl")
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1):  # small matrices: on a busy machine threads wait for each other forty times as long
        classified = _inner_chances(views, among, progress, seed)
        progress("")
        model = _fit_members(views, among, MEMBERS, seed)
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
    views: ViewSet, among: NDArray[np.bool_], progress: Callable[[str], None], seed: int
) -> tuple[NDArray[np.str_], FloatArray, FloatArray]:
    """Labels, chances and weights of these images and digital hands, each classified without its source.

    Of those that one source alone shows a third is classified, and weighs three times.
    """
    chances = np.zeros((len(views.images), len(GESTURE_NAMES)))
    classified = np.zeros(len(views.images), dtype=bool)
    for fold in _inner_folds(views, among):
        progress(fold.name)
        model = _fit_members(views, fold.fit, THRESHOLD_MEMBERS, seed)
        chances += image_probabilities(model, views, fold.measure)[:, : len(GESTURE_NAMES)]
        classified |= fold.measure
    pairs = list(zip(views.labels, views.sources, strict=True))
    given, counted = (Counter(pairs[k] for k in np.flatnonzero(some)) for some in (among, classified))
    weights = np.array([given[pairs[k]] / counted[pairs[k]] for k in np.flatnonzero(classified)])
    return views.labels[classified], chances[classified], weights


@dataclass(frozen=True, slots=True, kw_only=True)
class _Examples:
    """What one member is fitted on: features (n, F), labels (n,) and weights (n,)."""

    values: FloatArray
    labels: NDArray[np.str_]
    weights: FloatArray


def _fit_members(views: ViewSet, among: NDArray[np.bool_], members: int, seed: int) -> RobustModel:
    seeds = [seed * MEMBERS + k for k in range(members)]
    drawn = [_examples(views, among, one) for one in seeds]
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


def _examples(views: ViewSet, among: NDArray[np.bool_], seed: int) -> _Examples:
    """Every second view of these images, and synthetic hands made from them.

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
    return _Examples(
        values=np.vstack([views.values[rows], made]),
        labels=np.concatenate([labels, made_labels]),
        weights=np.concatenate([weights, np.full(len(made), SYNTHETIC_WEIGHT)]),
    )


def _synthetic(views: ViewSet, owners: NDArray[np.int64], seed: int) -> tuple[FloatArray, list[str]]:
    hands = [views.images[owner].hands[0] for owner in owners]
    synthesizer = HandSynthesizer(
        np.array([hand.world_m for hand in hands]),
        np.array([hand.side is Side.RIGHT for hand in hands]),
        [views.images[owner].image.label for owner in owners],
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


def choose_thresholds(labels: NDArray[np.str_], chances: FloatArray, weights: FloatArray | None = None) -> FloatArray:
    """(12,) thresholds from the labels of n hands, their confidence in each gesture, (n, 12), and how many hands each
    one counts for in F1, (n,), one if None.

    A hand is classified as its most likely gesture, so what one gesture accepts doesn't touch the others' thresholds.
    """
    weights = np.ones(len(labels)) if weights is None else weights
    undefined = ~np.isin(labels, GESTURE_NAMES)
    kinds = np.array(sorted(set(labels[undefined])), dtype=str)
    chances = np.where(undefined[:, None], _surer(chances), chances)
    of_kind = labels == kinds[:, None]
    limits = np.array([_limit(kind) for kind in kinds])
    halfway = kinds == BETWEEN_LABEL
    counted = undefined & (labels != BETWEEN_LABEL)
    prices = np.where(halfway, FIRST_PRICE / 10, FIRST_PRICE)
    for _ in range(LAST_ROUND):
        thresholds = _cheapest(labels, chances, weights, prices @ of_kind / max(int(undefined.sum()), 1))
        wrong = _accepted(chances, thresholds) & undefined
        too_many = (of_kind @ wrong) > limits * of_kind.sum(axis=1)
        if (wrong & counted).sum() > MOST_ACCEPTED * counted.sum():
            too_many |= ~halfway
        if not too_many.any():
            break
        prices = np.where(too_many, prices * DEARER, prices)
    return thresholds


def _surer(chances: FloatArray) -> FloatArray:
    """Chances with `MARGIN` more of log-odds."""
    more = chances * np.exp(MARGIN)
    surer: FloatArray = more / (more + 1 - chances)
    return surer


def _limit(kind: str) -> float:
    """The share of a kind that may be accepted."""
    if kind in LOOK_ALIKES:
        return MOST_ACCEPTED_LOOK_ALIKES
    return MOST_ACCEPTED_HALFWAY if kind == BETWEEN_LABEL else 1.0


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
