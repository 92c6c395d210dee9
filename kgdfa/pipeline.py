"""The chain of the paper, one pure stage after the other: picture in, report out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kgdfa.button import ButtonState
from kgdfa.distance import Distance
from kgdfa.hand import Gesture, Hand
from kgdfa.verdict import Verdict


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """What the pipeline needs of a frame. image_bgr: (h, w, 3) uint8; depth_m: (h, w) float32, 0 = none."""

    image_bgr: NDArray[np.uint8]
    captured_ns: int
    depth_m: NDArray[np.float32] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """Everything one frame says. `gesture` is voted and steadied; `verdict` is this frame's alone."""

    captured_ns: int
    hand: Hand | None
    verdict: Verdict | None
    gesture: Gesture | None
    recognised_ns: int
    votes: int
    distance: Distance | None
    depth_distance: Distance | None
    button: ButtonState
    depth_button: ButtonState | None = None
