"""Intrinsics: whose word counts, what is refused, and a chessboard measured through a known lens."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hal.cameras.camera import ImageArray, Intrinsics, IntrinsicsSource
from hal.cameras.intrinsics import (
    MOST_SQUEEZED,
    Board,
    Corners,
    assumed,
    calibrate,
    choose,
    find_corners,
    load,
    pinhole,
    save,
)
from hal.cameras.intrinsics import given as stated
from hal.errors import CameraFault
from tests.support.errors import refused

BOARD = Board(columns=7, rows=5, square_m=0.03)
LENS = pinhole(640, 360, 480.0, IntrinsicsSource.GIVEN)


def seen_board(lens: Intrinsics, turn: tuple[float, float, float], at_m: tuple[float, float, float]) -> ImageArray:
    """The board as the lens shows it, each pixel asked where its ray meets the board."""
    rotation, _ = cv2.Rodrigues(np.array(turn))
    u, v = np.meshgrid(np.arange(lens.width_px * 2) / 2 - 0.25, np.arange(lens.height_px * 2) / 2 - 0.25)
    rays = np.stack([(u - lens.cx_px) / lens.fx_px, (v - lens.cy_px) / lens.fy_px, np.ones_like(u)], axis=-1)
    normal, centre = rotation[:, 2], np.array(at_m)
    points = rays * ((normal @ centre) / (rays @ normal))[..., None] - centre
    across, down = points @ rotation[:, 0] / BOARD.square_m, points @ rotation[:, 1] / BOARD.square_m
    column, row = np.floor(across + BOARD.columns / 2 + 0.5), np.floor(down + BOARD.rows / 2 + 0.5)
    on_board = (column >= 0) & (column <= BOARD.columns) & (row >= 0) & (row <= BOARD.rows)
    grey = np.where(on_board & ((column + row) % 2 == 0), 30, 225).astype(np.uint8)
    small = cv2.resize(grey, (lens.width_px, lens.height_px), interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.cvtColor(small, cv2.COLOR_GRAY2BGR), dtype=np.uint8)


# Whole but for a distortion that no lens has.
BENT = "[cam]\nwidth_px = 640\nheight_px = 360\nfx_px = 480\nfy_px = 480\ncx_px = 320\ncy_px = 180\nk1 = 99.0\nk2 = 0.0"
VIEWS = [
    ((0.0, 0.0, 0.0), (0.0, 0.0, 0.45)),
    ((0.5, 0.0, 0.1), (-0.06, 0.02, 0.5)),
    ((-0.5, 0.1, 0.0), (0.05, -0.02, 0.5)),
    ((0.0, 0.5, 0.0), (0.0, 0.04, 0.55)),
    ((0.1, -0.5, 0.2), (0.03, 0.0, 0.5)),
    ((0.35, 0.35, -0.2), (-0.03, -0.03, 0.6)),
]


def test_a_chessboard_gives_back_the_lens_that_showed_it() -> None:
    corners = [find_corners(seen_board(LENS, *view), BOARD) for view in VIEWS]
    found = [one for one in corners if one is not None]
    assert len(found) == len(VIEWS)
    result = calibrate(found, BOARD, 640, 360)
    assert result.intrinsics.source is IntrinsicsSource.MEASURED
    assert result.intrinsics.fx_px == pytest.approx(LENS.fx_px, rel=0.01)
    assert result.intrinsics.fy_px == pytest.approx(LENS.fy_px, rel=0.01)
    assert result.intrinsics.cx_px == pytest.approx(LENS.cx_px, abs=4)
    assert result.residual_px < 0.3


def bent(corners: Corners, lens: Intrinsics, k1: float, k2: float) -> Corners:
    """Corners as a lens with radial distortion shows them."""
    centre, focal = (lens.cx_px, lens.cy_px), (lens.fx_px, lens.fy_px)
    straight = (corners - centre) / focal
    radius2 = (straight**2).sum(axis=-1, keepdims=True)
    return np.asarray(straight * (1 + k1 * radius2 + k2 * radius2**2) * focal + centre, np.float32)


def test_radial_distortion_is_solved_kept_and_read_back(tmp_path: Path) -> None:
    corners = [find_corners(seen_board(LENS, *view), BOARD) for view in VIEWS]
    distorted = [bent(one, LENS, -0.2, 0.05) for one in corners if one is not None]
    found = calibrate(distorted, BOARD, 640, 360).intrinsics
    assert found.k1 == pytest.approx(-0.2, abs=0.04)
    assert found.fx_px == pytest.approx(LENS.fx_px, rel=0.01)
    save(tmp_path / "cameras.toml", "cam", found, 0.1, print)
    assert load(tmp_path / "cameras.toml", "cam") == found


def test_a_distortion_that_could_not_be_read_back_is_refused() -> None:
    corners = [find_corners(seen_board(LENS, *view), BOARD) for view in VIEWS]
    with refused(CameraFault.CHESSBOARDS_ALIKE):
        calibrate([bent(one, LENS, 0.0, 20.0) for one in corners if one is not None], BOARD, 640, 360)


def test_boards_that_all_face_the_camera_measure_no_lens() -> None:
    """Near and far look alike there: the residual is small, and the focal length may be anything."""
    draw = np.random.default_rng(1)
    tilts = ((0.0, 0.0), (0.08, 0.0), (-0.08, 0.02), (0.0, 0.08), (0.03, -0.08), (0.05, 0.05))
    views = [((*tilt, 0.1), at) for tilt, (_, at) in zip(tilts, VIEWS, strict=True)]
    corners = [find_corners(seen_board(LENS, *view), BOARD) for view in views]
    noisy = [one + draw.normal(0, 0.2, one.shape).astype(np.float32) for one in corners if one is not None]
    assert len(noisy) == len(views)
    with refused(CameraFault.CHESSBOARDS_ALIKE):
        calibrate(noisy, BOARD, 640, 360)


@pytest.mark.parametrize("seed", range(5))
def test_noise_makes_no_pixels_seem_squeezed(seed: int) -> None:
    draw = np.random.default_rng(seed)
    corners = [find_corners(seen_board(LENS, *view), BOARD) for view in VIEWS]
    noisy = [one + draw.normal(0, 0.25, one.shape).astype(np.float32) for one in corners if one is not None]
    found = calibrate(noisy, BOARD, 640, 360).intrinsics
    assert found.fy_px / found.fx_px == pytest.approx(1.0, abs=MOST_SQUEEZED / 2)


@pytest.mark.parametrize("across", [0.75, 0.9, 0.95, 1.05])
def test_a_mode_that_squeezes_its_images_is_refused(across: float) -> None:
    """Every distance is measured by one focal length."""
    corners = [find_corners(seen_board(LENS, *view), BOARD) for view in VIEWS]
    squeezed = [np.asarray(one * (across, 1.0), np.float32) for one in corners if one is not None]
    width_px = round(640 * across)
    with refused(CameraFault.SQUEEZED, width_px=width_px, height_px=360):
        calibrate(squeezed, BOARD, width_px, 360)


def test_an_image_without_a_board_shows_none() -> None:
    assert find_corners(np.full((360, 640, 3), 128, np.uint8), BOARD) is None


def test_too_few_images_are_refused_with_what_to_show() -> None:
    with refused(CameraFault.TOO_FEW_CHESSBOARDS, found=0, needed=5):
        calibrate([], BOARD, 640, 360)


def test_corners_of_no_one_lens_are_refused() -> None:
    draw = np.random.default_rng(1)
    corners = [find_corners(seen_board(LENS, *view), BOARD) for view in VIEWS]
    shaken = [one + draw.normal(0, 8, one.shape).astype(np.float32) for one in corners if one is not None]
    with refused(CameraFault.CHESSBOARDS_DISAGREE):
        calibrate(shaken, BOARD, 640, 360)


@given(width=st.integers(160, 4096), height=st.integers(160, 4096))
def test_assumed_intrinsics_are_marked_and_scale_with_the_long_side(width: int, height: int) -> None:
    lens = assumed(width, height)
    assert lens.source is IntrinsicsSource.ASSUMED
    assert lens.fx_px / max(width, height) == pytest.approx(950 / 1280)
    assert lens.fx_px == lens.fy_px == assumed(height, width).fx_px  # a camera on its side has the same lens


def test_what_is_not_permitted_is_not_kept(tmp_path: Path) -> None:
    store = tmp_path / "cameras.toml"
    save(store, "cam", LENS, 0.2, print)
    before, asked = store.read_bytes(), []

    def refuse(values: dict[str, tuple[object, object]]) -> None:
        asked.append(values)
        raise PermissionError

    with refused(CameraFault.INTRINSICS_UNWRITABLE):
        save(store, "cam", pinhole(640, 360, 450.0, IntrinsicsSource.MEASURED), 0.1, refuse)
    assert asked[0]["fx_px"] == (480.0, 450.0)
    assert store.read_bytes() == before


@pytest.mark.parametrize("focal", [0.0, -5.0, float("nan"), float("inf")])
def test_an_impossible_focal_length_is_refused(focal: float) -> None:
    with refused(CameraFault.FOCAL_LENGTH_OUT_OF_RANGE):
        stated(1280, 720, focal)


def test_stated_wins_over_measured_and_measured_over_assumed(tmp_path: Path) -> None:
    store = tmp_path / "cameras.toml"
    assert choose(640, 360, camera="cam", store=store).source is IntrinsicsSource.ASSUMED
    save(store, "cam", LENS, 0.2, print)
    measured = choose(640, 360, camera="cam", store=store)
    assert (measured.source, measured.fx_px) == (IntrinsicsSource.MEASURED, 480.0)
    assert choose(640, 360, camera="other", store=store).source is IntrinsicsSource.ASSUMED
    assert choose(640, 360, camera="cam", focal_px=500.0, store=store).fx_px == 500.0


def test_intrinsics_of_another_resolution_are_refused_by_name(tmp_path: Path) -> None:
    store = tmp_path / "cameras.toml"
    save(store, "cam", LENS, 0.2, print)
    with refused(CameraFault.OTHER_RESOLUTION, camera="cam", width_px=640, image_width_px=1280):
        choose(1280, 720, camera="cam", store=store)


def test_cameras_are_kept_beside_each_other_whatever_their_names(tmp_path: Path) -> None:
    store = tmp_path / "deep" / "cameras.toml"
    for name, focal in (('Cam "A" [1].b', 400.0), ("相机", 500.0), ('Cam "A" [1].b', 450.0)):
        save(store, name, pinhole(640, 360, focal, IntrinsicsSource.MEASURED), 0.1, print)
    kept = [load(store, name) for name in ('Cam "A" [1].b', "相机")]
    assert [lens.fx_px for lens in kept if lens] == [450.0, 500.0]


@pytest.mark.parametrize(
    "text", ["not toml [", "cam = 5", "[cam]\nwidth_px = 1", '[cam]\nwidth_px="x"', "\x00", "[cam]\nfx_px = -1", BENT]
)
def test_a_broken_store_is_refused_by_name(tmp_path: Path, text: str) -> None:
    store = tmp_path / "cameras.toml"
    store.write_text(text)
    with refused(CameraFault.INTRINSICS_UNREADABLE):
        load(store, "cam")
