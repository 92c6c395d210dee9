"""Which images fit and which measure: whole sources left out, and in the fit itself again, to choose thresholds.

Of gestures that only one source shows a contiguous third is left out (images taken one after another resemble each
other), so that no image serves both fitting and measuring.

Where each of many people sits before a camera of their own, a person is a source.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.evaluate.digital import SOURCE as DIGITAL
from app.evaluate.gestures.corrections import shown_label
from app.evaluate.readings import GESTURE_NAMES, NO_HAND, DetectedImage
from kgdfa.features import features
from kgdfa.hand import FloatArray

THIRDS = 3
MANY_PEOPLE = 3  # from so many on, the people of a source are sources of their own
PERSON = ", person "
PEOPLE_FOLDS = 5  # so many folds leave people out; an odd one out has 11 of 14 to fit on
INNER_PEOPLE_FOLDS = 4
KIND_FOLDS = 4  # so many folds leave kinds of undefined hands out, a quarter of them each


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewSet:
    """Images as the fit sees them. values (n, F): features of every view; owner (n,): its image's place."""

    images: tuple[DetectedImage, ...]
    values: FloatArray
    owner: NDArray[np.int64]

    @property
    def labels(self) -> NDArray[np.str_]:
        """(images,) labels of what they show."""
        return np.array([shown_label(one.image) for one in self.images])

    @property
    def sources(self) -> NDArray[np.str_]:
        """(images,) sources; where a source names many people, each of them is one."""
        people: dict[str, set[str]] = defaultdict(set)
        for one in self.images:
            people[one.image.source].add(one.image.group)
        many = {name for name, some in people.items() if len(some - {""}) >= MANY_PEOPLE} - {DIGITAL}
        named = [(one.image.source, one.image.group) for one in self.images]
        return np.array([PERSON.join(pair) if pair[0] in many and pair[1] else pair[0] for pair in named])


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


def folds(views: ViewSet, measured: NDArray[np.bool_]) -> Iterator[Fold]:
    """Folds that leave one source of the measured images out, or some of the people that are sources of their own.

    All other images, and digital hands, always fit.
    """
    labels, sources = views.labels, views.sources
    among = measured & (sources != DIGITAL)
    lonely = [name for name in GESTURE_NAMES if len(set(sources[among & (labels == name)])) == 1]
    third = _thirds(labels, sources)
    for unit, members in _left_out_together(sources[among], PEOPLE_FOLDS).items():
        here = among & np.isin(sources, members)
        own = [name for name in lonely if np.any(here & (labels == name))]
        if not own:
            yield Fold(name=unit, fit=~here, measure=here)
            continue
        for part in range(THIRDS):
            kept = here & np.isin(labels, own) & (third != part)
            yield Fold(name=f"{unit} {part + 1}/{THIRDS}", fit=~here | kept, measure=here & (third == part))


def inner_folds(views: ViewSet, of: NDArray[np.bool_]) -> Iterator[Fold]:
    """As `folds`, but each source once (many such fits are made only to choose thresholds), with its share of the
    digital people left out besides, and by one third for every label that no other source shows: the model that is
    to be judged by them has seen such hands, so one that hasn't would ask for thresholds too high.
    """
    labels, sources = views.labels, views.sources
    digital = of & (sources == DIGITAL)
    among = of & ~digital
    units = _left_out_together(sources[among], INNER_PEOPLE_FOLDS)
    third = _thirds(labels, sources)
    people = sorted({one.image.group for one in views.images})
    fold_of_person = {person: k % max(len(units), 1) for k, person in enumerate(people)}
    person_fold = np.array([fold_of_person[one.image.group] for one in views.images])
    for number, (unit, members) in enumerate(units.items()):
        here = among & np.isin(sources, members)
        only_here = sorted(set(labels[here]) - set(labels[among & ~here]))
        kept = here & np.isin(labels, only_here) & (third != number % THIRDS)
        aside = digital & (person_fold == number)
        yield Fold(name=unit, fit=(digital & ~aside) | (among & ~here) | kept, measure=(here & ~kept) | aside)


def _left_out_together(sources: NDArray[np.str_], parts: int) -> dict[str, list[str]]:
    """Sources by the name of the fold that leaves them out: each alone, but people dealt to so many parts."""
    names = sorted(set(sources))
    people = [name for name in names if PERSON in name]
    together = {name: [name] for name in names if PERSON not in name}
    for part in range(min(parts, len(people))):
        together[f"people {part + 1}/{parts}"] = people[part::parts]
    return together


def _thirds(labels: NDArray[np.str_], sources: NDArray[np.str_]) -> NDArray[np.int64]:
    """Which contiguous third of its label and source each image belongs to, in the order of the list."""
    third = np.zeros(len(labels), dtype=np.int64)
    for source, label in set(zip(sources, labels, strict=True)):
        members = np.flatnonzero((sources == source) & (labels == label))
        third[members] = np.arange(len(members)) * THIRDS // len(members)
    return third


def kind_folds(views: ViewSet, measured: NDArray[np.bool_]) -> Iterator[Fold]:
    """Folds that leave whole kinds of undefined hands out, of every source and of the digital hands.

    Several at once: that is harder for the fit than one at a time, and takes a quarter of the time or less.
    """
    labels = views.labels
    kinds = sorted(set(labels[measured]) - {*GESTURE_NAMES, NO_HAND})
    for part in range(min(KIND_FOLDS, len(kinds))):
        here = np.isin(labels, kinds[part::KIND_FOLDS])
        yield Fold(name=f"kinds {part + 1}/{KIND_FOLDS}", fit=~here, measure=measured & here)
