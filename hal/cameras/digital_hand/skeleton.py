"""The digital hand's bones: 21 joints of a hand of given palm width, bent as a table of angles says.

Local frame: origin at keypoint 21 (midpoint of 5 and 17), x to the picture's right, y down, z away from the
camera, for a palm that faces the camera with its fingers up. Bone lengths are those of an adult hand of 82 mm
palm width (hand length 183 mm, close to the median man of GB 10000-88), scaled with the palm width.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

JOINTS = 21
ANCHOR_PER_PALM_WIDTH = 0.75  # the paper's H: palm width less one finger of a quarter of it
PALM_WIDTH_RANGE_M = (0.05, 0.12)
FINGER_NAMES = ("index", "middle", "ring", "pinky")

# Right hand seen from the palm, metres; x to the thumb's side, y to the fingertips, z out of the palm.
_WRIST = (0.003, -0.088, 0.000)
_THUMB_CMC = (0.023, -0.070, 0.009)
_FINGER_MCP = np.array([(0.031, 0.003, 0.0), (0.0105, 0.007, 0.001), (-0.0095, 0.002, 0.001), (-0.029, -0.010, 0.0)])
_FINGER_BONES = np.array([(0.043, 0.026, 0.023), (0.047, 0.030, 0.024), (0.043, 0.029, 0.024), (0.034, 0.020, 0.021)])
_THUMB_BONES = np.array([0.044, 0.034, 0.027])
_REFERENCE_PALM_M = float(np.linalg.norm(_FINGER_MCP[0] - _FINGER_MCP[3])) / ANCHOR_PER_PALM_WIDTH
# A finger's rest direction fans out from the middle one, degrees towards the thumb.
_FAN_DEG = np.array([4.0, 0.0, -4.0, -9.0])


@dataclass(frozen=True, slots=True, kw_only=True)
class HandShape:
    """Whose hand: its palm width, and whether it is the left one."""

    palm_width_m: float = 0.082
    left: bool = False

    @property
    def anchor_m(self) -> float:
        """Length of segment 5-17, exactly three quarters of the palm width."""
        return ANCHOR_PER_PALM_WIDTH * self.palm_width_m

    @property
    def scale(self) -> float:
        """Of every length, against the reference hand."""
        return self.palm_width_m / _REFERENCE_PALM_M


@dataclass(frozen=True, slots=True, kw_only=True)
class HandPlace:
    """Where the hand is and how it is turned.

    position_m: keypoint 21 in the camera's frame (x right, y down, z away), so z is the distance.
    turn_rad: (pitch, yaw, roll): fingertips towards the camera, palm to the picture's left, clockwise.
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
    chained: FloatArray = np.cumsum(directions * lengths[:, None], axis=0)
    return chained


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
