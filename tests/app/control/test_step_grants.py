"""One tick after the other: every state × wish × busy × armed, and what is granted."""

from __future__ import annotations

import numpy as np
import pytest

from app.ipc.states import GESTURE_OF, Action, GaitState, Outcome, Source
from logs import records
from tests.app.control.moments import GRANTED, RESTS, A, K, S, moving, now, records_of, request, resting


@pytest.mark.parametrize("armed", [True, False])
@pytest.mark.parametrize("source", Source)
@pytest.mark.parametrize("action", Action)
@pytest.mark.parametrize("state", RESTS)
def test_at_rest_the_table_and_the_arming_decide(state: GaitState, action: Action, source: Source, armed: bool) -> None:
    rig = resting(state)
    if not armed:
        rig.send(K.DISARM)
        rig.tick()
    before = now(rig).refusal_count
    request(rig, action, source)
    rig.tick(20)
    wanted = action in GRANTED[state] and (armed or source is Source.THERAPIST)
    assert (now(rig).running is not None) is wanted
    assert now(rig).refusal_count == before + (not wanted)
    commands = records_of(rig, records.Command)
    assert len(commands) == wanted
    if wanted:
        command = commands[0]
        assert isinstance(command, records.Command)
        assert command.source == source.value
        assert command.gesture == (GESTURE_OF[action].value if source is Source.GESTURE else None)
        if action is A.WALK:
            rig.send(K.ACT, A.WALK_END)
        done = rig.settle()
        assert done.gait.state is not state or action in {A.WALK, A.STAIR_UP, A.STAIR_DOWN, A.OBSTACLE}
        assert done.reports[-1].outcome is Outcome.COMPLETED
    else:
        assert now(rig).refusal
        assert records_of(rig, records.Refusal)


@pytest.mark.parametrize("source", Source)
@pytest.mark.parametrize("action", Action)
@pytest.mark.parametrize("running", [A.STEP_RIGHT_FIRST, A.STAIR_UP, A.OBSTACLE, A.STAIR_DOWN, A.SIT_DOWN, A.WALK])
def test_during_a_movement_only_the_end_of_a_walk_is_heard(running: Action, action: Action, source: Source) -> None:
    rig = moving(running)
    path = rig.command.position_rad
    request(rig, action, source)
    rig.tick(18)
    if (running, action) == (A.WALK, A.WALK_END):
        assert now(rig).gait.closing
        assert rig.settle().gait.state is S.STANDING
        assert [report.outcome for report in now(rig).reports[-2:]] == ["completed", Outcome.COMPLETED]
    else:
        assert now(rig).gait.running is running
        assert now(rig).ignored_count == 1
        assert not now(rig).gait.closing
        assert not np.array_equal(rig.command.position_rad, path), "the movement goes on"
        assert records_of(rig, records.Refusal)
