"""Rigs at the moments that the tests of a tick start from, and what to look at in them."""

from __future__ import annotations

from copy import deepcopy
from functools import cache
from typing import TypeVar

import numpy as np

from app.control.running_action import Stage
from app.control.state import ControlState
from app.ipc.messages import OperatorKind
from app.ipc.states import GESTURE_OF, Action, GaitState, Source
from app.motion.follower import DAMPING_RAMP_S, HOLD_S
from hal.joints.device import Joint
from hal.joints.protocol import TICK_HZ, DriveState
from tests.app.control.rig import Rig

B = TypeVar("B")
S, A, K = GaitState, Action, OperatorKind
RESTS = (S.UNPOWERED, S.STANDING, S.SITTING, S.RIGHT_FORWARD, S.LEFT_FORWARD, S.BETWEEN)
GRANTED = {
    S.UNPOWERED: {A.INITIALISE},
    S.STANDING: {A.STEP_RIGHT_FIRST, A.WALK, A.STAIR_UP, A.STAIR_DOWN, A.OBSTACLE, A.SIT_DOWN},
    S.SITTING: {A.STAND_UP},
    S.RIGHT_FORWARD: {A.STEP_LEFT, A.STEP_END},
    S.LEFT_FORWARD: {A.STEP_RIGHT},
    S.BETWEEN: {A.INITIALISE},
}
_WAYS: dict[GaitState, tuple[Action, ...]] = {
    S.STANDING: (),
    S.SITTING: (A.SIT_DOWN,),
    S.RIGHT_FORWARD: (A.STEP_RIGHT_FIRST,),
    S.LEFT_FORWARD: (A.STEP_RIGHT_FIRST, A.STEP_LEFT),
    S.BETWEEN: (),
}
HOLD_TICKS = int(HOLD_S * TICK_HZ)
DAMPING_TICKS = int(DAMPING_RAMP_S * TICK_HZ)


def resting(state: GaitState) -> Rig:
    """A rig that rests in a state, settled; each call gives one of its own."""
    return deepcopy(_resting(state))


def standing() -> Rig:
    """A rig that stands: patient confirmed, gestures armed."""
    return resting(S.STANDING)


def now(rig: Rig) -> ControlState:
    """The rig's memory."""
    assert rig.state is not None
    return rig.state


def records_of(rig: Rig, kind: type[B]) -> list[B]:
    """The trail's records of a kind."""
    return [body for body in rig.audit if isinstance(body, kind)]


def drives(rig: Rig) -> DriveState:
    """What the drives say of themselves."""
    return rig.joints.state


def moving(action: Action = A.STEP_RIGHT_FIRST, state: GaitState = S.STANDING) -> Rig:
    """A rig in the middle of an action."""
    return deepcopy(_moving(action, state))


@cache
def _resting(state: GaitState) -> Rig:
    """By the table's ways from drives without power."""
    rig = Rig()
    rig.tick(2)
    rig.send(K.CONFIRM_PATIENT)
    rig.send(K.ARM)
    if state is not S.UNPOWERED:
        _reach(rig, state)
    rig.tick(300)  # past the time in which the joints settle
    rig.history.clear()
    rig.audit.clear()
    return rig


def _reach(rig: Rig, state: GaitState) -> None:
    for action in (A.INITIALISE, *_WAYS[state]):
        rig.act(action)
    if state is S.BETWEEN:
        rig.send(K.ACT, A.STEP_RIGHT_FIRST)
        rig.tick(100)
        rig.send(K.STOP)
        rig.settle()
        rig.tick()
        rig.send(K.ACKNOWLEDGE)
        rig.tick()
    assert now(rig).gait.state is state, now(rig)


@cache
def _moving(action: Action, state: GaitState) -> Rig:
    rig = resting(state)
    rig.send(K.ACT, action)
    rig.run_until(lambda m: m.running is not None and m.running.stage is Stage.MOVING)
    rig.tick(60)
    rig.history.clear()
    return rig


def damped() -> Rig:
    """A rig whose joints are damped: stopped twice while it stood, and acknowledged."""
    rig = standing()
    for _ in range(2):
        rig.send(K.STOP)
    rig.tick(DAMPING_TICKS + 5)
    rig.send(K.ACKNOWLEDGE)
    rig.tick(2)
    rig.audit.clear()
    return rig


def request(rig: Rig, action: Action, source: Source) -> None:
    """An action asked for, by key or by hand."""
    if source is Source.THERAPIST:
        rig.send(K.ACT, action)
    else:
        rig.release(GESTURE_OF[action])


def sunk(rig: Rig, *joints: Joint) -> None:
    """These joints hang half a radian from where they are held, and do not follow."""
    rig.joints.stuck = True
    rig.joints.position_rad = rig.joints.position_rad + np.array([0.5 * (joint in joints) for joint in Joint])
