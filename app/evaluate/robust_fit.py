"""Fits the `robust` rules: perceptrons over the features of real and grafted hands, thresholds by cross-validation.

Folds leave a whole source of photos out; of gestures that only one source shows, a contiguous third of it
(photos taken one after another resemble each other), so that no photo serves both fitting and measuring.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from sklearn.neural_network import MLPClassifier
from threadpoolctl import threadpool_limits

from app.evaluate.digital_hands import SOURCE as DIGITAL
from app.evaluate.gesture_measures import GESTURE_NAMES
from app.evaluate.gesture_photos import SeenPhoto
from app.evaluate.grafts import Grafter
from app.evaluate.thresholds import choose_thresholds
from kgdfa.features import features
from kgdfa.hand import FloatArray, Side
from kgdfa.robust import RobustModel

MEMBERS = 8  # figures of three swung from one draw of examples to the next
JUDGING_MEMBERS = 4  # in the fits that only choose thresholds: they are many, and sources differ more than draws do
HIDDEN = 64
EPOCHS = 12
PENALTY = 0.03  # L2
DROPOUT = 0.1  # share of features blanked: no verdict shall hang on one of them
WRONG_LABELS = 0.05  # share of examples given a label drawn at random: some labels are noise, and none shall be certain
# Each member sees every second look, and grafts of its own: together they see more than one that sees all.
LOOK_STEP = 2
GRAFT_SHARE = 1 / 4
GRAFT_WEIGHT = 2.0  # of one grafted hand, the mean real look's being 1
THIRDS = 3
NEAR_WEIGHT = {"none:natural_open": 3.0}  # of one look, the mean being 1: few photos show one, and it would walk
TIE = 0.10  # lead over the next class below which it is a tie, and none
RANGE_PERCENT = (3.0, 97.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Looked:
    """Photos as the fit sees them. values (n, F): features of every look; owner (n,): its photo's place."""

    photos: tuple[SeenPhoto, ...]
    values: FloatArray
    owner: NDArray[np.int64]

    @property
    def labels(self) -> NDArray[np.str_]:
        """(photos,) labels."""
        return np.array([one.photo.label for one in self.photos])

    @property
    def sources(self) -> NDArray[np.str_]:
        """(photos,) sources."""
        return np.array([one.photo.source for one in self.photos])


@dataclass(frozen=True, slots=True, kw_only=True)
class Fold:
    """Which photos fit and which measure, (photos,) masks."""

    name: str
    fit: NDArray[np.bool_]
    measure: NDArray[np.bool_]


def look(photos: Sequence[SeenPhoto]) -> Looked:
    """The features of every look at every photo."""
    rows = [(number, hand) for number, one in enumerate(photos) for hand in one.hands]
    return Looked(
        photos=tuple(photos),
        values=np.array([features(hand.image_px, hand.world_m) for _, hand in rows]),
        owner=np.array([number for number, _ in rows], dtype=np.int64),
    )


def folds(looked: Looked, of: NDArray[np.bool_] | None = None) -> Iterator[Fold]:
    """Leave-one-source-out folds over some of the photos (all, if not said); the digital hand only ever fits."""
    labels, sources = looked.labels, looked.sources
    given = np.ones(len(labels), dtype=bool) if of is None else of
    always = given & (sources == DIGITAL)
    among = given & ~always
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
                name=f"{source}, third {part + 1}", fit=always | (among & ~here) | kept, measure=here & (third == part)
            )


def _inner_folds(looked: Looked, of: NDArray[np.bool_]) -> Iterator[Fold]:
    """As `folds`, but each source once (many such fits are made only to choose thresholds), with its share of the
    digital people left out besides, and by one third for every label that no other source shows: the model that is
    to be judged has seen such hands, so one that hasn't would ask for thresholds too high.
    """
    labels, sources = looked.labels, looked.sources
    digital = of & (sources == DIGITAL)
    among = of & ~digital
    names = sorted(set(sources[among]))
    third = _thirds(labels, sources)
    people = sorted({one.photo.group for one in looked.photos})
    fold_of_person = {person: k % max(len(names), 1) for k, person in enumerate(people)}
    person_fold = np.array([fold_of_person[one.photo.group] for one in looked.photos])
    for number, source in enumerate(names):
        here = among & (sources == source)
        only_here = sorted(set(labels[here]) - set(labels[among & ~here]))
        kept = here & np.isin(labels, only_here) & (third != number % THIRDS)
        aside = digital & (person_fold == number)
        yield Fold(name=source, fit=(digital & ~aside) | (among & ~here) | kept, measure=(here & ~kept) | aside)


def _thirds(labels: NDArray[np.str_], sources: NDArray[np.str_]) -> NDArray[np.int64]:
    """Which contiguous third of its label and source each photo belongs to, in the order of the list."""
    third = np.zeros(len(labels), dtype=np.int64)
    for source, label in set(zip(sources, labels, strict=True)):
        members = np.flatnonzero((sources == source) & (labels == label))
        third[members] = np.arange(len(members)) * THIRDS // len(members)
    return third


def fit(
    looked: Looked, among: NDArray[np.bool_], tell: Callable[[str], None] = lambda _: None, *, seed: int = 0
) -> RobustModel:
    """Fit on some photos: first the thresholds, by inner folds of these photos alone, then the members.

    Another seed draws other examples, grafts and noise: how far figures differ then is chance.
    """
    with threadpool_limits(1):  # small matrices: on a busy machine threads wait for each other forty times as long
        judged = _inner_chances(looked, among, tell, seed)
        tell(f"{MEMBERS} members")
        model = _fit_members(looked, among, MEMBERS, seed)
    return replace(model, accept=choose_thresholds(*judged))


def photo_probabilities(model: RobustModel, looked: Looked, of: NDArray[np.bool_]) -> FloatArray:
    """The class probabilities of each photo, the mean over its looks, (photos, K); 0 where no hand was found."""
    rows = np.flatnonzero(of[looked.owner])
    sums = np.zeros((len(looked.photos), len(model.classes)))
    np.add.at(sums, looked.owner[rows], model.probabilities(looked.values[rows]) if len(rows) else 0.0)
    counts = np.bincount(looked.owner[rows], minlength=len(looked.photos))
    means: FloatArray = sums / np.maximum(counts, 1)[:, None]
    return means


def _inner_chances(
    looked: Looked, among: NDArray[np.bool_], tell: Callable[[str], None], seed: int
) -> tuple[NDArray[np.str_], FloatArray, FloatArray]:
    """Labels, chances and weights of these photos and digital hands, each judged by a model fitted without its source.

    Of those that one source alone shows a third is judged, and weighs three times.
    """
    chances = np.zeros((len(looked.photos), len(GESTURE_NAMES)))
    judged = np.zeros(len(looked.photos), dtype=bool)
    for fold in _inner_folds(looked, among):
        tell(f"thresholds, without {fold.name}")
        model = _fit_members(looked, fold.fit, JUDGING_MEMBERS, seed)
        chances += photo_probabilities(model, looked, fold.measure)[:, : len(GESTURE_NAMES)]
        judged |= fold.measure
    pairs = list(zip(looked.labels, looked.sources, strict=True))
    given, counted = (Counter(pairs[k] for k in np.flatnonzero(some)) for some in (among, judged))
    weights = np.array([given[pairs[k]] / counted[pairs[k]] for k in np.flatnonzero(judged)])
    return looked.labels[judged], chances[judged], weights


@dataclass(frozen=True, slots=True, kw_only=True)
class _Examples:
    """What one member is fitted on: features (n, F), labels (n,) and weights (n,)."""

    values: FloatArray
    labels: NDArray[np.str_]
    weights: FloatArray


def _fit_members(looked: Looked, among: NDArray[np.bool_], members: int, seed: int) -> RobustModel:
    seeds = [seed * MEMBERS + k for k in range(members)]
    drawn = [_examples(looked, among, one) for one in seeds]
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


def _examples(looked: Looked, among: NDArray[np.bool_], seed: int) -> _Examples:
    """Every second look at these photos, and hands grafted from them.

    Rare pairs of label and source weigh more a look, by the root of their number; `NEAR_WEIGHT` comes on top.
    """
    shows_hand = looked.labels != "none:nohand"
    rows = np.flatnonzero((among & shows_hand)[looked.owner])[seed % LOOK_STEP :: LOOK_STEP]
    owners = looked.owner[rows]
    labels = looked.labels[owners]
    pairs = list(zip(labels, looked.sources[owners], strict=True))
    often = Counter(pairs)
    weights = np.array([often[pair] ** -0.5 for pair in pairs])
    weights /= weights.mean()
    weights *= [NEAR_WEIGHT.get(label, 1.0) for label in labels]
    made, made_labels = _grafts(looked, np.unique(owners), seed)
    return _Examples(
        values=np.vstack([looked.values[rows], made]),
        labels=np.concatenate([labels, made_labels]),
        weights=np.concatenate([weights, np.full(len(made), GRAFT_WEIGHT)]),
    )


def _grafts(looked: Looked, owners: NDArray[np.int64], seed: int) -> tuple[FloatArray, list[str]]:
    hands = [looked.photos[owner].hands[0] for owner in owners]
    grafter = Grafter(
        np.array([hand.world_m for hand in hands]),
        np.array([hand.side is Side.RIGHT for hand in hands]),
        [looked.photos[owner].photo.label for owner in owners],
        seed,
    )
    return grafter.make(GRAFT_SHARE)


def _member(
    examples: _Examples, classes: list[str], squashing: tuple[FloatArray, FloatArray], seed: int
) -> MLPClassifier:
    """One perceptron, on examples drawn anew by their weights, with features blanked at random."""
    centre, spread = squashing
    normalized = np.tanh((examples.values - centre) / spread).astype(np.float32)  # as stored; twice as fast
    labels, weights = examples.labels, examples.weights
    random = np.random.default_rng(seed)
    drawn = random.choice(len(labels), len(labels), p=weights / weights.sum())
    seen = normalized[drawn] * (random.random(normalized.shape) >= DROPOUT)
    wanted = np.array([classes.index(label) for label in labels[drawn]])
    noisy = random.random(len(wanted)) < WRONG_LABELS
    wanted[noisy] = random.integers(len(classes), size=int(noisy.sum()))
    missing = sorted(set(range(len(classes))) - set(wanted))
    if missing:  # a class so rare that it was never drawn: show it once
        first = [int(np.flatnonzero(labels == classes[k])[0]) for k in missing]
        seen, wanted = np.vstack([seen, normalized[first]]), np.concatenate([wanted, missing])
    net = MLPClassifier((HIDDEN,), alpha=PENALTY, max_iter=EPOCHS, batch_size=256, random_state=seed)
    net.n_iter_no_change = EPOCHS
    _fit_quietly(net, seen, wanted)
    return net


def _fit_quietly(net: MLPClassifier, seen: NDArray[np.float32], wanted: NDArray[np.int64]) -> None:
    """The number of epochs is chosen, not waited for: sklearn's warning says just that."""
    import warnings

    from sklearn.exceptions import ConvergenceWarning

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        net.fit(seen, wanted)
