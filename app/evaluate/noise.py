"""MediaPipe's errors on digital hands: taken from rendered frames, put on keypoints that were never rendered."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from app.evaluate.digital import side_of
from app.evaluate.hand_motions import PALM, take, walk
from app.evaluate.harness import FRAME_NS, Step
from app.evaluate.readings import GESTURE_NAMES
from hal.cameras.digital_hand.raycast import project_px
from hal.cameras.digital_hand.render import Scene, keypoints_m, lens_for, person_of
from kgdfa.hand import FloatArray, Hand, Keypoint
from kgdfa.keypoints import HandDetector

USUAL_PRESENCE = 0.9
NOISE_WALKS = 36
NOISE_FRAMES = 24
FIRST_HAND = 5_001


@dataclass(frozen=True, slots=True, kw_only=True)
class NoiseFrame:
    """(21, 2) on the image and (21, 3) in space less the truth, whether the side was named right, and its score."""

    image: FloatArray
    world: FloatArray
    side_right: bool
    presence: float


@dataclass(frozen=True, slots=True, kw_only=True)
class NoiseClip:
    """What MediaPipe made of one walk, frame by frame; None: it lost the hand."""

    gesture: str
    frames: tuple[NoiseFrame | None, ...]


def take_noise(detector: HandDetector, step: Step) -> list[NoiseClip]:
    """Detect hands on rendered walks and keep how the keypoints differ from the truth."""
    lens, now_ns, clips = lens_for(), 1_000_000_000, []
    for number in range(NOISE_WALKS):
        seed, gesture = FIRST_HAND + number, GESTURE_NAMES[number % 12]
        person = person_of(seed)
        frames: list[NoiseFrame | None] = []
        now_ns += 1_000_000_000
        for index, moment in enumerate(walk(gesture, person=person, lens=lens, seed=seed, frames=NOISE_FRAMES)):
            now_ns += FRAME_NS
            hands = detector.detect(take(moment, index)[0], now_ns)
            frames.append(_noise_of(hands[0], moment.scene) if hands else None)
            step()
        if any(frames):
            clips.append(NoiseClip(gesture=gesture, frames=tuple(frames)))
    return clips


def _noise_of(hand: Hand, scene: Scene) -> NoiseFrame:
    image, world = residual(hand, scene)
    return NoiseFrame(image=image, world=world, side_right=hand.side is side_of(scene.person), presence=hand.presence)


def noisy_hand(scene: Scene, noise: NoiseClip, index: int) -> Hand | None:
    """The hand in a frame of the noise: there and back again, so that it never jumps more than MediaPipe's own."""
    count = len(noise.frames)
    place = index % (2 * count - 1)
    now = noise.frames[place if place < count else 2 * count - 1 - place]
    if now is None:
        return None
    return with_noise(scene, now.image, now.world, side_right=now.side_right, presence=now.presence, tracked=index > 0)


def residual(hand: Hand, scene: Scene) -> tuple[FloatArray, FloatArray]:
    """What MediaPipe made of a scene, less the truth, of an upright right hand: (21, 2) on the image, (21, 3) in space.

    In reference segments (5–17): on the image that of a palm facing the camera at this distance, since a detector errs
    with the size of the hand in the image, however its palm is turned.
    """
    image_px, world_m, facing_px = _ground_truth(scene)
    upright = _roll(image_px).T
    image = (hand.image_px - image_px) @ upright.T / facing_px
    world = (hand.world_m - world_m) / scene.person.shape.reference_m
    world[:, :2] = world[:, :2] @ upright.T
    return _mirrored(image, scene), _mirrored(world, scene)


def with_noise(
    scene: Scene,
    image: FloatArray,
    world: FloatArray,
    *,
    side_right: bool = True,
    presence: float = USUAL_PRESENCE,
    tracked: bool = False,
) -> Hand | None:
    """The hand as MediaPipe might see it, with such a residual; None while its palm is outside the image.

    side_right: whether it names the hand's side right.
    """
    image, world, side = _mirrored(image, scene), _mirrored(world, scene), side_of(scene.person)
    image_px, world_m, facing_px = _ground_truth(scene)
    palm = (image_px[Keypoint.INDEX_MCP] + image_px[Keypoint.PINKY_MCP]) / 2
    if not (0 <= palm[0] < scene.lens.width_px and 0 <= palm[1] < scene.lens.height_px):
        return None
    turned = _roll(image_px)
    shift = world.copy()
    shift[:, :2] = shift[:, :2] @ turned.T
    return Hand(
        image_px=image_px + image @ turned.T * facing_px,
        world_m=world_m + shift * scene.person.shape.reference_m,
        presence=presence,
        side=side if side_right else side.other,
        tracked=tracked,
    )


def _mirrored(shift: FloatArray, scene: Scene) -> FloatArray:
    """A right hand's residual as a left hand has it, and back: its image is the mirror image."""
    if not scene.person.shape.left:
        return shift
    mirrored = shift.copy()
    mirrored[:, 0] *= -1
    return mirrored


def _roll(image_px: FloatArray) -> FloatArray:
    """(2, 2): from the upright hand to this one. MediaPipe gets a crop turned upright by the line 0-9, so its
    errors turn with the hand."""
    x, y = image_px[Keypoint.MIDDLE_MCP] - image_px[Keypoint.WRIST]
    length = max(float(np.hypot(x, y)), 1e-9)
    c, s = -y / length, x / length
    return np.array([[c, -s], [s, c]])


def _ground_truth(scene: Scene) -> tuple[FloatArray, FloatArray, float]:
    """True keypoints on the image, px, and in space about their centre, m, as MediaPipe would give them.

    And the length in pixels that the reference segment would have there if it faced the camera.
    """
    joints = keypoints_m(scene)
    assert joints is not None
    away_m = float(joints[list(PALM), 2].mean())
    facing_px = scene.lens.fx_px * scene.person.shape.reference_m / away_m
    return project_px(joints, scene.lens), joints - joints.mean(axis=0), facing_px
