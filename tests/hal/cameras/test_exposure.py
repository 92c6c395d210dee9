"""Faults of images that are good, dark, glaring or blurred."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from hal.cameras.digital_hand.render import person_of, posed, render
from hal.cameras.exposure import ImageFault, image_fault


@pytest.fixture(scope="module", params=range(1, 9))
def picture(request: pytest.FixtureRequest) -> np.ndarray:
    return render(posed("5", person=person_of(request.param))).image_bgr


def test_a_good_image_needs_no_hint(picture: np.ndarray) -> None:
    assert image_fault(picture) is None


def test_a_dark_image_is_called_dark(picture: np.ndarray) -> None:
    assert image_fault((picture * 0.12).astype(np.uint8)) is ImageFault.DARK


def test_a_glaring_image_is_called_over_exposed(picture: np.ndarray) -> None:
    assert image_fault(np.clip(picture.astype(int) * 3 + 140, 0, 255).astype(np.uint8)) is ImageFault.OVEREXPOSED


def test_a_blurred_image_is_called_blurred(picture: np.ndarray) -> None:
    assert image_fault(np.asarray(cv2.GaussianBlur(picture, (0, 0), 14.0), dtype=np.uint8)) is ImageFault.BLURRED
