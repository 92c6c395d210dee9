from __future__ import annotations

import numpy as np
import pytest

from kgdfa.errors import KgdfaError
from kgdfa.preprocess import (
    EVALUATED_EVERY,
    PREPARATIONS,
    AsNeeded,
    Image,
    as_needed,
    denoise,
    find_preparation,
    grain,
    lighten,
    sharpen,
)


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
def test_every_preparation_takes_every_image(name: str) -> None:
    prepare = find_preparation(name)
    for shape in ((6, 5), (6, 5, 3), (6, 5, 4)):
        assert prepare(np.full(shape, 90, np.uint8)).shape == (6, 5, 3)


def test_an_unknown_preparation_is_refused_by_name() -> None:
    with pytest.raises(KgdfaError, match=r"PREPROCESSING name=blur.*denoise\+sharpen"):
        find_preparation("blur")


def test_grain_is_distinguished_from_edges() -> None:
    assert grain(edge(0)) < 0.01
    assert grain(edge(30)) > 0.11


@pytest.mark.parametrize("light", [1.0, 0.5])
def test_a_good_image_needs_nothing(light: float) -> None:
    picture = (edge(2) * light).astype(np.uint8)
    assert (as_needed(picture) == picture).all()


def test_a_grainy_image_is_denoised_as_needed() -> None:
    grainy = edge(40)
    assert (as_needed(grainy) == denoise(grainy)).all()


def test_a_dark_image_is_made_light_and_keeps_its_order() -> None:
    dark = (edge(0) * 0.12).astype(np.uint8)
    light = lighten(dark)
    assert light.max() > 150
    assert (np.diff(light[32, :, 0].astype(int)) >= 0).all()


def test_a_black_image_stays_black() -> None:
    assert not lighten(np.zeros((6, 5, 3), np.uint8)).any()


def test_a_camera_that_becomes_grainy_is_denoised_within_ten_frames_and_no_longer_when_it_is_clear_again() -> None:
    prepare, clear, grainy = AsNeeded(), edge(2), edge(40)
    assert (prepare(clear) == clear).all()
    last = [prepare(grainy) for _ in range(EVALUATED_EVERY)][-1]
    assert (last == denoise(grainy)).all()
    last = [prepare(clear) for _ in range(EVALUATED_EVERY)][-1]
    assert (last == clear).all()
