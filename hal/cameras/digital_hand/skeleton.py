"""The digital hand's skeleton: 21 joints of a hand of given palm width, and the poses of its gestures.

Local frame: origin at keypoint 21 (midpoint of 5 and 17), x to the image's right, y down, z away from the
camera, for a palm that faces the camera with its fingers up. Bone lengths are those of an adult hand of 82 mm
palm width (hand length 183 mm, close to the median man of GB 10000-88), scaled with the palm width.

Poses follow the paper's Tables 1 and 2; look-alikes and `rest` are there to be refused. Gestures 7 and 9 are shown
turned: seen from the front the pinched or hooked fingers point into the lens.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hal.errors import CameraFault, HardwareError

FloatArray = NDArray[np.float64]

JOINTS = 21
REFERENCE_OF_PALM = 0.75  # the paper's H: palm width less one finger of a quarter of it
FINGER_NAMES = ("index", "middle", "ring", "pinky")

# Right hand seen from the palm, metres; x to the thumb's side, y to the fingertips, z out of the palm.
_WRIST = (0.003, -0.088, 0.000)
_THUMB_CMC = (0.023, -0.070, 0.009)
_FINGER_MCP = np.array([(0.031, 0.003, 0.0), (0.0105, 0.007, 0.001), (-0.0095, 0.002, 0.001), (-0.029, -0.010, 0.0)])
_FINGER_BONES = np.array([(0.043, 0.026, 0.023), (0.047, 0.030, 0.024), (0.043, 0.029, 0.024), (0.034, 0.020, 0.021)])
_THUMB_BONES = np.array([0.044, 0.034, 0.027])
_REFERENCE_PALM_M = float(np.linalg.norm(_FINGER_MCP[0] - _FINGER_MCP[3])) / REFERENCE_OF_PALM
# A finger's rest direction fans out from the middle one, degrees towards the thumb.
_FAN_DEG = np.array([4.0, 0.0, -4.0, -9.0])


@dataclass(frozen=True, slots=True, kw_only=True)
class HandShape:
    """Whose hand: its palm width, and whether it is the left one."""

    palm_width_m: float = 0.082
    left: bool = False

    @property
    def reference_m(self) -> float:
        """Length of segment 5-17, exactly three quarters of the palm width."""
        return REFERENCE_OF_PALM * self.palm_width_m

    @property
    def scale(self) -> float:
        """Of every length, against the reference hand."""
        return self.palm_width_m / _REFERENCE_PALM_M


@dataclass(frozen=True, slots=True, kw_only=True)
class HandPlace:
    """Where the hand is and how it is turned.

    position_m: keypoint 21 in the camera's frame (x right, y down, z away), so z is the distance.
    turn_rad: (pitch, yaw, roll): fingertips towards the camera, palm to the image's left, clockwise.
    """

    position_m: tuple[float, float, float]
    turn_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def rotation(self) -> FloatArray:
        """(3, 3), from the hand's frame to the camera's."""
        pitch, yaw, roll = self.turn_rad
        return _about(2, roll) @ _about(0, pitch) @ _about(1, yaw)

    @property
    def tilt_rad(self) -> float:
        """Between the palm's normal and the camera's axis, 0 when the palm faces the camera."""
        return float(np.arccos(np.clip(self.rotation[2, 2], -1.0, 1.0)))


def joints_m(shape: HandShape, angles_deg: FloatArray) -> FloatArray:
    """(21, 3) joints in the hand's own frame, from the (5, 6) rows of `hand_poses.Pose.angles_deg`.

    Row 0, thumb: azimuth (from the fingers' direction towards the thumb's side) and elevation (out of the palm)
    of its three bones. Rows 1-4: abduction towards the thumb, flexion at MCP, PIP, DIP, two unused.
    """
    joints = np.empty((JOINTS, 3))
    joints[0], joints[1] = _WRIST, _THUMB_CMC
    joints[2:5] = joints[1] + _chain(_thumb_directions(angles_deg[0]), _THUMB_BONES)
    for finger in range(4):
        first = 5 + 4 * finger
        joints[first] = _FINGER_MCP[finger]
        directions = _finger_directions(angles_deg[1 + finger], _FAN_DEG[finger])
        joints[first + 1 : first + 4] = joints[first] + _chain(directions, _FINGER_BONES[finger])
    joints -= (joints[5] + joints[17]) / 2
    side = -1.0 if shape.left else 1.0
    return joints * (side * shape.scale, -shape.scale, -shape.scale)


def placed_m(joints: FloatArray, place: HandPlace) -> FloatArray:
    """(n, 3) points of the hand's frame in the camera's frame."""
    placed: FloatArray = joints @ place.rotation.T + np.asarray(place.position_m)
    return placed


def _chain(directions: FloatArray, lengths: FloatArray) -> FloatArray:
    return np.cumsum(directions * lengths[:, None], axis=0)


def _thumb_directions(row: FloatArray) -> FloatArray:
    azimuth, elevation = np.radians(row[0::2]), np.radians(row[1::2])
    flat = np.cos(elevation)
    return np.stack([flat * np.sin(azimuth), flat * np.cos(azimuth), np.sin(elevation)], axis=1)


def _finger_directions(row: FloatArray, fan_deg: float) -> FloatArray:
    aside = np.radians(row[0] + fan_deg)
    bend = np.radians(np.cumsum(row[1:4]))
    flat = np.cos(bend)
    return np.stack([flat * np.sin(aside), flat * np.cos(aside), np.sin(bend)], axis=1)


def _about(axis: int, angle: float) -> FloatArray:
    """Rotation about x (0), y (1) or z (2) of the camera's frame."""
    cosine, sine = np.cos(angle), np.sin(angle)
    rotation = np.eye(3)
    first, second = (axis + 1) % 3, (axis + 2) % 3
    rotation[first, first] = rotation[second, second] = cosine
    rotation[first, second], rotation[second, first] = -sine, sine
    return rotation


Finger = tuple[float, float, float, float]  # abduction, MCP, PIP, DIP
Thumb = tuple[float, float, float, float, float, float]  # azimuth and elevation of three bones

AWAY = "none"  # no hand in view


@dataclass(frozen=True, slots=True)
class Pose:
    """One hand shape. turn_deg: (pitch, yaw, roll) of a right hand; a left hand mirrors yaw and roll."""

    name: str
    thumb: Thumb
    index: Finger
    middle: Finger
    ring: Finger
    pinky: Finger
    turn_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def angles_deg(self) -> FloatArray:
        """(5, 6): a row a finger, thumb first, as `hand_skeleton.joints_m` takes it."""
        fingers = [(*finger, 0.0, 0.0) for finger in (self.index, self.middle, self.ring, self.pinky)]
        return np.array([self.thumb, *fingers])


OPEN_THUMB: Thumb = (52, 18, 52, 10, 50, 5)
ACROSS_THUMB: Thumb = (25, 22, -40, 18, -58, 2)  # folded over the palm
TUCKED_THUMB: Thumb = (25, 26, -44, 28, -64, 16)  # on the bent pinky
OVER_THUMB: Thumb = (28, 32, -28, 40, -67, 9)  # over the bent fingers
PINCH_THUMB: Thumb = (8, 50, -4, 50, -7, 46)

_IN = (88, 104, 74)  # a folded finger's MCP, PIP, DIP
INDEX_IN: Finger = (-9, *_IN)
MIDDLE_IN: Finger = (-3, *_IN)
RING_IN: Finger = (6, *_IN)
# Folded fingers point to the scaphoid, at the thumb's base: the little finger crosses the palm by 25° (with its fan).
# Straight down, at the hand's edge, it looked like a thumb, and MediaPipe missed the side of hands that show a 3.
PINKY_IN: Finger = (-16, *_IN)
INDEX_OUT: Finger = (1, 4, 4, 3)
MIDDLE_OUT: Finger = (0, 3, 4, 3)

GESTURES: tuple[Pose, ...] = (
    Pose("0", OVER_THUMB, INDEX_IN, MIDDLE_IN, RING_IN, PINKY_IN),
    Pose("1", OVER_THUMB, INDEX_OUT, MIDDLE_IN, RING_IN, PINKY_IN),
    Pose("2", OVER_THUMB, (7, 4, 4, 3), (-7, 4, 4, 3), RING_IN, PINKY_IN),
    Pose("3", OVER_THUMB, (7, 4, 4, 3), MIDDLE_OUT, (-7, 4, 4, 3), PINKY_IN),
    Pose("4", ACROSS_THUMB, (5, 4, 4, 3), MIDDLE_OUT, (-3, 4, 4, 3), (-8, 5, 5, 4)),
    Pose("5", OPEN_THUMB, (7, 2, 2, 2), MIDDLE_OUT, (-5, 3, 3, 3), (-12, 4, 4, 3)),
    Pose("6", OPEN_THUMB, INDEX_IN, MIDDLE_IN, RING_IN, (-14, 4, 4, 3)),
    Pose("7", PINCH_THUMB, (-3, 76, 16, 10), (4, 81, 20, 12), RING_IN, PINKY_IN, (20, -42, 0)),
    Pose("8", OPEN_THUMB, INDEX_OUT, MIDDLE_IN, RING_IN, PINKY_IN),
    Pose("9", OVER_THUMB, (1, 8, 88, 42), MIDDLE_IN, RING_IN, PINKY_IN, (4, -38, 0)),
    Pose("love", OPEN_THUMB, INDEX_OUT, MIDDLE_IN, RING_IN, (-8, 4, 4, 3)),
    Pose("rock", OVER_THUMB, INDEX_OUT, MIDDLE_IN, RING_IN, (-8, 4, 4, 3)),
)
REST = Pose("rest", (38, 34, 26, 28, 14, 22), (2, 36, 52, 28), (0, 40, 56, 30), (-2, 44, 58, 30), (-2, 46, 54, 28))
LOOK_ALIKES: tuple[Pose, ...] = (
    Pose("tiger claw", (50, 30, 30, 30, -5, 25), (4, 18, 82, 52), (0, 18, 84, 54), (-4, 18, 82, 54), (-10, 18, 78, 50)),
    Pose("thumb up", (42, 8, 22, 4, 14, 0), INDEX_IN, MIDDLE_IN, RING_IN, PINKY_IN, (0, 0, -30)),
    Pose("ok", (35, 45, 11, 47, -14, 35), (-3, 50, 54, 28), (2, 6, 6, 4), (-6, 4, 6, 4), (-14, 4, 6, 4)),
    REST,
    Pose(
        "naturally open", (42, 30, 32, 22, 22, 16), (3, 20, 30, 16), (0, 24, 34, 18), (-2, 28, 36, 18), (-5, 30, 34, 18)
    ),
    Pose("gun", OPEN_THUMB, (6, 4, 4, 3), (-4, 4, 4, 3), RING_IN, PINKY_IN),
    Pose("pinky", OVER_THUMB, INDEX_IN, MIDDLE_IN, RING_IN, (-8, 4, 4, 3)),
    Pose("index-middle-pinky", TUCKED_THUMB, (6, 4, 4, 3), (0, 4, 4, 3), RING_IN, (-10, 4, 4, 3)),
    Pose("O", (22, 53, -3, 46, -18, 33), (-4, 53, 47, 24), (-1, 60, 53, 27), (2, 60, 52, 27), (6, 60, 50, 27)),
    Pose(
        "half-open pinch",
        PINCH_THUMB,
        (-3, 76, 16, 10),
        (4, 81, 20, 12),
        (6, 84, 24, 14),
        (10, 88, 26, 14),
        (20, -42, 0),
    ),
)
POSES: dict[str, Pose] = {pose.name: pose for pose in (*GESTURES, *LOOK_ALIKES)}


def find_pose(name: str) -> Pose:
    """The pose of that name. Raises HardwareError listing the names there are."""
    if name not in POSES:
        raise HardwareError(CameraFault.UNKNOWN_POSE, pose=name, known=", ".join(POSES))
    return POSES[name]
