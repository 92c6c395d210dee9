"""The figures that a tick writes into the trail, and words that were said and are over."""

from __future__ import annotations

import math
from typing import TypeVar

import pytest

from app.control.events.table import LINGER_NS
from app.control.step import END_HOLD_NS
from app.ipc.states import Effect, Event, RequestRefusal
from app.ipc.streams import TRIGGER
from app.motion.follower import Mode
from hal.joints.guard import Quantity, Refusal
from hal.joints.protocol import DriveState, Joint
from logs import records
from logs.reason import reason
from tests.app.control.moments import DAMPING_TICKS, A, K, S, moving, now, standing
from tests.app.control.rig import TICK_NS, Rig

B = TypeVar("B")


def every(rig: Rig, kind: type[B]) -> list[B]:
    """The trail's records of a kind."""
    return [body for body in rig.audit if isinstance(body, kind)]


def only(rig: Rig, kind: type[B]) -> B:
    """The one that there is."""
    (body,) = every(rig, kind)
    return body


@pytest.mark.parametrize(
    ("value", "limit", "kept"),
    [
        (9.0, 4.0, (9.0, 4.0)),
        (-9.0, 4.0, (-9.0, 4.0)),
        (math.nan, math.inf, (None, None)),
        (-math.inf, 4.0, (None, 4.0)),
        (math.inf, 4.0, (None, 4.0)),
        (9.0, math.inf, (9.0, None)),
    ],
)
def test_a_refusal_keeps_the_numbers_that_are_some(
    value: float, limit: float, kept: tuple[float | None, float | None]
) -> None:
    rig = moving()
    refused = Refusal(joint=Joint.LEFT_KNEE, quantity=Quantity.SPEED, value=value, limit=limit)
    rig.spoil["guard_refusal"] = refused
    rig.tick()
    body = only(rig, records.GuardRefusal)
    assert (body.value, body.limit) == kept
    assert (body.joint, body.quantity, body.reason) == (
        "left_knee",
        Quantity.SPEED.value,
        reason(refused.code, **refused.values),
    )


def test_an_event_that_is_over_tells_how_long_it_was_there() -> None:
    rig = standing()
    rig.audit.clear()
    rig.spoil["wall_ns"] = rig.now_ns + 9_000_000_000
    rig.tick()
    raised = only(rig, records.EventRaised)
    assert (raised.event, raised.effect) == (Event.CLOCK_JUMP.value, "note")
    raised_ns = rig.now_ns
    rig.run_until(lambda m: not m.events)
    cleared = every(rig, records.EventCleared)[-1]
    assert (cleared.event, cleared.effect) == (Event.CLOCK_JUMP.value, "note")
    assert cleared.lasted_s == (rig.now_ns - raised_ns) / 1e9
    assert cleared.lasted_s == pytest.approx(LINGER_NS / 1e9, abs=0.01)


def test_a_stream_that_was_silent_tells_for_how_long() -> None:
    rig = standing()
    rig.watching = False
    rig.run_until(lambda _: Event.PERCEPTION_TIMEOUT.value in rig.events())
    lost = only(rig, records.HeartbeatLost)
    assert (lost.stream, lost.age_ms) == (TRIGGER.name, TRIGGER.stale_ms)
    lost_ns = rig.now_ns
    rig.tick(250)
    rig.watching = True
    rig.run_until(lambda _: Event.PERCEPTION_TIMEOUT.value not in rig.events())
    heard_ns = rig.now_ns
    rig.tick(LINGER_NS // TICK_NS + 10)
    found = only(rig, records.HeartbeatFound)
    assert found.stream == TRIGGER.name
    assert found.silent_ms == pytest.approx(TRIGGER.stale_ms + (heard_ns - TICK_NS - lost_ns) / 1e6)


def test_the_end_holds_for_just_so_long() -> None:
    rig = standing()
    rig.send(K.SHUT_DOWN)
    rig.tick()
    began_ns = rig.now_ns
    assert now(rig).effect is Effect.HOLD
    rig.run_until(lambda m: m.effect is Effect.DAMP)
    assert rig.now_ns - began_ns == END_HOLD_NS + TICK_NS
    assert END_HOLD_NS == 400_000_000


def test_torque_off_is_said_once_and_not_for_the_next_time_that_the_joints_give_way() -> None:
    rig = standing()
    rig.send(K.STOP)
    rig.send(K.STOP)
    rig.tick(300)
    rig.send(K.TORQUE_OFF)
    rig.run_until(lambda _: rig.joints.state is DriveState.DISABLED)
    rig.send(K.ACKNOWLEDGE)
    rig.tick(60)
    rig.act(A.INITIALISE)
    assert now(rig).gait.state is S.STANDING
    rig.send(K.STOP)
    rig.send(K.STOP)
    rig.tick(1000)
    assert now(rig).effect is Effect.DAMP
    assert rig.joints.state is DriveState.ENABLED


@pytest.mark.parametrize("joint", Joint)
def test_the_joint_that_is_silent_is_named(joint: Joint) -> None:
    rig = standing()
    silent_since_ns = rig.now_ns
    for _ in range(9):
        feedback = rig.joints.feedback(rig.now_ns + TICK_NS)
        feedback.measured_ns[joint] = silent_since_ns
        rig.spoil["feedback"] = feedback
        rig.tick()
    (raised,) = (body for body in every(rig, records.EventRaised) if body.event == Event.JOINT_TIMEOUT.value)
    assert raised.text == reason(Event.JOINT_TIMEOUT, detail=joint)


def test_a_wish_while_the_legs_come_to_rest_is_told_to_wait() -> None:
    rig = moving()
    rig.send(K.STOP)
    rig.tick()
    rig.send(K.ACKNOWLEDGE)
    rig.tick()
    assert not now(rig).motion.settled
    rig.send(K.ACT, A.INITIALISE)
    rig.tick()
    assert now(rig).refusal == reason(RequestRefusal.COMING_TO_REST)
    assert now(rig).running is None
    rig.settle()
    rig.act(A.INITIALISE)
    assert now(rig).gait.state is S.STANDING


def test_giving_way_goes_on_from_the_command_that_left_when_one_is_refused() -> None:
    rig = standing()
    rig.send(K.STOP)
    rig.send(K.STOP)
    rig.tick(30)
    left = rig.command
    rig.spoil["guard_refusal"] = Refusal(joint=Joint.LEFT_KNEE, quantity=Quantity.SPEED, value=9.0, limit=4.0)
    rig.tick()
    assert now(rig).motion.mode is Mode.DAMPED
    assert now(rig).motion.origin is left
    assert rig.command.stiffness_nm_rad.max() <= left.stiffness_nm_rad.max()
    rig.tick(DAMPING_TICKS + 1)
    assert now(rig).motion.fully_damped
    assert rig.command.stiffness_nm_rad.max() == 0


def test_asking_twice_for_the_end_does_not_put_it_off() -> None:
    rig = standing()
    rig.send(K.SHUT_DOWN)
    rig.tick()
    began_ns = now(rig).ending_ns
    rig.tick(50)
    rig.send(K.SHUT_DOWN)
    rig.tick()
    assert now(rig).ending_ns == began_ns
