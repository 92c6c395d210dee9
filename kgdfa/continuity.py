"""Whether a hand may be the one of a moment ago: a palm keeps its shape, and moves and turns only so fast.

Where two hands cross, the detector follows from the covered one to the covering one without a word. What it reports
then is a palm that leaps, turns or changes its shape between two frames as none does: a left palm's knuckles, above
all, are no right palm's, moved and turned and grown.
"""

from __future__ import annotations

import cmath
import math
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from kgdfa.button_state import STALE_NS
from kgdfa.frame_time import FRAME_NS
from kgdfa.gesture import Explanation
from kgdfa.hand import Hand, Keypoint

MOST_FRAMES = 6  # limits are of a 30th of a second, and grow where frames are farther apart, by so many at most
# Of the palm's centre, in reference segments of about 8 cm: 1.2 m/s across the image. People reach at up to 1 m/s
# (Morasso 1981), a push goes towards the camera: in 200 of 0.3 to 0.8 s two frames were faster, both misread.
LARGEST_SHIFT = 0.5
# Of knuckles and thumb's base, root of the mean square after the best shift, turn and growth, in reference segments.
# Between two frames of 200 pushes it is 0.01, in one of twenty 0.06; where a hand is taken for another, 0.4 to 0.6.
LARGEST_BEND = 0.3
LARGEST_TURN_RAD, FURTHER_TURN_RAD = math.radians(45), math.radians(15)
DOUBTFUL_FRAMES = 2  # a hand that may be another one counts for so long, then as lost for GAP_FRAMES: slips slip back
_RIGID = np.array([Keypoint.THUMB_CMC, Keypoint.INDEX_MCP, Keypoint.MIDDLE_MCP, Keypoint.RING_MCP, Keypoint.PINKY_MCP])


class Jump(Enum):
    """What no hand does from one frame to the next."""

    PLACE = "place"
    SHAPE = "shape"
    TURN = "turn"
    SIDE = "side"  # sure frames of the other side in a row
    UNSEEN = "unseen"  # too long to be followed: seconds since the frame before


def jump_between(before: Hand, now: Hand, elapsed_ns: int, *, lost: bool) -> Explanation | None:
    """What the hand of now can't be that of before by: `Jump` with value and limit; None: it may be.

    before: the newest that is trusted. elapsed_ns: since the newest frame, which sets the limits: a hand that was
    misread or lost for a frame or two comes back to where it was. lost: for longer than a press survives.
    """
    if lost or elapsed_ns > STALE_NS:
        return Explanation(Jump.UNSEEN, {"value": elapsed_ns / 1e9, "limit": STALE_NS / 1e9})
    frames = min(max(elapsed_ns / FRAME_NS, 1.0), MOST_FRAMES)
    reference_px = max(now.reference_px, before.reference_px, 1.0)
    bend_px, turn_rad = _bend_px(_palm(before), _palm(now))
    compared = {
        Jump.PLACE: (now.palm_shift_px(before) / reference_px, LARGEST_SHIFT * frames),
        Jump.SHAPE: (bend_px / reference_px, LARGEST_BEND),
        Jump.TURN: (abs(turn_rad), LARGEST_TURN_RAD + FURTHER_TURN_RAD * (frames - 1)),
    }
    beyond = ((value / limit, code, value, limit) for code, (value, limit) in compared.items() if value > limit)
    _, code, value, limit = max(beyond, key=lambda one: one[0], default=(0.0, None, 0.0, 0.0))
    return Explanation(code, {"value": value, "limit": limit}) if code is not None else None


def _palm(hand: Hand) -> NDArray[np.complex128]:
    """(5,) about their middle."""
    points = hand.image_px.take(_RIGID, axis=0)
    palm = points[:, 0] + 1j * points[:, 1]
    centred: NDArray[np.complex128] = palm - palm.mean()
    return centred


def _bend_px(before: NDArray[np.complex128], now: NDArray[np.complex128]) -> tuple[float, float]:
    """What of the palm no turn and growth explains, and the turn: least squares in the complex plane."""
    size = float(np.vdot(before, before).real)
    change = complex(np.vdot(before, now)) / size if size > 0 else 1 + 0j
    left = now - change * before
    return math.sqrt(float(np.vdot(left, left).real) / len(now)), cmath.phase(change)
