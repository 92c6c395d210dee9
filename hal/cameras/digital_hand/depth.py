"""What a RealSense D435i makes of the true depth, with its documented failures.

Zero readings (the paper's section on the depth camera; Intel D400 series data sheet for the least distance):
nearer than about 25 cm, at the image's edge, around depth jumps, in patches while the hand flips. The noise of
a stereo camera grows with the square of distance: sd = z² · subpixel / (f · baseline).

Beside these, `holes` is a share of frames, drawn by their seed, in which the map misses the hand in one of three ways:
0 all over it (sun, a dark glove), 0 in patches of half of it, or displaced, so that its edge lies across the palm.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from hal.cameras.camera import DepthArray

LEAST_M = 0.25  # below it most of the map is 0, at 1280x720
BASELINE_M = 0.050  # D435i data sheet
SUBPIXEL_PX = 0.08  # disparity noise on textured surfaces
DEPTH_FOCAL_PX = 640.0  # of the D435i's depth imager at 1280x720
EDGE_SHARE = 0.04  # of the width: stereo has no partner there
JUMP_M = 0.03  # a step in depth that leaves a shadow
SHADOW_PX = 7  # half width of the shadow around a jump, at 1280 pixels of width
PATCH_PX = 40
REACH_M = 0.9  # what is nearer is a hand, not the room
DISPLACED_SHARE = 0.06  # of the width: about half a palm at 40 cm


class DepthCamera:
    """The D435i's stereo as a function of true depth and a seed."""

    def __init__(self, seed: int = 0, *, holes: float = 0.0) -> None:
        """seed: another camera of the same kind. holes: 0-1, in so many frames it misses the hand."""
        self._seed = seed
        self._holes = holes

    def measure(self, surface_m: DepthArray, noise_seed: int, flipping: bool = False) -> DepthArray:
        """(h, w) true depth in metres to (h, w) float32 as measured, millimetre steps, 0 where it fails."""
        draw = np.random.default_rng([self._seed, noise_seed])
        noise = _noise(surface_m.shape[0], surface_m.shape[1], draw)
        sd = surface_m * surface_m * np.float32(SUBPIXEL_PX / (DEPTH_FOCAL_PX * BASELINE_M))
        measured = np.round((surface_m + sd * noise) * np.float32(1000.0)) / np.float32(1000.0)
        measured[surface_m < LEAST_M] = 0.0
        measured[_shadows(surface_m)] = 0.0
        _blind_edges(measured)
        if flipping:
            measured[_patches(surface_m.shape[0], surface_m.shape[1], draw)] = 0.0
        if self._holes and draw.random() < self._holes:
            measured = _missed(measured, int(draw.integers(3)), draw)
        kept: DepthArray = measured.astype(np.float32, copy=False)
        return kept


def _noise(height: int, width: int, draw: np.random.Generator) -> NDArray[np.float32]:
    """Noise of a stereo matcher is as wide as its window: drawn coarse, scaled up."""
    coarse = draw.standard_normal((max(2, height // 4), max(2, width // 4)), dtype=np.float32)
    return np.asarray(cv2.resize(coarse, (width, height), interpolation=cv2.INTER_LINEAR), np.float32)


def _shadows(surface_m: DepthArray) -> NDArray[np.bool_]:
    small = cv2.resize(surface_m, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_NEAREST)
    kernel = np.ones((3, 3), np.uint8)
    jump = (cv2.dilate(small, kernel) - cv2.erode(small, kernel) > JUMP_M).astype(np.uint8)
    reach = max(1, round(SHADOW_PX * surface_m.shape[1] / 1280 / 4))
    wide = cv2.dilate(jump, np.ones((1, 2 * reach + 1), np.uint8))
    full = cv2.resize(wide, (surface_m.shape[1], surface_m.shape[0]), interpolation=cv2.INTER_NEAREST)
    shadows: NDArray[np.bool_] = full > 0
    return shadows


def _blind_edges(measured: DepthArray) -> None:
    border = max(1, round(EDGE_SHARE * measured.shape[1]))
    measured[:, :border] = 0.0
    measured[:, -border:] = 0.0
    thin = max(1, border // 4)
    measured[:thin] = 0.0
    measured[-thin:] = 0.0


def _patches(height: int, width: int, draw: np.random.Generator) -> NDArray[np.bool_]:
    """Where matching fails in an image smeared by the flip: about half of it, in patches."""
    coarse = (draw.random((max(1, height // PATCH_PX), max(1, width // PATCH_PX))) < 0.5).astype(np.uint8)
    lost: NDArray[np.bool_] = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_NEAREST) > 0
    return lost


def _missed(measured: DepthArray, how: int, draw: np.random.Generator) -> DepthArray:
    """Without the hand: all of it, in patches, or displaced to one side."""
    height, width = measured.shape
    if how == 0:
        return np.where(measured < REACH_M, np.float32(0.0), measured)
    if how == 1:
        return np.where(_patches(height, width, draw), np.float32(0.0), measured)
    aside = round(DISPLACED_SHARE * width)
    return np.roll(measured, aside if draw.random() < 0.5 else -aside, axis=1)
