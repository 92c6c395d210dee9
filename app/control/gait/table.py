"""The paper's twelve transitions and the recovery after a stop, as one table: adding a transition is adding a row."""

from __future__ import annotations

from dataclasses import dataclass

from app.ipc.states import GESTURE_OF, Action, GaitState
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


def mermaid() -> str:
    """The table as a Mermaid state diagram."""
    lines = ["stateDiagram-v2", "    [*] --> UNPOWERED"]
    for row in TABLE:
        gesture = f"gesture {GESTURE_OF[row.action].value}" if not row.chained else _chain_label(row)
        if row.through is None:
            lines.append(f"    {row.source.name} --> {row.to.name}: {gesture}")
        else:
            lines.append(f"    {row.source.name} --> {row.through.name}: {gesture}")
            lines.append(f"    {row.through.name} --> {row.to.name}: completed")
    lines.append("    note right of BETWEEN: entered from every state by a stop in mid-movement")
    lines.append("    note right of UNPOWERED: entered from every state when the drives lose power")
    return "\n".join(lines) + "\n"


def _chain_label(row: Row) -> str:
    return "gesture 6, latched" if row.action is Action.WALK_END else "next step of the walk"
