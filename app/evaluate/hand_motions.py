"""Motions of the digital hand before a camera, frame by frame: held, moved at random, or changed while it is near."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hal.cameras.camera import DepthArray, ImageArray, Intrinsics
from hal.cameras.digital_hand.depth import DepthCamera
from hal.cameras.digital_hand.render import WALL_M, Person, Scene, keypoints_m, posed, render
from hal.cameras.digital_hand.skeleton import HandPlace, find_pose
from kgdfa.hand import FloatArray, Keypoint

PALM = (Keypoint.INDEX_MCP, Keypoint.PINKY_MCP)  # keypoint 21 lies between them
HEIGHT_M = 0.015  # keypoint 21 below the image's centre: fingers and wrist then have equal room
EDGE_SHARE = 0.46  # of the image's width from its middle: keypoint 21 is in the image still, half of the hand is not
FLIP, OPEN_CLOSE, EDGE, BACKGROUND = CHANGES = ("flip", "open and close", "edge", "background jump")


@dataclass(frozen=True, slots=True, kw_only=True)
class Moment:
    """One frame to come. flipping: the depth camera fails in patches. wall_m: what lies behind the hand."""

    scene: Scene
    flipping: bool = False
    wall_m: float = WALL_M

    @property
    def true_m(self) -> float:
        """Distance of keypoint 21."""
        joints = keypoints_m(self.scene)
        assert joints is not None
        return float(joints[list(PALM), 2].mean())


def take(moment: Moment, noise_seed: int, depth: DepthCamera | None = None) -> tuple[ImageArray, DepthArray | None]:
    """The image, and the depth map as a D435i would measure it, when there is one."""
    rendered = render(moment.scene, noise_seed, depth=depth is not None)
    if depth is None or rendered.surface_m is None:
        return rendered.image_bgr, None
    surface = np.where(rendered.surface_m == np.float32(WALL_M), np.float32(moment.wall_m), rendered.surface_m)
    return rendered.image_bgr, depth.measure(surface.astype(np.float32), noise_seed, moment.flipping)


def held(
    gesture: str,
    *,
    person: Person,
    lens: Intrinsics,
    distance_m: float,
    turn_rad: tuple[float, float],
    seed: int,
    frames: int,
) -> Iterator[Moment]:
    """A hand held still, with a person's tremor: 2 mm and half a degree."""
    draw = np.random.default_rng([seed, round(distance_m * 1000)])
    for _ in range(frames):
        shake_m, shake_rad = draw.normal(0, 0.002, 2), draw.normal(0, 0.01, 3)
        turn = (turn_rad[0] + shake_rad[0], turn_rad[1] + shake_rad[1], shake_rad[2])
        position = (float(shake_m[0]), HEIGHT_M + float(shake_m[1]), distance_m)
        yield Moment(scene=posed(gesture, person=person, lens=lens, position_m=position, turn_rad=turn))


def tilted(angle_rad: float, direction_rad: float) -> tuple[float, float]:
    """Pitch and yaw of a tilt of that size towards that direction."""
    return angle_rad * math.sin(direction_rad), angle_rad * math.cos(direction_rad)


def walk(gesture: str, *, person: Person, lens: Intrinsics, seed: int, frames: int) -> Iterator[Moment]:
    """A second of random movement through three places and poses: 14 to 70 cm, tilts to 55°, all over the image."""
    draw = np.random.default_rng([seed, 0x77616C6B])
    poses = [_pose(draw, lens) for _ in range(3)]
    for now in smooth_path(poses, frames):
        x, y, z, pitch, yaw, roll = now.tolist()
        yield Moment(scene=posed(gesture, person=person, lens=lens, position_m=(x, y, z), turn_rad=(pitch, yaw, roll)))


def _pose(draw: np.random.Generator, lens: Intrinsics) -> FloatArray:
    z = draw.uniform(0.14, 0.70)
    reach = 0.6 * z * np.array([lens.width_px, lens.height_px]) / 2 / lens.fx_px
    pitch, yaw = tilted(math.radians(draw.uniform(0, 55)), draw.uniform(0, 2 * math.pi))
    x, y = draw.uniform(-reach, reach)
    return np.array([x, y + HEIGHT_M, z, pitch, yaw, draw.uniform(-0.4, 0.4)])


def smooth_path(poses: Sequence[FloatArray], frames: int) -> Iterator[FloatArray]:
    """So many places from the first pose through all of them to the last, at rest in each."""
    legs = len(poses) - 1
    for frame in range(frames):
        along = legs * frame / max(1, frames - 1)
        first = min(legs - 1, int(along))
        share = smooth(along - first)
        yield poses[first] * (1 - share) + poses[first + 1] * share


def smooth(share: float) -> float:
    """0 to 1 with no jerk at either end."""
    held_share = min(1.0, max(0.0, share))
    return held_share * held_share * (3 - 2 * held_share)


def approach_and_change(
    change: str,
    *,
    person: Person,
    lens: Intrinsics,
    distance_m: float,
    frames: tuple[int, int, int],
    leftwards: bool = False,
) -> Iterator[Moment]:
    """Gesture 5 shown 15 cm farther out (at least 35 cm), brought to the distance, there changed in posture.

    frames: showing, approaching, changing. leftwards: to which edge of the image.
    """
    start_m = max(0.35, distance_m + 0.15)
    showing, approaching, changing = frames
    still = posed("5", person=person, lens=lens, position_m=(0.0, HEIGHT_M, start_m))
    for frame in range(showing + approaching):
        share = smooth((frame - showing + 1) / approaching)
        z = start_m + (distance_m - start_m) * share
        yield Moment(scene=_moved(still, z=z))
    there = _moved(still, z=distance_m)
    for frame in range(changing):
        amount, late = math.sin(math.pi * (frame + 1) / (changing + 1)), frame >= changing // 2
        yield _changed(change, there, amount, late=late, leftwards=leftwards)


def _changed(change: str, there: Scene, amount: float, *, late: bool, leftwards: bool) -> Moment:
    """The scene with the change done to 0-1 and back again."""
    assert there.place is not None
    if change == FLIP:
        return Moment(scene=_moved(there, yaw=math.pi * amount), flipping=True)
    if change == OPEN_CLOSE:
        fist = find_pose("0").angles_deg
        angles = there.angles_deg * (1 - amount) + fist * amount
        return Moment(scene=replace(there, angles_deg=angles), flipping=True)
    if change == EDGE:
        edge_m = EDGE_SHARE * there.lens.width_px / there.lens.fx_px * there.place.position_m[2]
        return Moment(scene=_moved(there, x=(-edge_m if leftwards else edge_m) * amount))
    behind = replace(there.person, room_seed=there.person.room_seed + 1) if late else there.person
    return Moment(scene=replace(there, person=behind), wall_m=there.place.position_m[2] + 0.15 if late else WALL_M)


def _moved(scene: Scene, *, x: float | None = None, z: float | None = None, yaw: float = 0.0) -> Scene:
    assert scene.place is not None
    was, (pitch, before, roll) = scene.place.position_m, scene.place.turn_rad
    position = (was[0] if x is None else x, was[1], was[2] if z is None else z)
    return replace(scene, place=HandPlace(position_m=position, turn_rad=(pitch, before + yaw, roll)))
