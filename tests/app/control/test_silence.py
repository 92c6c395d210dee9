"""Joints that fall silent: what has sunk meanwhile is let go, what has not is held."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from app.control.joint_diagnostics import FOLLOWING_WARN_RAD
from app.ipc.states import Effect, Event
from hal.joints.device import Joint
from hal.joints.protocol import DriveState
from logs import records
from tests.app.control.moments import K, moving, now, records_of, standing, sunk
from tests.app.control.rig import TICK_NS, Rig


def test_a_joint_that_sank_while_it_did_not_answer_is_not_pulled_back() -> None:
    rig = standing()
    rig.joints.silent = True
    rig.tick(100)
    assert now(rig).effect is Effect.HOLD
    rig.joints.silent = False
    sunk(rig, Joint.LEFT_HIP, Joint.LEFT_KNEE, Joint.RIGHT_HIP)
    rig.tick()
    assert now(rig).effect is Effect.DAMP
    assert Event.JOINT_SANK.value in rig.events()
    assert (rig.command.stiffness_nm_rad == 0).tolist() == [True, True, True, False], "the one in place is let down"
    rig.tick(300)
    assert now(rig).motion.fully_damped
    assert not records_of(rig, records.GuardRefusal)


def test_a_joint_that_is_where_it_was_when_it_answers_again_stays_held() -> None:
    rig = standing()
    rig.joints.silent = True
    rig.tick(100)
    rig.joints.silent = False
    rig.tick(100)
    assert rig.events() == {Event.JOINT_TIMEOUT.value}
    assert rig.command.stiffness_nm_rad.min() > 0
    sunk(rig, Joint.LEFT_KNEE)
    rig.tick()
    assert now(rig).effect is Effect.HOLD, "too far behind, but it answered all the way"
    assert Event.JOINT_SANK.value not in rig.events()


def test_a_joint_that_leaned_before_it_fell_silent_has_not_sunk() -> None:
    rig = standing()
    sunk(rig, Joint.LEFT_KNEE)
    rig.joints.silent = True
    rig.tick(100)
    rig.joints.silent = False
    rig.tick()
    assert Event.JOINT_SANK.value not in rig.events()
    assert rig.command.stiffness_nm_rad.min() > 0


@pytest.mark.parametrize("stalls", [0, 5])
def test_a_joint_that_sank_is_let_go_while_another_one_stays_silent(stalls: int) -> None:
    rig = standing()
    rig.tick()
    rig.joints.mute = frozenset({Joint.LEFT_HIP})
    for _ in range(stalls):  # nor do control's own stalls excuse who has answered since
        rig.now_ns += 30 * TICK_NS
        rig.spoil = {"late_ns": 30 * TICK_NS, "missed_ticks": 30}
        rig.tick(50)
    rig.joints.mute |= {Joint.LEFT_KNEE}
    rig.tick(100)
    sunk(rig, Joint.LEFT_KNEE)
    rig.joints.mute = frozenset({Joint.LEFT_HIP})
    rig.tick()
    assert Event.JOINT_SANK.value in rig.events()
    assert rig.command.stiffness_nm_rad[Joint.LEFT_KNEE] == 0


def test_a_joint_that_sinks_through_its_target_has_sunk() -> None:
    rig = standing()
    rig.tick()
    rig.joints.stuck = True
    knee = np.eye(4)[Joint.RIGHT_KNEE]
    rig.joints.position_rad = rig.joints.position_rad - 0.2 * knee
    rig.tick(5)
    rig.joints.mute = frozenset({Joint.RIGHT_KNEE})
    rig.tick(50)
    rig.joints.position_rad = rig.joints.position_rad + 0.4 * knee
    rig.joints.mute = frozenset()
    rig.tick()
    assert Event.JOINT_SANK.value in rig.events()


def test_short_silences_in_which_a_joint_sinks_add_up() -> None:
    rig = standing()
    rig.tick()
    rig.joints.stuck = True
    for _ in range(2):
        rig.joints.mute = frozenset({Joint.LEFT_KNEE})
        rig.tick(20)
        rig.joints.position_rad = rig.joints.position_rad + 0.12 * np.eye(4)[Joint.LEFT_KNEE]
        rig.joints.mute = frozenset()
        rig.tick()
    assert Event.JOINT_SANK.value in rig.events()


def test_a_joint_that_was_pushed_while_it_answered_has_not_sunk_in_a_later_silence() -> None:
    rig = standing()
    rig.tick()
    rig.joints.mute = frozenset({Joint.LEFT_KNEE})
    rig.tick(20)
    rig.joints.mute = frozenset()
    rig.tick(100)
    sunk(rig, Joint.LEFT_KNEE)
    rig.tick(100)
    rig.joints.mute = frozenset({Joint.LEFT_KNEE})
    rig.tick(20)
    rig.joints.mute = frozenset()
    rig.tick()
    assert Event.JOINT_SANK.value not in rig.events()


def test_a_damped_joint_that_moves_in_silence_has_not_sunk() -> None:
    rig = standing()
    rig.send(K.STOP)
    rig.send(K.STOP)
    rig.tick(300)
    rig.joints.mute = frozenset({Joint.LEFT_KNEE})
    rig.tick(50)
    sunk(rig, Joint.LEFT_KNEE)
    rig.joints.mute = frozenset()
    rig.tick()
    assert Event.JOINT_SANK.value not in rig.events()


def test_a_silence_that_was_acknowledged_while_it_lasted_lets_no_joint_be_pulled_back() -> None:
    rig = standing()
    rig.joints.silent = True
    rig.tick(100)
    rig.send(K.ACKNOWLEDGE)
    rig.tick(3)
    rig.joints.silent = False
    sunk(rig, Joint.RIGHT_KNEE)
    rig.tick()
    assert now(rig).effect is Effect.DAMP
    assert rig.command.stiffness_nm_rad[Joint.RIGHT_KNEE] == 0


@pytest.mark.parametrize("joint", Joint)
def test_the_speed_of_a_joint_that_fell_silent_in_a_swing_damps_nobody_when_the_legs_are_held(joint: Joint) -> None:
    """What it answered last is reported for ever; a connector is loose, or its cable breaks."""
    rig = moving()
    rig.joints.velocity_rad_s = 1.2 * np.eye(4)[joint]
    rig.tick()
    rig.joints.mute = frozenset({joint})
    assert max(rig.tick().effect for _ in range(500)) is Effect.HOLD
    assert rig.command.stiffness_nm_rad.min() > 0
    rig.joints.velocity_rad_s = rig.joints.velocity_rad_s + 0.61 * np.eye(4)[joint - 1]
    assert rig.tick().effect is Effect.DAMP, "another one that does answer"


def test_the_speed_of_a_joint_that_fell_silent_is_no_motion_when_its_drive_loses_power() -> None:
    rig = moving()
    rig.joints.velocity_rad_s = 1.2 * np.eye(4)[Joint.RIGHT_HIP]
    rig.tick()
    rig.joints.mute = frozenset({Joint.RIGHT_HIP})
    rig.tick(500)
    rig.joints.state = DriveState.DISABLED
    rig.tick()
    assert Event.DRIVES_POWER_LOST.value in rig.events()
    assert now(rig).effect is Effect.HOLD


def stand_still(rig: Rig, ticks: int) -> None:
    """Control comes back after so many ticks; nothing was asked meanwhile, and nothing has answered yet."""
    rig.joints.silent = True
    rig.now_ns += ticks * TICK_NS
    rig.spoil = {"late_ns": ticks * TICK_NS, "missed_ticks": ticks}
    rig.tick()
    rig.joints.silent = False


def sleep(rig: Rig, _: int) -> None:
    """The computer wakes after nine seconds, which only the boot clock counts."""
    rig.spoil = {"boot_ns": rig.now_ns + TICK_NS + 10_000_000_000}
    rig.tick()


@pytest.mark.parametrize("late_ticks", [0, 1, 3])
@pytest.mark.parametrize("away", [stand_still, sleep])
def test_a_joint_that_sank_while_control_itself_was_away_is_not_pulled_back(
    away: Callable[[Rig, int], None], late_ticks: int
) -> None:
    rig = standing()
    rig.tick(5)
    away(rig, 1000)
    rig.joints.silent = True
    rig.tick(late_ticks)
    rig.joints.silent = False
    assert now(rig).effect is Effect.HOLD
    sunk(rig, Joint.LEFT_KNEE)
    rig.tick()
    assert now(rig).effect is Effect.DAMP
    assert rig.command.stiffness_nm_rad[Joint.LEFT_KNEE] == 0
    assert rig.command.stiffness_nm_rad[Joint.RIGHT_KNEE] > 0, "let down in the ramp"


@pytest.mark.parametrize("away", [stand_still, sleep])
def test_joints_that_have_not_sunk_while_control_was_away_are_held(away: Callable[[Rig, int], None]) -> None:
    rig = standing()
    rig.tick(5)
    away(rig, 1000)
    rig.tick(200)
    assert now(rig).effect is Effect.HOLD
    assert Event.JOINT_SANK not in {one.event for state, _ in rig.history for one in state.events}
    assert rig.command.stiffness_nm_rad.min() > 0


@pytest.mark.parametrize("ticks", [9, 24])
def test_a_swinging_leg_that_control_left_alone_for_ticks_has_not_sunk(ticks: int) -> None:
    """Its drive goes on under the last command: docs/safety.md, "How long commands may be missing", at most 5.6°."""
    rig = moving()
    rig.joints.stuck = True
    start_rad = rig.joints.position_rad
    for _ in range(6):  # the gaps add up, and the leg goes on for longer than it may sink
        stand_still(rig, ticks)
        rig.joints.position_rad = rig.command.position_rad + np.radians(5.6)
        rig.tick(10)
    assert np.abs(rig.joints.position_rad - start_rad).max() > FOLLOWING_WARN_RAD
    assert Event.JOINT_SANK not in {one.event for state, _ in rig.history for one in state.events}
