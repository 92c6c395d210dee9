"""Measures a camera's intrinsics from pictures of a chessboard (Zhang's method, as OpenCV has it)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from hal.cameras.camera import ImageArray, Intrinsics, IntrinsicsSource
from hal.errors import HardwareError

LEAST_PICTURES = 5
MOST_RESIDUAL_PX = 1.0  # beyond it the board was bent, blurred or moving
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
        points: NDArray[np.float32] = np.column_stack([grid, np.zeros(len(grid))]).astype(np.float32)
        return points


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibration:
    """residual_px: RMS distance between corners found and corners projected. used: pictures that showed the board."""

    intrinsics: Intrinsics
    residual_px: float
    used: int


def find_corners(image_bgr: ImageArray, board: Board) -> Corners | None:
    """(columns * rows, 1, 2) inner corners to a fraction of a pixel, None when the board is not seen whole."""
    grey = cv2.cvtColor(image_bgr, cv2.COLOR_BGR2GRAY)
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK
    found, corners = cv2.findChessboardCorners(grey, (board.columns, board.rows), flags=flags)
    if not found:
        return None
    return np.asarray(cv2.cornerSubPix(grey, corners, (5, 5), (-1, -1), _REFINED), np.float32)


def calibrate(corners: Iterable[Corners], board: Board, width_px: int, height_px: int) -> Calibration:
    """Intrinsics and the first two terms of radial distortion, from the corners of several pictures.

    Raises HardwareError for too few pictures, or when they don't agree on one lens.
    """
    seen = list(corners)
    if len(seen) < LEAST_PICTURES:
        raise HardwareError(
            f"The chessboard was found in {len(seen)} pictures, {LEAST_PICTURES} are needed: show it whole, "
            f"{board.columns} by {board.rows} inner corners, near and far and tilted."
        )
    flags = cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST
    residual, matrix, distortion, *_ = cv2.calibrateCamera(
        [board.points_m] * len(seen), seen, (width_px, height_px), None, None, flags=flags
    )
    if not (np.isfinite(matrix).all() and residual <= MOST_RESIDUAL_PX):
        raise HardwareError(
            f"The pictures don't agree on one lens (residual {residual:.2f} px, at most {MOST_RESIDUAL_PX:g}): "
            "use a flat board, hold it still, and take them again."
        )
    intrinsics = Intrinsics(
        width_px=width_px,
        height_px=height_px,
        fx_px=float(matrix[0, 0]),
        fy_px=float(matrix[1, 1]),
        cx_px=float(matrix[0, 2]),
        cy_px=float(matrix[1, 2]),
        source=IntrinsicsSource.MEASURED,
        k1=float(distortion.ravel()[0]),
        k2=float(distortion.ravel()[1]),
    )
    return Calibration(intrinsics=intrinsics, residual_px=float(residual), used=len(seen))
