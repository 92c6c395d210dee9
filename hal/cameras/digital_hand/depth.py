"""What a RealSense D435i makes of the true depth, with its documented failures.

A point at z metres lies f·baseline/z pixels farther left in the right imager than in the left one, whose view the map
is: its disparity. From it follow, in pixels of the depth imager scaled to the map's width:

- the invalid depth band: what lies nearer to the left edge than its disparity has no partner in the right imager
  (Intel D400 series data sheet 337029, "Invalid Depth Band": HRes·B/(2·Z·tan(HFOV/2)), which is the same);
- shadows: beside the left edge of what is near the right imager sees that instead, over as many pixels as the two
  disparities differ (Intel, "Projection, Texture-Mapping and Occlusion with Intel RealSense Depth Cameras");
- the noise of subpixel matching, which grows with the square of distance: sd = z² · subpixel / (f · baseline)
  (Intel, "Best-Known-Methods for Tuning D400 Depth Cameras").

Nearer than about 25 cm the map is 0, and it loses patches while the hand flips (the paper's section on the depth
camera). How many at which distance nobody has published: these rates are set, see below.

Beside these, `holes` is a share of frames, drawn by their seed, in which the map misses the hand in one of three ways:
0 all over it (sun, a dark glove), 0 in patches of half of it, or displaced, so that its edge lies across the palm.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from hal.cameras.camera import DepthArray

LEAST_M = 0.25  # below it most of the map is 0, at 1280x720
BASELINE_M = 0.050  # D435i data sheet
SUBPIXEL_PX = 0.08  # disparity noise on textured surfaces
DEPTH_FOCAL_PX = 640.0  # of the D435i's depth imager at 1280x720
DEPTH_WIDTH_PX = 1280
BORDER_SHARE = 0.005  # of the width, at every edge: the matcher's window is not whole there
REACH_M = 0.9  # what is nearer is a hand, not the room
DISPLACED_SHARE = 0.06  # of the width: about half a palm at 40 cm

# Set so that the published mode reproduces the pattern of the paper's Table 6, D435i column: 30 % at 30 cm, 20 % at 35
# and 40, 10 % at 45 and 50, 5 % at 55 and 60, 0 beyond; no source has them. Both say from which distance on a hand does
# not hide itself: a folded finger 4 cm before the palm makes a shadow of 16 px at 30 cm and of 4 at 60.
WINDOW_PX = 10  # at 1280 of width; the matcher's window spans a narrower shadow
FLIP_LOST = 0.02  # of the patches of a flipping hand at FLIP_M; its image moves, and smears, as fast as it is near
FLIP_M = 0.30
FLIP_POWER = 6  # with which that share falls with distance
PATCHES_LOST = 0.5  # at most
PATCH_PX = 40


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
        _blind_edges(measured, surface_m)
        if flipping:
            measured[_smeared(surface_m, draw)] = 0.0
        if self._holes and draw.random() < self._holes:
            measured = _missed(measured, int(draw.integers(3)), draw)
        return measured.astype(np.float32, copy=False)


def _noise(height: int, width: int, draw: np.random.Generator) -> NDArray[np.float32]:
    """Noise of a stereo matcher is as wide as its window: drawn coarse, scaled up."""
    coarse = draw.standard_normal((max(2, height // 4), max(2, width // 4)), dtype=np.float32)
    return np.asarray(cv2.resize(coarse, (width, height), interpolation=cv2.INTER_LINEAR), np.float32)


def _disparity_px(surface_m: DepthArray, width_px: int) -> NDArray[np.float32]:
    """Of each point, in pixels of a map of that width."""
    ahead_m = np.maximum(surface_m, np.float32(0.01))  # a hand may reach through the lens
    return np.asarray(np.float32(DEPTH_FOCAL_PX * BASELINE_M * width_px / DEPTH_WIDTH_PX) / ahead_m, np.float32)


def _shadows(surface_m: DepthArray) -> NDArray[np.bool_]:
    """Where the right imager sees something nearer: a point farther right appears at the same column or left of it."""
    height, width = surface_m.shape
    step = max(1, round(2 * width / DEPTH_WIDTH_PX))  # finer shows no difference
    small = surface_m[::step, ::step]
    appears = np.arange(0, width, step, dtype=np.float32) - _disparity_px(small, width)
    leftmost = np.minimum.accumulate(appears[:, ::-1], axis=1)[:, ::-1]
    hidden = np.zeros(small.shape, np.uint8)
    hidden[:, :-1] = appears[:, :-1] > leftmost[:, 1:]
    window = max(1, round(WINDOW_PX * width / DEPTH_WIDTH_PX / step))
    wide = cv2.morphologyEx(hidden, cv2.MORPH_OPEN, np.ones((1, window), np.uint8))
    return cv2.resize(wide, (width, height), interpolation=cv2.INTER_NEAREST) > 0


def _blind_edges(measured: DepthArray, surface_m: DepthArray) -> None:
    width = measured.shape[1]
    widest = min(width, math.ceil(DEPTH_FOCAL_PX * BASELINE_M * width / DEPTH_WIDTH_PX / LEAST_M))
    columns = np.arange(widest, dtype=np.float32)
    measured[:, :widest][columns < _disparity_px(surface_m[:, :widest], width)] = 0.0
    thin = max(1, round(BORDER_SHARE * width))
    measured[:, :thin] = measured[:, -thin:] = 0.0
    measured[:thin] = measured[-thin:] = 0.0


def _smeared(surface_m: DepthArray, draw: np.random.Generator) -> NDArray[np.bool_]:
    """Where matching fails in an image smeared by the flip: in patches, each as far as its own draw reaches."""
    height, width = surface_m.shape
    drawn = draw.random(_patch_grid(height, width))
    reach_m = FLIP_M * (FLIP_LOST / np.maximum(drawn, np.finfo(float).tiny)) ** (1 / FLIP_POWER)
    reach_m[drawn >= PATCHES_LOST] = 0.0
    return surface_m < cv2.resize(reach_m, (width, height), interpolation=cv2.INTER_NEAREST)


def _patches(height: int, width: int, draw: np.random.Generator) -> NDArray[np.bool_]:
    """About half of the map, in patches."""
    coarse = (draw.random(_patch_grid(height, width)) < 0.5).astype(np.uint8)
    return cv2.resize(coarse, (width, height), interpolation=cv2.INTER_NEAREST) > 0


def _patch_grid(height: int, width: int) -> tuple[int, int]:
    return max(1, height // PATCH_PX), max(1, width // PATCH_PX)


def _missed(measured: DepthArray, how: int, draw: np.random.Generator) -> DepthArray:
    """Without the hand: all of it, in patches, or displaced to one side."""
    height, width = measured.shape
    if how == 0:
        return np.where(measured < REACH_M, np.float32(0.0), measured)
    if how == 1:
        return np.where(_patches(height, width, draw), np.float32(0.0), measured)
    aside = round(DISPLACED_SHARE * width)
    return np.roll(measured, aside if draw.random() < 0.5 else -aside, axis=1)
