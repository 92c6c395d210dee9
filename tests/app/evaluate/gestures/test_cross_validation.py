from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest

from app.cli.tree import command
from app.evaluate.digital import SOURCE as DIGITAL
from app.evaluate.gestures.cross_validation import FoldFits
from app.evaluate.gestures.folds import Fold, ViewSet
from app.evaluate.gestures.simulated import SimulatedHands
from app.evaluate.harness import EvaluateFault
from app.evaluate.readings import DetectedImage, LabelledImage
from app.system.errors import AppError
from kgdfa.errors import KgdfaError
from kgdfa.features import FEATURES
from kgdfa.robust import RobustModel, load_model

IMAGES = tuple(
    DetectedImage(image=LabelledImage(path="", label=label, source=source, group=""), hands=())
    for source in ("a", DIGITAL)
    for label in ("0", "none:ok")
)
FOLD = Fold(name="a", fit=np.array([False, False, True, True]), measure=np.array([True, True, False, False]))


@dataclass
class CountedFit:
    """Gives the shipped model with a threshold that tells which fit it was."""

    times: int = 0
    seeds: list[int] = field(default_factory=list)

    def __call__(self, _views: ViewSet, _among: object, _simulated: SimulatedHands, *, seed: int) -> RobustModel:
        self.times += 1
        self.seeds.append(seed)
        return replace(load_model(), accept=np.full(12, self.times / 8))


def fits(keep: Path | None, fitting: CountedFit) -> FoldFits:
    views = ViewSet(images=IMAGES, values=np.ones((4, len(FEATURES))), owner=np.arange(4))
    simulated = SimulatedHands(values=np.zeros((1, len(FEATURES))), labels=np.array(["none:joints"]))
    return FoldFits(views=views, simulated=simulated, seed=3, keep=keep, fitting=fitting)


def test_a_kept_fit_is_not_made_again(tmp_path: Path) -> None:
    fitting = CountedFit()
    first = fits(tmp_path / "new" / "folder", fitting).model(FOLD)
    again = fits(tmp_path / "new" / "folder", fitting).model(FOLD)
    assert (fitting.times, fitting.seeds) == (1, [3])
    assert list(first.accept) == list(again.accept) == [1 / 8] * 12
    assert np.array_equal(first.weights_in, again.weights_in)


def test_without_a_folder_every_fit_is_made() -> None:
    fitting = CountedFit()
    assert [fits(None, fitting).model(FOLD).accept[0] for _ in range(2)] == [1 / 8, 2 / 8]


@pytest.mark.parametrize(
    "other",
    [
        lambda one: replace(one, seed=4),
        lambda one: replace(one, views=replace(one.views, values=one.views.values + 1e-12)),
        lambda one: replace(one, views=replace(one.views, images=IMAGES[::-1])),
        lambda one: replace(one, simulated=replace(one.simulated, labels=np.array(["0"]))),
        lambda one: replace(one, simulated=replace(one.simulated, values=one.simulated.values + 1.0)),
    ],
    ids=["seed", "measures", "labels", "simulated labels", "simulated measures"],
)
def test_a_fit_on_anything_else_is_made_anew(other: object, tmp_path: Path) -> None:
    assert callable(other)
    fitting = CountedFit()
    one = fits(tmp_path, fitting)
    one.model(FOLD)
    assert other(one).model(FOLD).accept[0] == 2 / 8
    assert one.model(replace(FOLD, fit=~FOLD.fit)).accept[0] == 3 / 8
    assert one.model(replace(FOLD, name="another name")).accept[0] == 1 / 8


def test_a_kept_file_that_is_none_is_named(tmp_path: Path) -> None:
    one = fits(tmp_path, CountedFit())
    one.model(FOLD)
    (kept,) = tmp_path.iterdir()
    kept.write_bytes(b"half a file")
    with pytest.raises(KgdfaError) as caught:
        one.model(FOLD)
    assert caught.value.values["path"] == kept


def test_keeping_fits_needs_a_fit(tmp_path: Path) -> None:
    with pytest.raises(AppError) as caught:
        command().main(["evaluate", "gestures", str(tmp_path), "--keep", str(tmp_path)], standalone_mode=False)
    assert caught.value.code is EvaluateFault.WITH_ALONE
