from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kgdfa.errors import KgdfaError
from kgdfa.hand import Hand, Side, is_cut_off
from kgdfa.press_zone import LEAST_THRESHOLD_M, PressZone, ZoneAssessment, press_zone


def hand_at(*points: tuple[float, float]) -> Hand:
    image = np.full((21, 2), (100.0, 100.0))
    image[: len(points)] = points
    return Hand(image_px=image, world_m=np.zeros((21, 3)), presence=0.9, side=Side.RIGHT)


def zone_of(reference_m: float, **camera: float) -> PressZone:
    return press_zone(**camera, reference_m=reference_m, palm_width_m=reference_m / 0.75)  # type: ignore[arg-type]


def test_the_issue_s_two_lenses() -> None:
    wide = zone_of(0.0615, focal_px=650, width_px=1280, height_px=720)
    narrow = zone_of(0.0615, focal_px=950, width_px=1280, height_px=720)
    assert wide.threshold_m == LEAST_THRESHOLD_M
    assert narrow.threshold_m > LEAST_THRESHOLD_M
    assert narrow.possible
    assert wide.fits(0.20)
    assert not narrow.fits(0.20)
    assert wide.explain().code is ZoneAssessment.USABLE


@given(focal_px=st.floats(200, 3000), reference_m=st.floats(0.03, 0.12), height_px=st.integers(240, 2160))
def test_the_proposed_threshold_leaves_room_on_both_sides(focal_px: float, reference_m: float, height_px: int) -> None:
    zone = zone_of(reference_m, focal_px=focal_px, width_px=4000, height_px=height_px)
    assert zone.threshold_m > zone.followed_from_m
    assert zone.rest_beyond_m > zone.threshold_m
    assert zone.whole_from_m > zone.followed_from_m
    assert zone.fits(zone.threshold_m) == zone.possible


@pytest.mark.parametrize(
    ("arm_rad", "width_px", "height_px", "whole_m"),
    [
        (0.0, 1280, 720, 0.260),
        (np.pi / 2, 1280, 720, 0.197),  # a hand from a side lies along the image, and is soon too large to be followed
        (np.pi / 2, 720, 1280, 0.260),
        (np.pi, 1280, 720, 0.260),
        (None, 720, 1280, 0.260),
    ],
)
def test_a_hand_is_whole_along_the_side_that_its_arm_comes_from(
    arm_rad: float | None, width_px: int, height_px: int, whole_m: float
) -> None:
    zone = press_zone(
        focal_px=950,
        width_px=width_px,
        height_px=height_px,
        reference_m=0.0615,
        palm_width_m=0.082,
        arm_rad=arm_rad,
    )
    assert zone.whole_from_m == pytest.approx(whole_m, abs=0.001)


def test_a_lens_too_long_for_any_press_is_reported() -> None:
    zone = zone_of(0.0615, focal_px=2500, width_px=1280, height_px=720)
    assert not zone.possible
    assert zone.explain().code is ZoneAssessment.TOO_FAR


@pytest.mark.parametrize(
    ("focal_px", "width_px", "reference_m"), [(0, 1280, 0.06), (900, 0, 0.06), (900, -1, 0.06), (900, 1280, 0.2)]
)
def test_what_is_no_camera_or_palm_is_refused(focal_px: float, width_px: int, reference_m: float) -> None:
    with pytest.raises(KgdfaError):
        zone_of(reference_m, focal_px=focal_px, width_px=width_px, height_px=720)


def test_a_hand_is_cut_off_when_any_keypoint_is_out() -> None:
    assert not is_cut_off(hand_at((0, 0), (1279, 719)), 1280, 720)
    assert is_cut_off(hand_at((640, -1)), 1280, 720)
    assert is_cut_off(hand_at((1280, 300)), 1280, 720)
