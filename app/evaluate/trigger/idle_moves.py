"""How hands move that press nothing: anywhere, waving, turning, passing by, and reaching without a gesture."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from app.evaluate.hand_motions import HEIGHT_M, smooth_path, tilted
from hal.cameras.camera import Intrinsics
from hal.cameras.digital_hand.render import Scene
from kgdfa.hand import FloatArray

CLIP_FRAMES = 90
CLEAR_M = 0.03  # beyond the threshold a hand that does not press stays, or beside the button, or gives no gesture
Move = Callable[[np.random.Generator, Scene, float], Iterator[Scene]]  # with the threshold


def wander(draw: np.random.Generator, scene: Scene, threshold_m: float) -> Iterator[Scene]:
    """Anywhere beyond the threshold, with any tilt up to 55°."""
    yield from _along(scene, [_place(draw, scene.lens, threshold_m + CLEAR_M) for _ in range(4)])


def wave(draw: np.random.Generator, scene: Scene, threshold_m: float) -> Iterator[Scene]:
    """Rolling from side to side over the button."""
    z, swing, rate = draw.uniform(threshold_m + CLEAR_M, 0.6), draw.uniform(0.3, 0.9), draw.uniform(1.0, 3.0)
    for frame in range(CLIP_FRAMES):
        phase = math.sin(2 * math.pi * rate * frame / 30)
        yield _put(scene, np.array([0.06 * phase, HEIGHT_M, z, 0.0, 0.3 * phase, swing * phase]))


def turn(draw: np.random.Generator, scene: Scene, threshold_m: float) -> Iterator[Scene]:
    """Turning the palm away and back, over the button."""
    z, most = draw.uniform(threshold_m + CLEAR_M, 0.6), draw.uniform(0.8, math.pi)
    for frame in range(CLIP_FRAMES):
        amount = most * (1 - math.cos(2 * math.pi * frame / CLIP_FRAMES)) / 2
        yield _put(scene, np.array([0.0, HEIGHT_M, z, 0.0, amount, 0.0]))


def pass_by(draw: np.random.Generator, scene: Scene, threshold_m: float) -> Iterator[Scene]:
    """In from one side, across the button nearer than the threshold, out at the other."""
    z = draw.uniform(0.12, threshold_m)
    reach = 0.6 * z * scene.lens.width_px / scene.lens.fx_px
    start, end = (-reach, reach) if draw.random() < 0.5 else (reach, -reach)
    yield from _along(scene, [np.array([x, HEIGHT_M, z, 0.0, 0.0, 0.0]) for x in (start, end, start)])


def reach_without_gesture(draw: np.random.Generator, scene: Scene, threshold_m: float) -> Iterator[Scene]:
    """Straight to the camera and back with a hand that signs nothing."""
    nearest = draw.uniform(0.12, threshold_m)
    far, near = (np.array([0.0, HEIGHT_M, z, 0.0, 0.0, 0.0]) for z in (threshold_m + 0.25, nearest))
    yield from _along(scene, [far, near, far])


MOVES: tuple[Move, ...] = (wander, wave, turn, pass_by, wander, reach_without_gesture)


def _along(scene: Scene, poses: list[FloatArray]) -> Iterator[Scene]:
    return (_put(scene, now) for now in smooth_path(poses, CLIP_FRAMES))


def _place(draw: np.random.Generator, lens: Intrinsics, nearest_m: float) -> FloatArray:
    z = draw.uniform(nearest_m, 0.70)
    reach = 0.5 * z * np.array([lens.width_px, lens.height_px]) / lens.fx_px
    pitch, yaw = tilted(math.radians(draw.uniform(0, 55)), draw.uniform(0, 2 * math.pi))
    x, y = draw.uniform(-reach, reach)
    return np.array([x, y, z, pitch, yaw, draw.uniform(-0.5, 0.5)])


def _put(scene: Scene, now: FloatArray) -> Scene:
    """The scene's hand at (x, y, z), its natural turn plus (pitch, yaw, roll)."""
    assert scene.place is not None
    x, y, z = now[:3].tolist()
    pitch, yaw, roll = (scene.place.turn_rad + now[3:]).tolist()
    return replace(scene, place=replace(scene.place, position_m=(x, y, z), turn_rad=(pitch, yaw, roll)))
