from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from app.evaluate.digital import SOURCE as DIGITAL
from app.evaluate.gestures.folds import KIND_FOLDS, PEOPLE_FOLDS, Fold, ViewSet, folds, inner_folds, kind_folds
from app.evaluate.readings import DetectedImage, LabelledImage
from kgdfa.features import FEATURES

PEOPLE = [f"p{number:02}" for number in range(1, 9)]


def image(label: str, source: str, group: str = "") -> DetectedImage:
    return DetectedImage(image=LabelledImage(path="", label=label, source=source, group=group), hands=())


def views_of(*images: DetectedImage) -> ViewSet:
    return ViewSet(images=images, values=np.empty((0, len(FEATURES))), owner=np.empty(0, np.int64))


def photos() -> list[DetectedImage]:
    """Two sources, one with two hands; 7 is shown by one alone."""
    some = [image(label, "a", f"hand{k}") for label in ("0", "1", "7") for k in (1, 2, 1)]
    return some + [image(label, "b") for label in ("0", "1", "none:ok") for _ in range(3)]


def webcams() -> list[DetectedImage]:
    return [image(label, "own camera", person) for person in PEOPLE for label in ("0", "none:good", "5")]


def digital() -> list[DetectedImage]:
    return [image("0", DIGITAL, str(person)) for person in range(10)]


def groups(views: ViewSet, which: np.ndarray) -> set[str]:
    return {views.images[k].image.group for k in np.flatnonzero(which)}


def test_each_of_many_people_is_a_source_but_two_hands_of_one_are_not() -> None:
    sources = set(views_of(*photos(), *webcams(), *digital()).sources)
    assert len(sources) == 2 + len(PEOPLE) + 1
    assert {"a", "b", DIGITAL} <= sources


@pytest.mark.parametrize("measured", ["photos", "webcams"])
def test_every_measured_image_is_left_out_once_and_all_others_always_fit(measured: str) -> None:
    some, others = (photos(), webcams()) if measured == "photos" else (webcams(), photos())
    views = views_of(*some, *others, *digital())
    among = np.arange(len(views.images)) < len(some)
    made = list(folds(views, among))
    assert (np.sum([fold.measure for fold in made], axis=0) == among).all()
    for fold in made:
        assert not (fold.fit & fold.measure).any()
        assert fold.fit[~among].all()


def test_people_are_left_out_whole_and_in_so_many_folds() -> None:
    views = views_of(*webcams(), *photos(), *digital())
    made = list(folds(views, np.arange(len(views.images)) < len(webcams())))
    assert len(made) == PEOPLE_FOLDS
    for fold in made:
        assert not groups(views, fold.measure) & groups(views, fold.fit)
    left_out = Counter(person for fold in made for person in groups(views, fold.measure))
    assert left_out == dict.fromkeys(PEOPLE, 1)


def test_of_a_gesture_that_one_source_shows_a_third_is_left_out() -> None:
    views = views_of(*photos(), *digital())
    made = {fold.name: fold for fold in folds(views, views.sources != DIGITAL)}
    assert list(made) == ["a 1/3", "a 2/3", "a 3/3", "b"]
    sevens, elsewhere = views.labels == "7", (views.sources == "a") & (views.labels != "7")
    for fold in list(made.values())[:3]:
        assert (fold.measure & sevens).sum() == 1
        assert (fold.fit & sevens).sum() == 2
        assert not (fold.fit & elsewhere).any()


def test_thresholds_are_chosen_on_people_that_those_models_have_not_met() -> None:
    views = views_of(*photos(), *webcams(), *digital())
    among = np.ones(len(views.images), dtype=bool)
    among[0] = False
    made: list[Fold] = list(inner_folds(views, among))
    people = views.sources != DIGITAL
    for fold in made:
        assert not (fold.fit & fold.measure).any()
        assert not ((fold.fit | fold.measure) & ~among).any()
        own = {name for name in groups(views, fold.measure & people) if name in PEOPLE}
        assert not own & groups(views, fold.fit)
        assert not groups(views, fold.measure & ~people) & groups(views, fold.fit & ~people)
    judged = np.sum([fold.measure for fold in made], axis=0)
    assert (judged <= 1).all()
    assert (judged[[one.image.group in PEOPLE for one in views.images]] == 1).all()


def test_each_kind_of_undefined_hand_is_left_out_once_of_every_source_and_of_the_digital_hands() -> None:
    kinds = ("none:ok", "none:good", "none:gun", "none:claw", "none:pinky")
    some = [image(kind, source) for kind in (*kinds, "none:nohand", "1") for source in "ab"]
    views = views_of(*some, *(image(kind, DIGITAL) for kind in kinds))
    among = np.arange(len(views.images)) < len(some)
    made = list(kind_folds(views, among))
    assert len(made) == KIND_FOLDS
    left_out = np.sum([fold.measure for fold in made], axis=0)
    assert (left_out == (among & np.isin(views.labels, kinds))).all()
    for fold in made:
        assert not set(views.labels[fold.measure]) & set(views.labels[fold.fit])
        assert fold.fit[views.labels == "1"].all()


def test_fewer_kinds_than_folds_make_fewer_folds() -> None:
    views = views_of(image("none:ok", "a"), image("1", "a"))
    assert [fold.measure.tolist() for fold in kind_folds(views, np.ones(2, bool))] == [[True, False]]
