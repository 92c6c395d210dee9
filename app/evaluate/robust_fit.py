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

from app.evaluate.digital_hands import SOURCE as DIGITAL
from app.evaluate.gesture_measures import GESTURE_NAMES
from app.evaluate.gesture_photos import SeenPhoto
from app.evaluate.grafts import Grafter
from app.evaluate.thresholds import choose_thresholds
from kgdfa.features import features
from kgdfa.hand import FloatArray, Side
from kgdfa.robust_model import RobustModel

MEMBERS = 3
HIDDEN = 64
EPOCHS = 12
PENALTY = 0.03  # L2
DROPOUT = 0.1  # share of features blanked: no verdict shall hang on one of them
WRONG_LABELS = 0.05  # share of examples given a label drawn at random: some labels are noise, and none shall be certain
GRAFT_WEIGHT = 1.0  # of one grafted hand, the mean real look's being 1
THIRDS = 3
INNER_GROUPS = 3  # of sources, each left out once in the fits that choose thresholds
INNER_SHARE = 1 / 2  # of looks and grafts, in the fits that only choose thresholds: they are many
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
    """As `folds`, but a few sources at a time (many such fits are made only to choose thresholds), with a third of
    the digital people left out of each, and by thirds for every label that no source outside the group shows: the
    model that is to be judged has seen such hands, so one that hasn't would ask for thresholds too high.
    """
    labels, sources = looked.labels, looked.sources
    digital = of & (sources == DIGITAL)
    among = of & ~digital
    third = _thirds(labels, sources)
    people = {person: k % THIRDS for k, person in enumerate(sorted({one.photo.group for one in looked.photos}))}
    person_third = np.array([people[one.photo.group] for one in looked.photos])
    for part, group in enumerate(_even_groups(sources[among])):
        here = among & np.isin(sources, group)
        only_here = sorted(set(labels[here]) - set(labels[among & ~here]))
        kept = here & np.isin(labels, only_here) & (third != part)
        aside = digital & (person_third == part)
        yield Fold(
            name=", ".join(group),
            fit=(digital & ~aside) | (among & ~here) | kept,
            measure=(here & ~kept) | aside,
        )


def _even_groups(sources: NDArray[np.str_]) -> list[list[str]]:
    """The sources in `INNER_GROUPS` groups of about as many photos each."""
    groups: list[list[str]] = [[] for _ in range(INNER_GROUPS)]
    sizes = [0] * INNER_GROUPS
    for source, count in Counter(sources.tolist()).most_common():
        smallest = sizes.index(min(sizes))
        groups[smallest].append(source)
        sizes[smallest] += count
    return [group for group in groups if group]


def _thirds(labels: NDArray[np.str_], sources: NDArray[np.str_]) -> NDArray[np.int64]:
    """Which contiguous third of its label and source each photo belongs to, in the order of the list."""
    third = np.zeros(len(labels), dtype=np.int64)
    for source, label in set(zip(sources, labels, strict=True)):
        members = np.flatnonzero((sources == source) & (labels == label))
        third[members] = np.arange(len(members)) * THIRDS // len(members)
    return third


def fit(looked: Looked, among: NDArray[np.bool_], tell: Callable[[str], None] = lambda _: None) -> RobustModel:
    """Fit on some photos: first the thresholds, by inner folds of these photos alone, then the members."""
    thresholds = _choose_thresholds(looked, among, tell)
    tell(f"{MEMBERS} members")
    return replace(_fit_members(looked, among, MEMBERS), accept=thresholds)


def photo_probabilities(model: RobustModel, looked: Looked, of: NDArray[np.bool_]) -> FloatArray:
    """The class probabilities of each photo, the mean over its looks, (photos, K); 0 where no hand was found."""
    rows = np.flatnonzero(of[looked.owner])
    sums = np.zeros((len(looked.photos), len(model.classes)))
    np.add.at(sums, looked.owner[rows], model.probabilities(looked.values[rows]) if len(rows) else 0.0)
    counts = np.bincount(looked.owner[rows], minlength=len(looked.photos))
    means: FloatArray = sums / np.maximum(counts, 1)[:, None]
    return means


def _choose_thresholds(looked: Looked, among: NDArray[np.bool_], tell: Callable[[str], None]) -> FloatArray:
    """The thresholds that serve best on inner folds."""
    labels, chances = inner_chances(looked, among, tell)
    return choose_thresholds(labels, chances)


def inner_chances(
    looked: Looked, among: NDArray[np.bool_], tell: Callable[[str], None]
) -> tuple[NDArray[np.str_], FloatArray]:
    """Labels of these photos and digital hands, and each one's chances by a model fitted without its source."""
    chances = np.zeros((len(looked.photos), len(GESTURE_NAMES)))
    for fold in _inner_folds(looked, among):
        tell(f"thresholds, without {fold.name}")
        model = _fit_members(looked, fold.fit, MEMBERS, share=INNER_SHARE)
        chances += photo_probabilities(model, looked, fold.measure)[:, : len(GESTURE_NAMES)]
    return looked.labels[among], chances[among]


def _fit_members(looked: Looked, among: NDArray[np.bool_], members: int, share: float = 1.0) -> RobustModel:
    values, labels, weights = _examples(looked, among, share)
    classes = [*GESTURE_NAMES, *sorted(set(labels) - set(GESTURE_NAMES))]
    centre = np.median(values, axis=0)
    spread = np.subtract(*np.percentile(values, [85, 15], axis=0)) + 1e-6
    squashed = np.tanh((values - centre) / spread).astype(np.float32)  # as the model is stored, and twice as fast
    fitted = [_member(squashed, labels, weights, classes, seed) for seed in range(members)]
    ranges = [np.percentile(values[labels == name], [*RANGE_PERCENT, 50], axis=0) for name in classes]
    return RobustModel(
        classes=tuple(classes),
        centre=centre,
        spread=spread,
        weights_in=np.stack([one[0] for one in fitted]),
        bias_in=np.stack([one[1] for one in fitted]),
        weights_out=np.stack([one[2] for one in fitted]),
        bias_out=np.stack([one[3] for one in fitted]),
        accept=np.full(len(GESTURE_NAMES), 0.5),
        tie=TIE,
        typical=np.array([one[2] for one in ranges]),
        low=np.array([one[0] for one in ranges]),
        high=np.array([one[1] for one in ranges]),
    )


def _examples(
    looked: Looked, among: NDArray[np.bool_], share: float
) -> tuple[FloatArray, NDArray[np.str_], FloatArray]:
    """Features, labels and weights of every look at these photos and of hands grafted from them.

    Rare pairs of label and source weigh more a look, by the root of their number; `NEAR_WEIGHT` comes on top.
    """
    shows_hand = looked.labels != "none:nohand"
    rows = np.flatnonzero((among & shows_hand)[looked.owner])
    rows = rows[:: round(1 / share)]
    owners = looked.owner[rows]
    labels = looked.labels[owners]
    pairs = list(zip(labels, looked.sources[owners], strict=True))
    often = Counter(pairs)
    weights = np.array([often[pair] ** -0.5 for pair in pairs])
    weights /= weights.mean()
    weights *= [NEAR_WEIGHT.get(label, 1.0) for label in labels]
    made, made_labels = _grafts(looked, np.unique(owners), share)
    return (
        np.vstack([looked.values[rows], made]),
        np.concatenate([labels, made_labels]),
        np.concatenate([weights, np.full(len(made), GRAFT_WEIGHT)]),
    )


def _grafts(looked: Looked, owners: NDArray[np.int64], share: float) -> tuple[FloatArray, list[str]]:
    hands = [looked.photos[owner].hands[0] for owner in owners]
    grafter = Grafter(
        np.array([hand.world_m for hand in hands]),
        np.array([hand.side is Side.RIGHT for hand in hands]),
        [looked.photos[owner].photo.label for owner in owners],
        seed=0,
    )
    return grafter.make(share)


def _member(
    squashed: FloatArray, labels: NDArray[np.str_], weights: FloatArray, classes: list[str], seed: int
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """One perceptron, on examples drawn anew by their weights, with features blanked at random."""
    random = np.random.default_rng(seed)
    drawn = random.choice(len(labels), len(labels), p=weights / weights.sum())
    seen = squashed[drawn] * (random.random(squashed.shape) >= DROPOUT)
    wanted = np.array([classes.index(label) for label in labels[drawn]])
    noisy = random.random(len(wanted)) < WRONG_LABELS
    wanted[noisy] = random.integers(len(classes), size=int(noisy.sum()))
    missing = sorted(set(range(len(classes))) - set(wanted))
    if missing:  # a class so rare that it was never drawn: show it once
        first = [int(np.flatnonzero(labels == classes[k])[0]) for k in missing]
        seen, wanted = np.vstack([seen, squashed[first]]), np.concatenate([wanted, missing])
    net = MLPClassifier((HIDDEN,), alpha=PENALTY, max_iter=EPOCHS, batch_size=256, random_state=seed)
    net.n_iter_no_change = EPOCHS
    _fit_quietly(net, seen, wanted)
    return net.coefs_[0], net.intercepts_[0][None], net.coefs_[1], net.intercepts_[1][None]


def _fit_quietly(net: MLPClassifier, seen: FloatArray, wanted: NDArray[np.int64]) -> None:
    """The number of epochs is chosen, not waited for: sklearn's warning says just that."""
    import warnings

    from sklearn.exceptions import ConvergenceWarning

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        net.fit(seen, wanted)
