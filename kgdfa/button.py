"""The virtual button: pressed by a hand that comes near, released by one that withdraws, cancelled by all else."""

from __future__ import annotations

from dataclasses import dataclass

from kgdfa.hand import Box, Gesture


@dataclass(frozen=True, slots=True, kw_only=True)
class ButtonPlace:
    """Where the button is on the picture and how near is pressed."""

    x_px: float
    y_px: float
    radius_px: float
    threshold_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ButtonInput:
    """What one frame says to the button."""

    captured_ns: int
    gesture: Gesture | None  # voted
    recognised_ns: int  # capture of the frame whose vote made `gesture`
    distance_m: float | None  # safe distance; None: no measurement
    box: Box | None  # bounding box of the 22 points; None: no hand


@dataclass(frozen=True, slots=True, kw_only=True)
class ButtonState:
    """The button after a frame. Counts only grow, so a lost report loses no release."""

    pressed: bool = False
    pressed_gesture: Gesture | None = None
    pressed_captured_ns: int = 0
    release_count: int = 0
    released_gesture: Gesture | None = None
    released_recognised_ns: int = 0
    released_captured_ns: int = 0
    cancel_count: int = 0
    cancel_reason: str = ""
    ready: bool = False  # the hand has been seen outside the threshold since the last release or cancel
    last_captured_ns: int = 0
