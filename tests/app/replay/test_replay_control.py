"""Control's decisions, made again from its records, are the recorded ones; a changed value is told."""

from __future__ import annotations

from copy import deepcopy
from functools import cache

import msgspec
import pytest
from hypothesis import HealthCheck, settings
from hypothesis.stateful import initialize

from app.control.loop import limits_record
from app.ipc.messages import OperatorKind
from app.ipc.states import Action, Event
from app.replay.control import DECISIONS
from app.replay.session import Replayed, replay
from hal.joints.protocol import Joint
from kgdfa.gesture import Gesture
from logs import records as r
from logs.reason import Reason
from logs.records import Body
from tests.app.control.causes import CAUSES
from tests.app.control.moments import standing
from tests.app.control.rig import SETTINGS, TICK_NS, Rig
from tests.app.control.test_step_random import JointDiagnostics
from tests.app.replay.test_replay_perception import changed, trail

A, K = Action, OperatorKind


def replayed(rig: Rig) -> Replayed:
    return replay(trail([limits_record(SETTINGS), *rig.audit], "control"))


def begun() -> Rig:
    """Ready for the first action, from the first tick on."""
    rig = Rig()
    rig.tick(2)
    rig.send(K.CONFIRM_PATIENT)
    rig.send(K.ARM)
    rig.tick(2)
    return rig


def walked() -> Rig:
    """Actions by key and by gesture, a walk, refusals of every kind, STOP in mid-step, power off."""
    rig = begun()
    rig.send(K.ACT, A.WALK)  # refused: unpowered
    rig.tick(2)
    rig.act(A.INITIALISE)
    rig.release(Gesture.FIVE)
    rig.tick(20)
    rig.send(K.ACT, A.SIT_DOWN)  # ignored: walking
    rig.tick(2)
    rig.run_until(lambda state: state.steps > 1, limit=5000)
    rig.send(K.ACT, A.WALK_END)
    rig.settle()
    rig.send(K.ACT, A.STAND_UP)  # refused: standing
    rig.send(K.ACT, A.SIT_DOWN, age_ms=900)  # refused: expired
    rig.tick(2)
    rig.release(Gesture.ONE, age_ms=900)  # refused: stale
    rig.tick(40)
    rig.refuse_plans = "too fast"
    rig.send(K.ACT, A.SIT_DOWN)
    rig.tick(20)
    rig.refuse_plans = ""
    rig.send(K.DISARM)
    rig.tick()
    rig.release(Gesture.ONE)  # refused: not armed
    rig.tick(20)
    rig.send(K.ARM)
    rig.release(Gesture.ONE, age_ms=10)  # refused: released before the arming
    rig.tick(20)
    rig.send(K.ACT, A.STEP_RIGHT_FIRST)
    rig.tick(100)
    rig.send(K.STOP)
    rig.tick(5)
    rig.send(K.ACT, A.STEP_LEFT)  # refused: STOP
    rig.settle()
    rig.send(K.ACKNOWLEDGE)
    rig.tick(5)
    rig.act(A.INITIALISE)
    rig.send(K.STOP)
    rig.send(K.STOP)
    rig.tick(500)
    rig.send(K.TORQUE_OFF)
    rig.tick(20)
    return rig


@pytest.fixture(scope="module")
def session() -> list[Body]:
    return [limits_record(SETTINGS), *walked().audit]


def test_a_session_with_refusals_and_stops_is_replayed_whole(session: list[Body]) -> None:
    again = replay(trail(session, "control"))
    assert again.differences == ()
    assert again.replayed == sum(isinstance(body, DECISIONS) for body in session) > 50
    reasons = {body.reason.code for body in session if isinstance(body, r.Refusal) and isinstance(body.reason, Reason)}
    assert len(reasons) >= 9


def test_whatever_a_refusal_recorded_is_decided_again(session: list[Body]) -> None:
    for place, body in enumerate(session):
        if not isinstance(body, r.Refusal) or body.number:
            continue
        for field in ("reason", "event", "state", "value", "limit"):
            tampered = [*session]
            tampered[place] = msgspec.structs.replace(body, **{field: changed(field, getattr(body, field))})
            told = replay(trail(tampered, "control")).differences
            assert (place, field) in {(one.sequence, one.field) for one in told}, body


def test_a_changed_gait_is_told(session: list[Body]) -> None:
    for kind, field in ((r.GaitChanged, "state"), (r.Transition, "to_state"), (r.ActionEnd, "to_state")):
        place = next(at for at, body in enumerate(session) if isinstance(body, kind))
        tampered = [*session]
        tampered[place] = msgspec.structs.replace(session[place], **{field: "sitting"})
        told = replay(trail(tampered, "control")).differences
        assert (told[0].sequence, told[0].field, told[0].recorded) == (place, field, "sitting")


def test_a_record_left_out_is_told(session: list[Body]) -> None:
    for kind in (r.Command, r.GaitChanged, r.Transition):
        place = next(at for at, body in enumerate(session) if isinstance(body, kind))
        assert replay(trail([*session[:place], *session[place + 1 :]], "control")).differences


@pytest.mark.parametrize("event", Event)
def test_every_event_with_a_number_is_raised_again_by_it_and_by_no_smaller_one(event: Event) -> None:
    cause = CAUSES[event]
    rig = Rig() if cause.fresh else standing()
    rig.tick(2)
    rig.audit.clear()
    cause.make(rig)
    rig.tick(cause.ticks)
    again = replayed(rig)
    assert [one for one in again.differences if one.kind == "event-raised"] == []
    for place, body in enumerate(bodies := [limits_record(SETTINGS), *rig.audit]):
        if not isinstance(body, r.EventRaised) or body.value is None or body.limit is None or body.event != event.value:
            continue
        within = body.limit / 2 if body.quantity != "angle_rad" else 0.1
        bodies[place] = msgspec.structs.replace(body, value=within)
        told = [one for one in replay(trail(bodies, "control")).differences if one.sequence == place]
        assert told or body.event in {Event.GUARD_REFUSAL.value, Event.CAMERA_STALE.value}


def test_a_hot_joint_is_told_by_its_limit() -> None:
    rig = begun()
    feedback = rig.joints.feedback(rig.now_ns + TICK_NS)
    feedback.temperature_c[Joint.RIGHT_KNEE] = 81.0
    rig.spoil["feedback"] = feedback
    rig.tick(3)
    assert replayed(rig).differences == ()


@cache
def stood_up() -> Rig:
    rig = begun()
    rig.act(A.INITIALISE)
    return rig


class AnyOrder(JointDiagnostics):
    """The random orders of the step's own test, from the first tick on."""

    @initialize()
    def initial_state(self) -> None:
        self.rig = deepcopy(stood_up())
        self._note()

    def teardown(self) -> None:
        assert replayed(self.rig).differences == ()


TestAnyOrder = AnyOrder.TestCase
TestAnyOrder.settings = settings(
    max_examples=10, stateful_step_count=30, deadline=None, suppress_health_check=list(HealthCheck)
)
