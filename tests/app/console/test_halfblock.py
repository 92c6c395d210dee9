"""The picture in cells."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.console.widgets.halfblock import fit, resample, to_letters, to_strips

PIXELS = np.random.default_rng(1).integers(0, 256, (54, 96, 3), dtype=np.uint8)


def test_two_rows_of_pixels_make_a_row_of_cells_in_their_colours() -> None:
    pixels = np.zeros((4, 3, 3), np.uint8)
    pixels[0] = (255, 0, 0)
    pixels[1] = (0, 0, 255)
    first, second = to_strips(pixels)
    assert first.text == "▀▀▀"
    style = next(iter(first)).style
    assert style is not None
    assert style.color is not None
    assert style.bgcolor is not None
    assert tuple(style.color.get_truecolor()) == (248, 0, 0)
    assert tuple(style.bgcolor.get_truecolor()) == (0, 0, 248)
    assert len(list(second)) == 1, "equal neighbours share a segment"


@given(st.integers(1, 4000), st.integers(1, 4000), st.integers(1, 300), st.integers(1, 100))
def test_the_image_fits_and_is_not_distorted(width_px: int, height_px: int, columns: int, rows: int) -> None:
    width, height = fit(width_px, height_px, columns, rows)
    assert 1 <= width <= max(1, columns)
    assert 2 <= height <= max(2, 2 * rows)
    assert height % 2 == 0


@pytest.mark.parametrize("size", [(96, 54), (40, 22), (200, 112), (1, 2)])
def test_each_pixel_shown_is_one_of_the_image(size: tuple[int, int]) -> None:
    smaller = resample(PIXELS, *size)
    assert smaller.shape == (size[1], size[0], 3)
    known = {tuple(pixel) for pixel in PIXELS.reshape(-1, 3)}
    assert {tuple(pixel) for pixel in smaller.reshape(-1, 3)} <= known


def test_without_colours_brighter_is_more_ink() -> None:
    ramp = np.repeat(np.arange(0, 256, 16, dtype=np.uint8)[None, :, None], 2, axis=0).repeat(3, axis=2)
    (strip,) = to_letters(ramp)
    ink = [" .:-=+*#%@".index(letter) for letter in strip.text]
    assert ink == sorted(ink)
    assert ink[0] == 0
    assert ink[-1] == 9
