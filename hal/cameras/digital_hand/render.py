"""A person's hand in a room, and the image a camera takes of it: a pure function of its arguments."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from hal.cameras.camera import DepthArray, ImageArray, Intrinsics, IntrinsicsSource
from hal.cameras.digital_hand.raycast import Grid, capsules_of, cast, grid_over
from hal.cameras.digital_hand.shading import Light, Painted, paint, palm_lines, room_bgr
from hal.cameras.digital_hand.skeleton import FloatArray, HandPlace, HandShape, find_pose, joints_m, placed_m
from hal.cameras.intrinsics import pinhole

DEFAULT_FOCAL_PX = 650.0  # at 1280 pixels of width: wide enough to hold the fingertips at 15 cm
CELLS_PER_M = 700.0  # of the coarse grid on the hand; finer shows no difference to the detector
WALL_M = 1.2  # what a depth camera sees beside the hand
NOISE_BANK = 4

# Skin in BGR under a white lamp, from very light to very dark.
TONES_BGR = (
    (178, 200, 238), (158, 184, 228), (138, 166, 214), (116, 146, 198),
    (98, 126, 180), (76, 104, 158), (60, 82, 132), (48, 64, 104),
)  # fmt: skip


def lens_for(width_px: int = 1280, height_px: int = 720, focal_px: float | None = None) -> Intrinsics:
    """Pinhole intrinsics of the digital camera; the default lens is 650 px for 1280, scaled with the width."""
    focal = focal_px or DEFAULT_FOCAL_PX * width_px / 1280
    return pinhole(width_px, height_px, focal, IntrinsicsSource.GIVEN)


@dataclass(frozen=True, slots=True, kw_only=True)
class Person:
    """Everything about the image that does not move: hand, skin, light, room, the sensor's noise."""

    shape: HandShape = field(default_factory=HandShape)
    tone_bgr: tuple[float, float, float] = TONES_BGR[2]
    light: Light = field(default_factory=Light)
    room_seed: int = 1
    noise_sd: float = 3.0  # grey levels


def person_of(seed: int, *, left: bool | None = None) -> Person:
    """One of endlessly many people, rooms and lamps; the same for the same seed. left: which hand; None: drawn."""
    draw = np.random.default_rng([seed, 0x6861_6E64])
    side, height = draw.uniform(-0.7, 0.7), draw.uniform(0.2, 0.8)
    lamp = np.array([side, -height, -0.8])
    warmth = draw.uniform(-0.08, 0.08)
    palm_width_m, drawn = round(float(draw.uniform(0.072, 0.090)), 4), bool(draw.random() < 0.5)
    return Person(
        shape=HandShape(palm_width_m=palm_width_m, left=drawn if left is None else left),
        tone_bgr=TONES_BGR[int(draw.integers(len(TONES_BGR)))],
        light=Light(
            towards=tuple(lamp / np.linalg.norm(lamp)),
            lamp=float(draw.uniform(0.5, 0.85)),
            ambient=float(draw.uniform(0.35, 0.6)),
            tint_bgr=(1.0 - warmth, 1.0, 1.0 + warmth),
        ),
        room_seed=seed,
        noise_sd=float(draw.uniform(1.5, 4.5)),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """One moment. angles_deg: (5, 6) joint angles as `skeleton.joints_m` takes them; place None: no hand.

    second: another hand, in this room before this lens, whatever its own are.
    """

    person: Person = field(default_factory=Person)
    lens: Intrinsics = field(default_factory=lens_for)
    angles_deg: FloatArray
    place: HandPlace | None
    second: Scene | None = None


def posed(
    gesture: str,
    *,
    person: Person | None = None,
    lens: Intrinsics | None = None,
    position_m: tuple[float, float, float] = (0.0, 0.02, 0.35),
    turn_rad: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Scene:
    """A scene with one of the named gestures. turn_rad is added to how people turn that gesture.

    Raises HardwareError for a gesture that the digital hand doesn't know.
    """
    pose, person = find_pose(gesture), person or Person()
    mirror = -1.0 if person.shape.left else 1.0
    natural = np.radians(pose.turn_deg) * (1.0, mirror, mirror)
    turn = tuple(float(part) for part in natural + np.asarray(turn_rad))
    place = HandPlace(position_m=position_m, turn_rad=(turn[0], turn[1], turn[2]))
    return Scene(person=person, lens=lens or lens_for(), angles_deg=pose.angles_deg, place=place)


@dataclass(frozen=True, slots=True)
class Rendered:
    """An ideal image of a scene. surface_m: (h, w) float32 true depth, hand and wall."""

    image_bgr: ImageArray
    surface_m: DepthArray | None


def keypoints_m(scene: Scene) -> FloatArray | None:
    """(21, 3) joints in the camera's frame, metres; None without a hand."""
    if scene.place is None:
        return None
    return placed_m(joints_m(scene.person.shape, scene.angles_deg), scene.place)


def render(scene: Scene, noise_seed: int = 0, *, depth: bool = False) -> Rendered:
    """The image, and the true depth if asked. The same arguments give the same image, bit for bit."""
    lens, person = scene.lens, scene.person
    rooms = _noisy_rooms(person.room_seed, person.light, person.noise_sd, lens.width_px, lens.height_px)
    image = rooms[noise_seed % NOISE_BANK].copy()
    surface = np.full(image.shape[:2], WALL_M, np.float32) if depth else None
    shown = [(joints, one.person) for one in (scene, scene.second) if one and (joints := keypoints_m(one)) is not None]
    rendered = Rendered(image, surface)
    for joints, owner in sorted(shown, key=lambda hand: -float(hand[0][:, 2].mean())):  # the nearer one in front
        _add_hand(rendered, joints, owner, scene, noise_seed)
    return rendered


def true_depth(scene: Scene) -> DepthArray:
    """(h, w) float32: hand and wall, without their image."""
    surface, joints = np.full((scene.lens.height_px, scene.lens.width_px), WALL_M, np.float32), keypoints_m(scene)
    if joints is not None:
        body, distance_m = capsules_of(joints, scene.person.shape), max(0.08, float(joints[:, 2].mean()))
        grid = grid_over(body, scene.lens, CELLS_PER_M, distance_m)
        if grid is not None:
            _sink(surface, cast(body, grid, scene.lens), grid)
    return surface


def _add_hand(rendered: Rendered, joints: FloatArray, owner: Person, scene: Scene, noise_seed: int) -> None:
    """One hand in front of what is there, in the scene's light, in place."""
    image, surface = rendered.image_bgr, rendered.surface_m
    lens, body = scene.lens, capsules_of(joints, owner.shape)
    distance_m = max(0.08, float(joints[:, 2].mean()))
    grid = grid_over(body, lens, CELLS_PER_M, distance_m)
    if grid is None:
        return
    hand_m = cast(body, grid, lens)
    cell_m = grid.width / grid.columns * distance_m / lens.fx_px
    lines = palm_lines(joints, owner.shape, hand_m, grid, lens)
    _lay(image, paint(hand_m, lines, cell_m, owner.tone_bgr, scene.person.light), grid)
    _grain(image, grid, scene.person.noise_sd, noise_seed)
    if surface is not None:
        _sink(surface, hand_m, grid)


def _lay(image: ImageArray, painted: Painted, grid: Grid) -> None:
    """Put the painted hand onto the image, in place."""
    size = (grid.width, grid.height)
    part = image[grid.top : grid.top + grid.height, grid.left : grid.left + grid.width]
    colour = cv2.resize(painted.colour_bgr, size, interpolation=cv2.INTER_LINEAR)
    cover = cv2.resize(painted.cover, size, interpolation=cv2.INTER_LINEAR)
    part[:] = cv2.blendLinear(colour, np.ascontiguousarray(part), cover, np.float32(1.0) - cover)


def _grain(image: ImageArray, grid: Grid, noise_sd: float, seed: int) -> None:
    """The sensor's noise on the hand; the room has its own already."""
    bank = _noise(noise_sd)
    draw = np.random.default_rng(seed)
    part = image[grid.top : grid.top + grid.height, grid.left : grid.left + grid.width]
    top = int(draw.integers(bank.shape[0] - grid.height + 1)) if grid.height <= bank.shape[0] else 0
    left = int(draw.integers(bank.shape[1] - grid.width + 1)) if grid.width <= bank.shape[1] else 0
    noise = bank[top : top + grid.height, left : left + grid.width]
    if noise.shape == part.shape:
        part[:] = cv2.add(part, noise, dtype=cv2.CV_8U)


def _sink(surface_m: DepthArray, hand_m: NDArray[np.float32], grid: Grid) -> None:
    part = surface_m[grid.top : grid.top + grid.height, grid.left : grid.left + grid.width]
    fine = cv2.resize(hand_m, (grid.width, grid.height), interpolation=cv2.INTER_NEAREST)
    np.minimum(part, fine, out=part)


@lru_cache(maxsize=4)
def _noisy_rooms(seed: int, light: Light, noise_sd: float, width_px: int, height_px: int) -> tuple[ImageArray, ...]:
    room = room_bgr(seed, light, width_px, height_px)
    draw = np.random.default_rng([seed, 1])
    noises = (draw.normal(0, noise_sd, room.shape).astype(np.int16) for _ in range(NOISE_BANK))
    return tuple(np.asarray(cv2.add(room, noise, dtype=cv2.CV_8U), np.uint8) for noise in noises)


@lru_cache(maxsize=4)
def _noise(noise_sd: float) -> NDArray[np.int16]:
    draw = np.random.default_rng(7)
    return draw.normal(0, noise_sd, (800, 1360, 3)).astype(np.int16)
