"""The paper's twelve transitions and the recovery after a stop, as one table: adding a transition is adding a row."""

from __future__ import annotations

from dataclasses import dataclass

from app.ipc.states import Action, GaitState
from app.motion.plan import Phase


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One transition: which action leads from where, through what, to where."""

    action: Action
    source: GaitState
    to: GaitState
    through: GaitState | None = None
    phase: Phase = Phase.WHOLE
    chained: bool = False  # begins by itself when the step before has ended


S, A, P = GaitState, Action, Phase
TABLE = (
    Row(action=A.INITIALISE, source=S.UNPOWERED, to=S.STANDING),
    Row(action=A.INITIALISE, source=S.BETWEEN, to=S.STANDING),
    Row(action=A.STAND_UP, source=S.SITTING, to=S.STANDING),
    Row(action=A.SIT_DOWN, source=S.STANDING, to=S.SITTING),
    Row(action=A.STEP_RIGHT_FIRST, source=S.STANDING, to=S.RIGHT_FORWARD),
    Row(action=A.STEP_LEFT, source=S.RIGHT_FORWARD, to=S.LEFT_FORWARD),
    Row(action=A.STEP_RIGHT, source=S.LEFT_FORWARD, to=S.RIGHT_FORWARD),
    Row(action=A.STEP_END, source=S.RIGHT_FORWARD, to=S.STANDING),
    Row(action=A.WALK, source=S.STANDING, to=S.LEFT_FORWARD, phase=P.WALK_START),
    Row(action=A.WALK, source=S.LEFT_FORWARD, to=S.RIGHT_FORWARD, phase=P.WALK_RIGHT, chained=True),
    Row(action=A.WALK, source=S.RIGHT_FORWARD, to=S.LEFT_FORWARD, phase=P.WALK_LEFT, chained=True),
    Row(action=A.WALK_END, source=S.LEFT_FORWARD, to=S.STANDING, phase=P.WALK_CLOSE_RIGHT, chained=True),
    Row(action=A.WALK_END, source=S.RIGHT_FORWARD, to=S.STANDING, phase=P.WALK_CLOSE_LEFT, chained=True),
    Row(action=A.STAIR_UP, source=S.STANDING, through=S.RIGHT_HIGH_STEP, to=S.STANDING),
    Row(action=A.STAIR_DOWN, source=S.STANDING, through=S.RIGHT_LOW_STEP, to=S.STANDING),
    Row(action=A.OBSTACLE, source=S.STANDING, through=S.RIGHT_OBSTACLE, to=S.STANDING),
)
