"""A camera's intrinsics: assumed from a field of view, given as a focal length, or measured on a chessboard (Zhang)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import tomlkit
from numpy.typing import NDArray

from hal.cameras.camera import ImageArray, Intrinsics, IntrinsicsSource
from hal.errors import CameraFault, HardwareError
from logs.reading.errors import cause_of
from logs.reading.formats import MAX_TOML, parse_toml
from logs.reading.regular import read_text

# An ordinary 16:9 webcam sees about 68 degrees across, which is 950 px of focal length at 1280 pixels.
_ASSUMED_FOCAL_SHARE = 950.0 / 1280.0
# Narrower is a telescope, wider no pinhole: depth cameras see 40 to 100 degrees (D435i: 42 to 87, Intel's data sheet).
LEAST_FIELD_RAD, MOST_FIELD_RAD = math.radians(10.0), math.radians(170.0)


def assumed(width_px: int, height_px: int) -> Intrinsics:
    """What an ordinary webcam has; marked as assumed."""
    return pinhole(width_px, height_px, assumed_focal_px(width_px, height_px), IntrinsicsSource.ASSUMED)


def assumed_focal_px(width_px: float, height_px: float) -> float:
    """The focal length of an ordinary webcam: a share of the long side, so a camera on its side reads the same."""
    return _ASSUMED_FOCAL_SHARE * max(width_px, height_px)


def given(width_px: int, height_px: int, focal_px: float) -> Intrinsics:
    """From a focal length that is given. Raises HardwareError when it can't be one."""
    if not 0 < focal_px < 100_000:
        raise HardwareError(CameraFault.FOCAL_LENGTH_OUT_OF_RANGE, focal_px=focal_px, width_px=width_px)
    return pinhole(width_px, height_px, focal_px, IntrinsicsSource.GIVEN)


def pinhole(width_px: int, height_px: int, focal_px: float, source: IntrinsicsSource) -> Intrinsics:
    """Square pixels, the axis through the image's middle."""
    return Intrinsics(
        width_px=width_px,
        height_px=height_px,
        fx_px=focal_px,
        fy_px=focal_px,
        cx_px=(width_px - 1) / 2,
        cy_px=(height_px - 1) / 2,
        source=source,
    )


def check_size(intrinsics: Intrinsics, width_px: int, height_px: int, camera: str) -> None:
    """Refuse intrinsics of another resolution. Raises HardwareError naming both."""
    if (intrinsics.width_px, intrinsics.height_px) != (width_px, height_px):
        raise HardwareError(
            CameraFault.OTHER_RESOLUTION,
            camera=camera,
            width_px=intrinsics.width_px,
            height_px=intrinsics.height_px,
            image_width_px=width_px,
            image_height_px=height_px,
        )


def check_possible(lens: Intrinsics, width_px: int, height_px: int, *, camera: str, fault: CameraFault) -> None:
    """Refuse a lens that a device or file states and that can't belong to its images of that size.

    Raises HardwareError with that fault: a size that differs, a focal length that is none or sees an absurd field, a
    principal point outside the image.
    """
    size = lens.width_px, lens.height_px
    inside = 0 <= lens.cx_px < width_px and 0 <= lens.cy_px < height_px  # false for what is not finite
    focal = lens.fx_px, lens.fy_px
    if size == (width_px, height_px) and inside and all(map(_possible_focal, size, focal)):
        return
    stated = {name: getattr(lens, name) for name in ("width_px", "height_px", *_LENGTHS)}
    raise HardwareError(fault, camera=camera, **stated, image_width_px=width_px, image_height_px=height_px)


def _possible_focal(pixels: int, focal_px: float) -> bool:
    """Whether a lens of that focal length sees no absurd field along that many pixels."""
    if not (math.isfinite(focal_px) and focal_px > 0):
        return False
    return LEAST_FIELD_RAD <= 2 * math.atan(pixels / 2 / focal_px) <= MOST_FIELD_RAD


def choose(
    width_px: int,
    height_px: int,
    *,
    camera: str,
    focal_px: float | None = None,
    focal_size_px: tuple[int, int] | None = None,
    store: Path | None = None,
) -> Intrinsics:
    """A stated focal length wins over a measured one, a measured one over the assumed field of view.

    focal_size_px: width and height of the images that `focal_px` is of; None: of these. store: a cameras.toml.
    Raises HardwareError when it is broken, or measured or stated for another resolution only.
    """
    if focal_px is not None:
        _check_focal_size(camera, focal_size_px or (width_px, height_px), (width_px, height_px))
        return given(width_px, height_px, focal_px)
    measured = load(store, camera) if store is not None else None
    if measured is None:
        return assumed(width_px, height_px)
    check_size(measured, width_px, height_px, camera)
    _check_square(measured)
    return measured


def _check_focal_size(camera: str, stated_px: tuple[int, int], image_px: tuple[int, int]) -> None:
    """Raises HardwareError where the images have another size than the one that a focal length is given for."""
    if stated_px == image_px:
        return
    stated = {"width_px": stated_px[0], "height_px": stated_px[1]}
    taken = {"image_width_px": image_px[0], "image_height_px": image_px[1]}
    raise HardwareError(CameraFault.FOCAL_LENGTH_OTHER_SIZE, camera=camera, **stated, **taken)


def _check_square(lens: Intrinsics) -> None:
    """Distances use one focal length. Raises HardwareError for a mode that squeezes its images.

    `calibrate` fits two: with one, OpenCV takes boards of a squeezed mode for tilted ones, at any focal length.
    """
    if abs(lens.fy_px / lens.fx_px - 1) > MOST_SQUEEZED:
        raise HardwareError(CameraFault.SQUEEZED, width_px=lens.width_px, height_px=lens.height_px)


def load(store: Path, camera: str) -> Intrinsics | None:
    """What was measured for this camera, None when nothing was. Raises HardwareError for a broken file."""
    if not store.exists():
        return None
    try:
        entry: dict[str, Any] | None = parse_toml(read_text(store, MAX_TOML)).get(camera)
        if entry is None:
            return None
        return _measured(entry)
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise HardwareError(CameraFault.INTRINSICS_UNREADABLE, path=store, detail=cause_of(error)) from error


def _measured(values: Mapping[str, Any]) -> Intrinsics:
    """Intrinsics from their values. Raises ValueError, KeyError or TypeError for what no camera has."""
    return Intrinsics(
        width_px=int(values["width_px"]),
        height_px=int(values["height_px"]),
        source=IntrinsicsSource.MEASURED,
        **{name: _between(values[name], 0, 100_000, "length in pixels") for name in _LENGTHS},
        **{name: _between(values.get(name, 0.0), -10, 10, "lens distortion") for name in _DISTORTION},
    )


_LENGTHS = ("fx_px", "fy_px", "cx_px", "cy_px")
_DISTORTION = ("k1", "k2")  # files of before have none
Permit = Callable[[dict[str, tuple[Any, Any]]], object]  # field → before, after; raises when it may not be changed


def save(store: Path, camera: str, intrinsics: Intrinsics, residual_px: float, permit: Permit) -> None:
    """Keep measured intrinsics beside those of other cameras, if permitted.

    Raises HardwareError when it can't be written.
    """
    try:
        kept = read_text(store, MAX_TOML) if store.exists() else ""
        parse_toml(kept)  # refuses what tomlkit would take
        document = tomlkit.parse(kept)
        values = {name: value for name, value in asdict(intrinsics).items() if name != "source"}
        former = dict(document.get(camera, {}))
        permit({name: (former.get(name), value) for name, value in values.items() if former.get(name) != value})
        document[camera] = values | {"residual_px": round(residual_px, 4)}
        store.parent.mkdir(parents=True, exist_ok=True)
        fresh = store.with_suffix(".new")
        fresh.write_text(tomlkit.dumps(document), encoding="utf-8")
        fresh.replace(store)
    except (OSError, ValueError) as error:
        raise HardwareError(CameraFault.INTRINSICS_UNWRITABLE, path=store, detail=cause_of(error)) from error


def _between(value: Any, low: float, high: float, what: str) -> float:
    number = float(value)
    if not low < number < high:
        raise ValueError(f"{number:g} is no {what}")
    return number


MIN_IMAGES = 5
MAX_RESIDUAL_PX = 1.0  # beyond it the board was bent, blurred or moving
# Between two of the boards at least. Below, a nearer board looks like a longer lens: of 48 simulated series with 0.2 to
# 0.3 px of noise all from 20 degrees on came within 3.4 % of the focal length, others as low as a sixth of it.
MIN_TILT_RAD = np.radians(20)
MOST_SQUEEZED = 0.02  # of noise and of a print; PAL's pixels are 12:11, NTSC's 10:11 (ITU-R BT.601)
_REFINED = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 0.01)

Corners = NDArray[np.float32]


@dataclass(frozen=True, slots=True, kw_only=True)
class Board:
    """Inner corners across and down, and the side of a square in metres."""

    columns: int = 9
    rows: int = 6
    square_m: float = 0.025

    @property
    def points_m(self) -> NDArray[np.float32]:
        """(columns * rows, 3) corners on the board, row by row."""
        grid = np.mgrid[0 : self.columns, 0 : self.rows].T.reshape(-1, 2) * self.square_m
        return np.column_stack([grid, np.zeros(len(grid))]).astype(np.float32)


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibration:
    """residual_px: RMS distance between corners found and corners projected. used: images that showed the board."""

    intrinsics: Intrinsics
    residual_px: float
    used: int


def find_corners(image_bgr: ImageArray, board: Board) -> Corners | None:
    """(columns * rows, 1, 2) inner corners to a fraction of a pixel, None when the board is not visible whole."""
    grey = cv2.cvtColor(image_bgr, cv2.COLOR_BGR2GRAY)
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK
    found, corners = cv2.findChessboardCorners(grey, (board.columns, board.rows), flags=flags)
    if not found:
        return None
    return np.asarray(cv2.cornerSubPix(grey, corners, (5, 5), (-1, -1), _REFINED), np.float32)


def calibrate(corners: Iterable[Corners], board: Board, width_px: int, height_px: int) -> Calibration:
    """Intrinsics and the first two terms of radial distortion, from the corners of several images.

    Raises HardwareError for too few images, when they don't agree on one lens, or show too little of it.
    """
    found = list(corners)
    if len(found) < MIN_IMAGES:
        raise HardwareError(
            CameraFault.TOO_FEW_CHESSBOARDS,
            found=len(found),
            needed=MIN_IMAGES,
            columns=board.columns,
            rows=board.rows,
        )
    flags = cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST
    residual, matrix, distortion, turns, _ = cv2.calibrateCamera(
        [board.points_m] * len(found), found, (width_px, height_px), None, None, flags=flags
    )
    if not (np.isfinite(matrix).all() and residual <= MAX_RESIDUAL_PX):
        raise HardwareError(CameraFault.CHESSBOARDS_DISAGREE, residual_px=float(residual), limit_px=MAX_RESIDUAL_PX)
    normals = np.array([cv2.Rodrigues(turn)[0][:, 2] for turn in turns])
    if (normals @ normals.T).min() > np.cos(MIN_TILT_RAD):
        raise HardwareError(CameraFault.CHESSBOARDS_ALIKE)
    values = {
        "width_px": width_px,
        "height_px": height_px,
        "fx_px": matrix[0, 0],
        "fy_px": matrix[1, 1],
        "cx_px": matrix[0, 2],
        "cy_px": matrix[1, 2],
        "k1": distortion.ravel()[0],
        "k2": distortion.ravel()[1],
    }
    try:
        intrinsics = _measured(values)
    except ValueError as error:
        raise HardwareError(CameraFault.CHESSBOARDS_ALIKE) from error
    _check_square(intrinsics)
    return Calibration(intrinsics=intrinsics, residual_px=float(residual), used=len(found))
