"""The shortest way from one state to another, by the gait machine's own table."""

from __future__ import annotations

import pytest

from app.control.gait.table import TABLE
from app.ipc.states import Action, GaitState
from app.motion.plan import Phase

THROUGH = frozenset(row.through for row in TABLE if row.through is not None)


def first_action(state: GaitState, goal: GaitState) -> Action:
    """The first action on the shortest way from one state to another, by the gait machine's own table."""
    ways: list[tuple[GaitState, tuple[Action, ...]]] = [(state, ())]
    for at, way in ways:  # it grows while it is walked through
        for row in TABLE:
            if row.source is at and row.phase is Phase.WHOLE and len(way) < len(GaitState):
                if goal in {row.through, row.to}:
                    return (*way, row.action)[0]
                ways.append((row.to, (*way, row.action)))
    pytest.fail(f"no action leads from {state} to {goal}")
