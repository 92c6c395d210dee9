"""Measures the rule sets on labelled photos: as shipped, or fitted anew for every source of photos left out."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from app.evaluate.gesture_judge import PhotoJudge, PublishedJudge, RobustJudge, judge_all, judge_photo
from app.evaluate.gesture_measures import Figures, Judged, measure
from app.evaluate.gesture_photos import SeenPhoto
from kgdfa.robust import RobustRules

SHIPPED = "the shipped model (on photos it was fitted on, these figures flatter it: use --cross-validate)"
CROSS_VALIDATED = "cross-validated: every photo judged by a model fitted without its source"


def judge_as_shipped(seen: Sequence[SeenPhoto], *, looks: int | None = None) -> dict[str, list[Judged]]:
    """Both rule sets as the program runs them."""
    judges: tuple[PhotoJudge, ...] = (PublishedJudge(), RobustJudge(looks=looks))
    return {judge.name: judge_all(seen, judge) for judge in judges}


def judge_cross_validated(
    seen: Sequence[SeenPhoto],
    digital: Sequence[SeenPhoto],
    tell: Callable[[str], None],
    *,
    looks: int | None = None,
    seed: int = 0,
) -> dict[str, list[Judged]]:
    """Both rule sets; the robust one is fitted anew for each fold, on digital hands and the other photos.

    Another seed draws other examples and noise: what figures differ by from seed to seed is chance.
    """
    from app.evaluate.robust_fit import fit, folds, look

    looked = look([*seen, *digital])
    robust: list[Judged | None] = [None] * len(seen)
    for fold in folds(looked):
        tell(f"without {fold.name}")
        judge = RobustJudge(RobustRules(fit(looked, fold.fit, seed=seed)), looks=looks)
        for number in map(int, np.flatnonzero(fold.measure)):
            robust[number] = judge_photo(seen[number], judge)
    published = PublishedJudge()
    return {
        published.name: judge_all(seen, published),
        RobustRules.name: [one for one in robust if one is not None],
    }


def measure_all(judged: dict[str, list[Judged]]) -> dict[str, Figures]:
    """The figures of each rule set."""
    return {name: measure(some) for name, some in judged.items()}
