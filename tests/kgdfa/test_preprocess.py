from __future__ import annotations

import numpy as np
import pytest

from kgdfa.errors import KgdfaError
from kgdfa.images import Image
from kgdfa.preprocess import PREPARATIONS, denoise, find_preparation, sharpen


def edge(noise_sd: float) -> Image:
    """A soft edge from dark to light, with grain."""
    ramp = np.clip((np.arange(64) - 28) / 8, 0, 1) * 120 + 60
    grain = np.random.default_rng(1).normal(0, noise_sd, (64, 64, 3))
    return np.clip(np.tile(ramp[None, :, None], (64, 1, 3)) + grain, 0, 255).astype(np.uint8)


def test_denoising_takes_grain_away() -> None:
    grainy = edge(8)
    assert denoise(grainy)[:, :20].std() < 0.7 * grainy[:, :20].std()


def test_sharpening_makes_edges_steeper() -> None:
    soft = edge(0)
    assert np.diff(sharpen(soft)[32, :, 0].astype(int)).max() > np.diff(soft[32, :, 0].astype(int)).max()


@pytest.mark.parametrize("name", list(PREPARATIONS))
def test_every_preparation_takes_every_picture(name: str) -> None:
    prepare = find_preparation(name)
    for shape in ((6, 5), (6, 5, 3), (6, 5, 4)):
        assert prepare(np.full(shape, 90, np.uint8)).shape == (6, 5, 3)


def test_an_unknown_preparation_is_refused_by_name() -> None:
    with pytest.raises(KgdfaError, match=r"'blur'.*denoise\+sharpen"):
        find_preparation("blur")
