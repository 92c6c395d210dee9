"""A planner that answers at once: smooth ways between the poses of the table's states, without a body behind them."""

from __future__ import annotations

import numpy as np

from app.control.gait.table import TABLE
from app.ipc.states import Action, GaitState
from app.motion.plan import Phase, Plan, PlanCheck, PlanRequest
from hal.joints.protocol import TICK_HZ
from hal.minimum_jerk import minimum_jerk, minimum_jerk_rate

POSES = {
    GaitState.STANDING: np.zeros(4),
    GaitState.SITTING: np.array([1.4, 1.5, 1.4, 1.5]),
    GaitState.RIGHT_FORWARD: np.array([-0.15, 0.1, 0.3, 0.2]),
    GaitState.LEFT_FORWARD: np.array([0.3, 0.2, -0.15, 0.1]),
}
CHECK = PlanCheck(peak_speed_rad_s=(1.0,) * 4, peak_torque_nm=(30.0,) * 4, min_clearance_m=0.05)
FASTEST_RAD_S = 2.5


def lands_in(action: Action, phase: Phase, state: GaitState) -> GaitState:
    """Where the table says that a movement leads."""
    return next(
        row.to
        for row in TABLE
        if row.action is action and row.phase is phase and (row.source is state or row.chained or row.through)
    )


def make_plan(request: PlanRequest, duration_s: float = 0.4) -> Plan:
    """A smooth way from the pose asked for to the pose of the state it leads to."""
    to_state = lands_in(request.action, request.phase, request.from_state)
    start_rad, end_rad = np.array(request.start_rad), POSES[to_state]
    duration_s = max(duration_s, 1.875 * float(np.abs(end_rad - start_rad).max()) / FASTEST_RAD_S)
    s = np.linspace(0.0, 1.0, int(duration_s * TICK_HZ) + 1)[:, None]
    shape, rate = minimum_jerk(s), minimum_jerk_rate(s) / duration_s
    bump = np.array([0.1, 0.2, 0.1, 0.2]) * np.sin(np.pi * s) ** 2
    bump_rate = np.array([0.1, 0.2, 0.1, 0.2]) * np.pi / duration_s * np.sin(2 * np.pi * s)
    return Plan(
        number=request.number,
        action=request.action,
        phase=request.phase,
        from_state=request.from_state,
        to_state=to_state,
        position_rad=start_rad + shape * (end_rad - start_rad) + bump,
        velocity_rad_s=rate * (end_rad - start_rad) + bump_rate,
        torque_nm=np.tile([5.0, -5.0, 5.0, -5.0], (len(s), 1)),
        check=CHECK,
        steps=1,
        advance_m=0.3,
    )
