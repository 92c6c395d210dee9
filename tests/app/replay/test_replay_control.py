"""Control's decisions, made again from its records, are the recorded ones; a changed value is told."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from functools import cache

import msgspec
import pytest
from hypothesis import HealthCheck, settings
from hypothesis.stateful import initialize

from app.control.loop import limits_record
from app.ipc.messages import OperatorKind
from app.ipc.states import Action, Event, RequestRefusal
from app.motion.plan import PLAN_SPEED_SHARE, PlanFault
from app.replay.control import DECISIONS
from app.replay.session import Replayed, Writer, replay
from app.system.program import PROGRAM, RULES, program_identity
from hal.joints.protocol import Joint
from kgdfa.gesture import Gesture
from logs import records as r
from logs.reason import Reason, reason
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
    rig.tick(100)
    rig.release(Gesture.ONE, held_ms=400)  # refused: pressed before the arming
    rig.tick(20)
    rig.send(K.ACT, A.STEP_RIGHT_FIRST)
    rig.tick(100)
    rig.send(K.STOP)
    rig.tick(5)
    rig.send(K.ACT, A.STEP_LEFT)  # refused: STOP
    rig.settle()
    rig.send(K.ACKNOWLEDGE)
    rig.tick(100)
    rig.release(Gesture.ONE, held_ms=400)  # refused: pressed before the acknowledgement
    rig.tick(20)
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


def test_presses_after_an_acknowledgement_that_covers_nothing_are_counted_again_as_control_counted_them() -> None:
    rig = begun()
    rig.tick(40)
    for kind, age_ms in ((K.STOP, 60), (K.ACKNOWLEDGE, 30), (K.VOICE_STOP, 0), (K.STOP, 0)):
        rig.send(kind, age_ms=age_ms)
        rig.tick()
    rig.tick(5)
    bodies = [limits_record(SETTINGS), *rig.audit]
    assert [body.effect for body in bodies if isinstance(body, r.Stop)] == ["hold", "hold", "damp"]
    assert replay(trail(bodies, "control")).differences == ()


def test_presses_that_a_takeover_overtook_are_counted_again_as_control_counted_them() -> None:
    rig = begun()
    rig.act(A.INITIALISE)
    rig.lease, rig._sequence = 2, 0
    for kind, age_ms in ((K.TAKE_OVER, 0), (K.VOICE_STOP, 1800), (K.STOP, 1500), (K.STOP, 1000), (K.STOP, 2000)):
        rig.send(kind, age_ms=age_ms)
        rig.tick()
    rig.tick(5)
    bodies = [limits_record(SETTINGS), *rig.audit]
    assert [body.effect for body in bodies if isinstance(body, r.Stop)] == ["hold", "hold", "hold", "damp", "damp"]
    assert replay(trail(bodies, "control")).differences == ()


def test_whatever_a_refusal_recorded_is_decided_again(session: list[Body]) -> None:
    for place, body in enumerate(session):
        if not isinstance(body, r.Refusal) or body.number:
            continue
        for field in ("reason", "event", "state", "value", "limit"):
            tampered = [*session]
            tampered[place] = msgspec.structs.replace(body, **{field: changed(field, getattr(body, field))})
            told = replay(trail(tampered, "control")).differences
            assert (place, field) in {(one.sequence, one.field) for one in told}, body


def test_trails_that_compared_the_release_with_the_arming_are_replayed_as_they_were_decided() -> None:
    """They name no press, and no moment of an acknowledgement: a press from before either commanded."""
    rig = begun()
    rig.act(A.INITIALISE)
    rig.send(K.STOP)
    rig.tick(300)
    rig.send(K.ACKNOWLEDGE)
    rig.tick(20)
    rig.release(Gesture.ONE)
    rig.tick(20)
    command = next(body for body in reversed(rig.audit) if isinstance(body, r.Command))
    older = [limits_record(SETTINGS), *(without_presses(body) for body in rig.audit)]
    assert replay(trail(older, "control")).differences == ()
    armed_ns = next(body.at_ns for body in reversed(rig.audit) if isinstance(body, r.Acknowledgement))
    early = [*older]
    early[early.index(without_presses(command))] = msgspec.structs.replace(command, pressed_ns=armed_ns - 1)
    assert replay(trail(early, "control")).differences == (), "nor did an acknowledgement without its moment count"
    now = [limits_record(SETTINGS), *rig.audit]
    now[now.index(command)] = msgspec.structs.replace(command, pressed_ns=armed_ns - 1)
    assert {one.field for one in replay(trail(now, "control")).differences} == {"decision"}


def test_a_push_from_before_the_confirmation_is_refused_again() -> None:
    rig = Rig()
    rig.tick(2)
    rig.send(K.ARM)
    rig.tick(300)
    rig.send(K.CONFIRM_PATIENT)
    rig.tick(120)
    rig.release(Gesture.ZERO, held_ms=400)
    rig.tick(20)
    refused = [body.reason for body in rig.audit if isinstance(body, r.Refusal)]
    assert refused == [reason(RequestRefusal.RELEASED_BEFORE_ARMING)]
    assert replayed(rig).differences == ()


def without_presses(body: Body) -> Body:
    if isinstance(body, r.Command | r.Refusal):
        return msgspec.structs.replace(body, pressed_ns=0)
    return msgspec.structs.replace(body, at_ns=0) if isinstance(body, r.Acknowledgement) else body


def test_a_gesture_outside_the_vocabulary_is_refused_again() -> None:
    rig = begun()
    rig.settings = replace(SETTINGS, vocabulary=frozenset(Gesture) - {Gesture.ZERO})
    rig.tick(40)
    rig.release(Gesture.ZERO)
    rig.tick(20)
    assert [body.gesture for body in rig.audit if isinstance(body, r.Refusal)] == ["0"]
    bodies = [limits_record(SETTINGS), *rig.audit]
    assert replay(trail([chosen("1 2 3 4 6"), *bodies], "control")).differences == ()
    differing = replay(trail(bodies, "control")).differences  # a profile of an older program commands with all twelve
    assert {one.field for one in differing} & {"reason", "decision"}


def chosen(vocabulary: str) -> r.PatientChosen:
    return r.PatientChosen(patient="demo", parameters={"vocabulary": vocabulary.split()})


def test_a_changed_gait_is_told(session: list[Body]) -> None:
    for kind, field in ((r.GaitChanged, "state"), (r.Transition, "to_state"), (r.ActionEnd, "to_state")):
        place = next(at for at, body in enumerate(session) if isinstance(body, kind))
        tampered = [*session]
        tampered[place] = msgspec.structs.replace(session[place], **{field: "sitting"})
        told = replay(trail(tampered, "control")).differences
        assert (told[0].sequence, told[0].field, told[0].recorded) == (place, field, "sitting")


def _tampered(session: list[Body], place: int, **values: object) -> set[tuple[int, str]]:
    tampered = [*session]
    tampered[place] = msgspec.structs.replace(session[place], **values)
    return {(one.sequence, one.field) for one in replay(trail(tampered, "control")).differences}


def test_a_stop_and_what_it_ends_are_made_again(session: list[Body]) -> None:
    stops = [at for at, body in enumerate(session) if isinstance(body, r.Stop)]
    assert [session[at].effect for at in stops] == ["hold", "hold", "damp"]  # type: ignore[union-attr]
    for place in stops:
        assert (place, "effect") in _tampered(session, place, effect="pause")
        assert (place, "state") in _tampered(session, place, state="between")
    place = next(at for at, body in enumerate(session) if isinstance(body, r.ActionEnd) and body.outcome == "stopped")
    assert (place, "outcome") in _tampered(session, place, outcome="completed")
    assert (place, "reason") in _tampered(session, place, reason=Reason("Event.CAMERA_STALE"))
    raised = next(at for at, body in enumerate(session) if isinstance(body, r.EventRaised) and body.event == "stop")
    assert replay(trail([*session[:raised], *session[raised + 1 :]], "control")).differences
    later = next(at for at, body in enumerate(session) if at > raised and isinstance(body, r.Refusal))
    assert (later, "in_force") in _tampered(session, later, in_force=())  # a STOP stays until acknowledged


def test_a_plan_beyond_a_limit_may_not_run_and_a_refused_one_is_beyond_its_limit() -> None:
    limits = limits_record(SETTINGS)
    assert limits.speed_rad_s[0] is not None
    limit = PLAN_SPEED_SHARE * limits.speed_rad_s[0]
    quick = r.PlanChecked(
        number=1,
        action="walk",
        phase="x",
        ok=True,
        reason=None,
        duration_s=1.0,
        peak_speed_rad_s=(limit, 0, 0, 0),
        min_clearance_m=0.05,
    )

    def told(**values: object) -> list[str]:
        body = msgspec.structs.replace(quick, **values)
        return [one.field for one in replay(trail([limits, body], "control")).differences]

    assert told() == []
    assert told(peak_speed_rad_s=(limit + 1e-9, 0, 0, 0)) == ["ok"]
    assert told(min_clearance_m=0.0199) == ["ok"]
    too_fast = reason(PlanFault.TOO_FAST, joint=Joint(0), speed_rad_s=limit + 1, limit_rad_s=limit)
    assert told(ok=False, reason=too_fast, peak_speed_rad_s=(limit + 1, 0, 0, 0)) == []
    assert told(ok=False, reason=too_fast) == ["reason"]


NAMES = ("state", "action", "source", "change", "phase", "event", "effect", "to_effect", "in_force")


def test_a_name_that_this_program_does_not_have_is_told(session: list[Body]) -> None:
    for kind in {type(body) for body in session if isinstance(body, DECISIONS)} - {r.PlanChecked}:
        place = next(at for at, body in enumerate(session) if type(body) is kind)
        for field in set(NAMES) & set(kind.__struct_fields__):
            name = ("bogus",) if field == "in_force" else "bogus"
            told = _tampered(session[: place + 3], place, **{field: name})
            assert place in {sequence for sequence, _ in told}, (kind, field)


def test_the_replay_tells_who_wrote_the_trail(session: list[Body]) -> None:
    now = program_identity()

    def writer(versions: dict[str, str]) -> Writer:
        start = r.SessionStart(versions=versions, configuration={}, simulated=True)
        return replay(trail([start, *session[:3]], "control")).writer

    assert writer(now | {"numpy": "1"}) is Writer.SAME
    assert writer(now | {PROGRAM: "0"}) is Writer.SAME_RULES
    assert writer(now | {RULES: "0"}) is Writer.OTHER_RULES
    assert writer({"rleex": "0.1.0"}) is Writer.NOT_RECORDED
    assert replay(trail(session, "control")).writer is Writer.NOT_RECORDED


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
    wrong = [one for one in again.differences if one.kind == "event-raised"]
    assert wrong == [], "where its value stands in the diagnostics: _PLACE, app/replay/events.py"
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
