"""How views show an image, and where a hand that was found in one is in the image itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kgdfa.augmentation import to_image
from kgdfa.hand import Hand, Side
from kgdfa.views import FULL_VIEW, NEAR_VIEWS, REDETECTION_VIEWS, View, render_view

views = st.builds(View, scale=st.floats(0.3, 1.0), turn_deg=st.floats(-90, 90))


@given(view=views, x=st.floats(250, 390), y=st.floats(120, 240))
def test_a_hand_found_in_a_view_is_reported_where_the_image_has_it(view: View, x: float, y: float) -> None:
    _, transform = render_view(np.zeros((360, 640, 3), np.uint8), view)
    on_view = np.tile((x, y), (21, 1)) @ transform[:, :2].T + transform[:, 2]
    hand = Hand(image_px=on_view, world_m=np.zeros((21, 3)), presence=0.9, side=Side.LEFT)
    assert to_image(hand, transform).image_px == pytest.approx(np.tile((x, y), (21, 1)), abs=1e-6)


@pytest.mark.parametrize("view", REDETECTION_VIEWS, ids=str)
def test_a_view_shows_the_image_where_its_map_reads(view: View) -> None:
    image = np.zeros((360, 640, 3), np.uint8)
    image[195:206, 345:356] = 255
    shown, transform = render_view(image, view)
    assert shown.shape == (image.shape if view == FULL_VIEW else (180, 320, 3))
    spot = np.argwhere(shown[..., 0] > 128).mean(axis=0)[::-1]
    assert spot == pytest.approx(transform[:, :2] @ (350, 200) + transform[:, 2], abs=0.6)


def test_a_turned_hand_is_turned_back_in_space() -> None:
    _, transform = render_view(np.zeros((360, 640, 3), np.uint8), View(scale=0.5, turn_deg=90))
    world = np.zeros((21, 3))
    world[12] = (0.0, -0.08, 0.02)  # fingers up on the image
    turned = Hand(
        image_px=np.zeros((21, 2)),
        world_m=world @ np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]]),
        presence=1,
        side=Side.LEFT,
    )
    assert to_image(turned, transform).world_m[12] == pytest.approx((0.0, -0.08, 0.02))


def test_a_near_view_is_brighter_than_the_image_and_black_around_it() -> None:
    grey = np.full((360, 640, 3), 64, np.uint8)
    shown, _ = render_view(grey, replace(NEAR_VIEWS[1], scale=0.5))
    assert shown[90, 160].tolist() == [128] * 3  # 255 times the root of 64/255
    assert shown[2, 2].tolist() == [0] * 3
    plain, _ = render_view(grey, View(scale=0.5))
    assert plain[2, 2].tolist() == [64] * 3
