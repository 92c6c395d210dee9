"""What each gesture looks like: joint angles, and how people usually turn the hand to show it.

Shapes follow the paper's Tables 1 and 2; look-alikes and `rest` are there to be refused. Angles are those of
`hand_skeleton.joints_m`, degrees. Gestures 7 and 9 are shown turned: seen from the front the pinched or hooked
fingers point into the lens.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hal.cameras.digital_hand.skeleton import FloatArray
from hal.errors import HardwareError

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
PINKY_IN: Finger = (16, *_IN)
INDEX_OUT: Finger = (1, 4, 4, 3)
MIDDLE_OUT: Finger = (0, 3, 4, 3)
RING_OUT: Finger = (0, 3, 4, 3)
PINKY_OUT: Finger = (-2, 5, 5, 4)

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
)
POSES: dict[str, Pose] = {pose.name: pose for pose in (*GESTURES, *LOOK_ALIKES)}


def find_pose(name: str) -> Pose:
    """The pose of that name. Raises HardwareError listing the names there are."""
    if name not in POSES:
        raise HardwareError(f"The digital hand knows no gesture {name!r}: choose one of {', '.join(POSES)}.")
    return POSES[name]
