"""A planned motion as a table of samples at the tick rate, checked whole before its first tick.

Planning takes milliseconds, a tick has two: plans are made in the planner process and arrive as arrays, so that
the tick only looks up its row. Walking is a chain of one-step plans, each asked for while the one before runs.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import msgspec
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from app.ipc.messages import Quad
from app.ipc.states import Action, GaitState
from hal.joints.protocol import TICK_HZ


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


class PlanRequestMessage(Struct, frozen=True, kw_only=True, tag="plan-request"):
    """Control to planner, ordered."""

    number: int
    action: Action
    phase: Phase
    from_state: GaitState
    start_rad: Quad


class PlanCheckMessage(Struct, frozen=True, kw_only=True):
    """As PlanCheck."""

    ok: bool
    reason: str
    peak_speed_rad_s: Quad
    peak_torque_nm: Quad
    min_clearance_m: float


class PlanMessage(Struct, frozen=True, kw_only=True, tag="plan"):
    """Planner to control, ordered; position, velocity and torque are (n, 4) in bytes."""

    number: int
    action: Action
    phase: Phase
    from_state: GaitState
    to_state: GaitState
    position_rad: bytes
    velocity_rad_s: bytes
    torque_nm: bytes
    check: PlanCheckMessage
    steps: int
    advance_m: float


def pack_request(request: PlanRequest) -> PlanRequestMessage:
    """For the link."""
    return PlanRequestMessage(
        number=request.number,
        action=request.action,
        phase=request.phase,
        from_state=request.from_state,
        start_rad=request.start_rad,
    )


def unpack_request(message: PlanRequestMessage) -> PlanRequest:
    """From the link."""
    return PlanRequest(
        number=message.number,
        action=message.action,
        phase=message.phase,
        from_state=message.from_state,
        start_rad=message.start_rad,
    )


def pack_plan(plan: Plan) -> PlanMessage:
    """For the link."""
    check = plan.check
    return PlanMessage(
        number=plan.number,
        action=plan.action,
        phase=plan.phase,
        from_state=plan.from_state,
        to_state=plan.to_state,
        position_rad=plan.position_rad.tobytes(),
        velocity_rad_s=plan.velocity_rad_s.tobytes(),
        torque_nm=plan.torque_nm.tobytes(),
        check=PlanCheckMessage(
            ok=check.ok,
            reason=check.reason,
            peak_speed_rad_s=check.peak_speed_rad_s,
            peak_torque_nm=check.peak_torque_nm,
            min_clearance_m=check.min_clearance_m,
        ),
        steps=plan.steps,
        advance_m=plan.advance_m,
    )


def unpack_plan(message: PlanMessage) -> Plan:
    """From the link; raises msgspec.ValidationError when the tables do not fit one another."""
    tables = [_table(raw) for raw in (message.position_rad, message.velocity_rad_s, message.torque_nm)]
    if len({table.shape for table in tables}) != 1:
        raise msgspec.ValidationError("A plan's tables differ in length")
    check = message.check
    return Plan(
        number=message.number,
        action=message.action,
        phase=message.phase,
        from_state=message.from_state,
        to_state=message.to_state,
        position_rad=tables[0],
        velocity_rad_s=tables[1],
        torque_nm=tables[2],
        check=PlanCheck(
            ok=check.ok,
            reason=check.reason,
            peak_speed_rad_s=check.peak_speed_rad_s,
            peak_torque_nm=check.peak_torque_nm,
            min_clearance_m=check.min_clearance_m,
        ),
        steps=message.steps,
        advance_m=message.advance_m,
    )


def _table(raw: bytes) -> NDArray[np.float64]:
    if not raw or len(raw) % 32:
        raise msgspec.ValidationError("A plan's table is not rows of four")
    return np.frombuffer(raw).reshape(-1, 4)
