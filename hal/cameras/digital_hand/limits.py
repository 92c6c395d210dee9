"""What a digital patient's hand can't do: fingers that stay bent, fingers that can't be spread, a tremor of all joints.

Nobody's measured hand: plain cases of what a therapist sees after a stroke, to try the enrolment of gestures on.
"""

from __future__ import annotations

import math
from enum import Enum

import numpy as np

from hal.cameras.digital_hand.skeleton import FloatArray

BENT_DEG = (45.0, 70.0, 40.0)  # least flexion at MCP, PIP, DIP of a finger that can't be extended
TOGETHER_DEG = (-4.0, 0.0, 4.0, 9.0)  # abduction of fingers that lie beside each other
OPEN_DEG = 45.0  # a finger whose joints are bent by less, together, is open
THUMB_MOST_DEG = 20.0  # azimuth of a thumb that can't be spread
TREMOR_DEG = 8.0  # of every joint
TREMOR_HZ = (4.0, 8.0)
MEAN_HZ = 6.0


class HandLimit(Enum):
    """What the hand can't do."""

    NONE = "none"
    TWO_FINGERS = "two-fingers"  # ring and little finger stay bent
    NO_SPREAD = "no-spread"  # open fingers lie beside each other, the thumb beside the palm
    TREMOR = "tremor"


def limited(limit: HandLimit, angles_deg: FloatArray) -> FloatArray:
    """(5, 6) joint angles as this hand can take them, without its tremor."""
    possible = angles_deg.copy()
    if limit is HandLimit.TWO_FINGERS:
        possible[3:5, 1:4] = np.maximum(possible[3:5, 1:4], BENT_DEG)
    elif limit is HandLimit.NO_SPREAD:
        is_open = possible[1:5, 1:4].sum(axis=1) < OPEN_DEG
        possible[1:5, 0] = np.where(is_open, TOGETHER_DEG, possible[1:5, 0])
        possible[0, 0::2] = np.minimum(possible[0, 0::2], THUMB_MOST_DEG)
    return possible


def tremor_deg(limit: HandLimit, now_s: float, frequency_hz: float = MEAN_HZ, phase_rad: float = 0.0) -> float:
    """How far every joint is from where it is held; 0 for a hand that does not shake."""
    if limit is not HandLimit.TREMOR:
        return 0.0
    return TREMOR_DEG * math.sin(phase_rad + 2 * math.pi * frequency_hz * now_s)
