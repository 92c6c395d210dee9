"""Both rule sets on images that the robust rules were not fitted on: they are fitted anew for each fold.

A fit takes minutes and there are a dozen, so each one can be kept and found again by what it was fitted on.
"""

from __future__ import annotations

import hashlib
import inspect
import io
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from app.evaluate.gestures import fit, folds, synthetic, thresholds
from app.evaluate.gestures.folds import Fold, ViewSet
from app.evaluate.gestures.images import classify_all, classify_image, published_classifier, robust_classifier
from app.evaluate.gestures.measures import Classified
from app.evaluate.gestures.simulated import SimulatedHands, simulate
from app.evaluate.harness import write_whole, writing
from app.evaluate.readings import DetectedImage
from kgdfa import robust
from kgdfa.published import PublishedRules
from kgdfa.robust import RobustModel, RobustRules, load_model, save_model

SINGLE_LOOK = f"{RobustRules.name}, single look"
KINDS_LEFT_OUT = f"{RobustRules.name}, kinds left out"
FITTED_BY = (fit, folds, synthetic, thresholds, robust)  # what a fit's result depends on besides its examples


@dataclass(frozen=True, slots=True, kw_only=True)
class FoldFits:
    """The fits of one set of images, one for each fold; with `keep`, found again in that folder."""

    views: ViewSet
    simulated: SimulatedHands
    seed: int
    keep: Path | None = None
    fitting: Callable[..., RobustModel] = fit.fit

    def model(self, fold: Fold) -> RobustModel:
        """Fitted on the fold's images, or as kept. Raises AppError, or KgdfaError for a kept file that is none."""
        if self.keep is None:
            return self._fitted(fold)
        path = self.keep / f"{self.fingerprint(fold)}.npz"
        if not path.exists():
            content = io.BytesIO()
            save_model(self._fitted(fold), content)
            with writing(self.keep):
                self.keep.mkdir(parents=True, exist_ok=True)
            write_whole(path, content.getvalue())
        return load_model(path)

    def fingerprint(self, fold: Fold) -> str:
        """Of all that the fit depends on: its examples, its seed and the code that fits."""
        digest = hashlib.sha256(repr((self.seed, fold.fit.tobytes())).encode())
        for array in (self.views.values, self.views.owner, self.simulated.values):
            digest.update(np.ascontiguousarray(array).tobytes())
        for names in (self.views.labels, self.views.sources, self.simulated.labels):
            digest.update("\n".join(names).encode())
        for module in FITTED_BY:
            digest.update(inspect.getsource(module).encode())
        return digest.hexdigest()[:16]

    def _fitted(self, fold: Fold) -> RobustModel:
        return self.fitting(self.views, fold.fit, self.simulated, seed=self.seed)


def classify_cross_validated(
    detected: Sequence[DetectedImage],
    beside: Sequence[DetectedImage],
    progress: Callable[[str], None],
    *,
    views: int | None = None,
    seed: int = 0,
    keep: Path | None = None,
) -> dict[str, list[Classified]]:
    """Both rule sets; the robust one is fitted anew for each fold, on the other images and all those beside.

    Unless `views` says otherwise it is measured with all views, and with one as "robust, single look". Undefined hands
    are classified once more, by fits that never saw their kind. Another seed draws other examples and noise: what
    figures differ by from seed to seed is chance. With `keep` a run that was interrupted goes on after the last fold.
    """
    every = folds.view_set([*detected, *beside])
    fits = FoldFits(views=every, simulated=simulate(beside, seed=seed), seed=seed, keep=keep)
    measured = np.arange(len(every.images)) < len(detected)

    def rules(fold: Fold) -> RobustRules:
        progress(fold.name)
        return RobustRules(fits.model(fold))

    looks = {RobustRules.name: views} | ({SINGLE_LOOK: 1} if views is None else {})
    found = _left_out(detected, folds.folds(every, measured), looks, rules)
    kinds = _left_out(detected, folds.kind_folds(every, measured), {KINDS_LEFT_OUT: views}, rules)
    published = {PublishedRules.name: classify_all(detected, published_classifier())}
    return published | found | {k: some for k, some in kinds.items() if some}


def _left_out(
    detected: Sequence[DetectedImage],
    folds_of: Iterable[Fold],
    looks: dict[str, int | None],
    rules_of: Callable[[Fold], RobustRules],
) -> dict[str, list[Classified]]:
    """By name of so many looks, what each fold measures, in the order of the images."""
    found: dict[str, dict[int, Classified]] = {name: {} for name in looks}
    for fold in folds_of:
        rules = rules_of(fold)
        for name, some in looks.items():
            classifier = robust_classifier(rules, views=some)
            measured = map(int, np.flatnonzero(fold.measure))
            found[name] |= {number: classify_image(detected[number], classifier) for number in measured}
    return {name: [by_number[number] for number in sorted(by_number)] for name, by_number in found.items()}
