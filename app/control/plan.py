"""A planned motion as a table of samples at the tick rate, checked whole before its first tick.

Planning takes milliseconds, a tick has two: plans are made in the planner process and arrive as arrays, so that
the tick only looks up its row. Walking is a chain of one-step plans, each asked for while the one before runs.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from app.control.states import Action, GaitState

TICK_HZ = 500


class Phase(Enum):
    """Which part of an action a plan is; all but walking are WHOLE."""

    WHOLE = "whole"
    WALK_START = "walk start"  # from standing, left leg first, ends moving, left leg forward
    WALK_RIGHT = "walk right"  # one step of the periodic gait, right leg swings
    WALK_LEFT = "walk left"
    WALK_CLOSE_RIGHT = "walk close right"  # right leg swings up to the left, to standing
    WALK_CLOSE_LEFT = "walk close left"


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanRequest:
    """What control asks of the planner; the pose is the measured one, (4,) radians."""

    number: int
    action: Action
    phase: Phase
    from_state: GaitState
    start_rad: tuple[float, float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanCheck:
    """The whole plan against the patient and the device; `ok` is False with the reason and its numbers."""

    ok: bool
    reason: str
    peak_speed_rad_s: tuple[float, float, float, float]
    peak_torque_nm: tuple[float, float, float, float]
    min_clearance_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """Samples at TICK_HZ, each (n, 4) in the order of hal's Joint; torque is the feed-forward estimate."""

    number: int
    action: Action
    phase: Phase
    from_state: GaitState
    to_state: GaitState
    position_rad: NDArray[np.float64]
    velocity_rad_s: NDArray[np.float64]
    torque_nm: NDArray[np.float64]
    check: PlanCheck
    steps: int = 0
    advance_m: float = 0.0

    @property
    def duration_s(self) -> float:
        """From the first sample to the last."""
        return (len(self.position_rad) - 1) / TICK_HZ
