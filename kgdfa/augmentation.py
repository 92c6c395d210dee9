"""Test-time augmentation of one photo: bordered, scaled, mirrored, turned, so that hands in crops are found.

MediaPipe's palm detector wants room around the hand: of crops that fill their image it misses one in six, and
none to speak of once they have a border and 384 pixels (measured on 360 photos: 299 found as they are, 355
with a border of half their size). Video needs none of this: its frames have room, and the track carries it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import cv2
import numpy as np

from kgdfa.hand import FloatArray, Hand, same_place
from kgdfa.preprocess import Image, as_bgr8, brighten, reduced


@dataclass(frozen=True, slots=True, kw_only=True)
class Augmentation:
    """How to show the image: a border as a share of the longer side (edge pixels repeated), the longer side in pixels
    after scaling, a turn in degrees, mirrored or not, contrast spread or not (for dark images).
    """

    border: float = 0.5
    size_px: int = 384
    turn_deg: float = 0.0
    mirrored: bool = False
    brightened: bool = False


AUGMENTATIONS = (
    Augmentation(),
    Augmentation(border=0.9, size_px=448),
    Augmentation(mirrored=True),
    Augmentation(border=0.6, turn_deg=20),
    Augmentation(border=0.6, turn_deg=-20),
    Augmentation(border=0.35, size_px=320),
)
# For the few that the plain one misses, with lower thresholds, in this order until one finds a hand.
FALLBACK_AUGMENTATIONS = (
    Augmentation(),
    Augmentation(border=1.0),
    Augmentation(border=0.25),
    Augmentation(border=0.9, size_px=768),
    Augmentation(border=1.5, size_px=512),
    Augmentation(border=0.6, turn_deg=60),
    Augmentation(border=0.6, turn_deg=-60),
    Augmentation(border=0.6, turn_deg=180),
    Augmentation(brightened=True),
)
FALLBACK_THRESHOLD = 0.2


class StillDetector(Protocol):
    """Detects hands in one image by itself: `keypoints.HandDetector(still=True)`, or a fake of ours."""

    def detect(self, image_bgr: Image, captured_ns: int = 0) -> tuple[Hand, ...]:
        """The hands in it."""


def augment(image_bgr: Image, augmentation: Augmentation) -> tuple[Image, FloatArray]:
    """The augmented image, and the (2, 3) affine map from the image's pixels to its. A large image is reduced first."""
    image = reduced(image_bgr)
    reduction = max(image.shape[:2]) / max(image_bgr.shape[:2])
    image = brighten(image) if augmentation.brightened else image
    border = round(augmentation.border * max(image.shape[:2]))
    image = np.asarray(cv2.copyMakeBorder(image, border, border, border, border, cv2.BORDER_REPLICATE))
    scale = augmentation.size_px / max(image.shape[:2])
    smoothing = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    image = np.asarray(cv2.resize(image, None, fx=scale, fy=scale, interpolation=smoothing))
    transform = np.array([[scale * reduction, 0, scale * border], [0, scale * reduction, scale * border]])
    height, width = image.shape[:2]
    if augmentation.turn_deg:
        turn = cv2.getRotationMatrix2D((width / 2, height / 2), augmentation.turn_deg, 1)
        image = np.asarray(cv2.warpAffine(image, turn, (width, height), borderMode=cv2.BORDER_REPLICATE))
        transform = turn @ np.vstack([transform, [0, 0, 1]])
    if augmentation.mirrored:
        image = np.ascontiguousarray(image[:, ::-1])
        transform = np.array([[-1.0, 0, width - 1], [0, 1, 0]]) @ np.vstack([transform, [0, 0, 1]])
    return image.astype(np.uint8, copy=False), transform


def detect_augmented(
    detector: StillDetector, image_bgr: Image, augmentation: Augmentation, like: Hand | None = None
) -> Hand | None:
    """The largest hand in one augmented image, as it is on the image itself. like: the hand that it must be."""
    shown, transform = augment(image_bgr, augmentation)
    hands = [to_image(hand, transform) for hand in detector.detect(shown)]
    if not hands:
        return None
    if like is None:
        hand = max(hands, key=lambda one: one.reference_px)
    else:
        hand = min(hands, key=like.palm_shift_px)
        if not same_place(hand, like):
            return None
    return replace(hand, side=hand.side.other) if augmentation.mirrored else hand


def to_image(hand: Hand, transform: FloatArray) -> Hand:
    """A hand as it is on the image itself, and in its space, from where `transform`, (2, 3), has shown it."""
    back = np.linalg.inv(transform[:, :2])
    turn = np.eye(3)
    turn[:2, :2] = back / np.sqrt(abs(np.linalg.det(back)))
    return replace(hand, image_px=(hand.image_px - transform[:, 2]) @ back.T, world_m=hand.world_m @ turn.T)


def detect_photo(detector: StillDetector, eager: StillDetector, image_bgr: Image) -> tuple[Hand, ...]:
    """One hand per augmentation that finds it, the plain one first; () when neither those nor the fallbacks do.

    detector: at its usual thresholds; eager: at `FALLBACK_THRESHOLD`, used only when the plain one finds none.
    """
    image = as_bgr8(image_bgr)
    first, *others = AUGMENTATIONS
    plain = detect_augmented(detector, image, first)
    if plain is None:
        second = (detect_augmented(eager, image, augmentation) for augmentation in FALLBACK_AUGMENTATIONS)
        plain = next((hand for hand in second if hand is not None), None)
    if plain is None:
        return ()
    looks = (detect_augmented(detector, image, augmentation, plain) for augmentation in others)
    return (plain, *(hand for hand in looks if hand is not None))
