"""Powering up, drives that do not wake or lose their power, and the end of a session."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from app.control.events.table import LINGER_NS
from app.control.inputs import DriveOrder
from app.control.running_action import Stage
from app.ipc.messages import GuardianHealth
from app.ipc.states import ACTION_OF, Action, Effect, Event, Outcome, RequestRefusal, Source
from app.motion.follower import Mode
from hal.joints.device import Joint
from hal.joints.protocol import BusFault, DriveFault, DriveState
from kgdfa.gesture import Gesture
from logs import records
from logs.reason import reason, reason_of
from tests.app.control.moments import HOLD_TICKS, A, K, S, moving, now, records_of, resting, standing, sunk
from tests.app.control.rig import TICK_NS, Rig


def test_a_knee_that_leans_on_its_end_stop_is_gripped_within_the_guards_range() -> None:
    rig = resting(S.UNPOWERED)
    low_rad = rig.settings.limits.low_rad
    rig.joints.position_rad = np.array([0.05, low_rad[1] - np.radians(0.05), 0.05, 0.1])
    rig.release(Gesture.ZERO)
    state = rig.run_until(lambda m: m.running is not None and m.running.stage is Stage.STIFFENING)
    assert state.motion.command.position_rad[1] == low_rad[1]
    assert rig.run_until(lambda m: m.running is None).gait.state is S.STANDING


def test_gesture_0_plans_enables_grips_and_only_then_moves() -> None:
    rig = resting(S.UNPOWERED)
    rig.release(Gesture.ZERO)
    stages: list[Stage] = []
    for _ in range(600):
        state = rig.tick()
        if state.running is not None and (not stages or stages[-1] is not state.running.stage):
            stages.append(state.running.stage)
            if state.running.stage in {Stage.PLANNING, Stage.ENABLING}:
                assert rig.command.stiffness_nm_rad.max() == 0
    assert stages == [Stage.PLANNING, Stage.ENABLING, Stage.STIFFENING, Stage.MOVING]
    assert now(rig).gait.state is S.STANDING
    report = now(rig).reports[-1]
    assert report.source is Source.GESTURE
    assert report.from_state is S.UNPOWERED
    assert report.accepted_ns < report.first_command_ns < report.first_motion_ns < report.ended_ns


def test_a_refused_path_to_standing_never_powers_the_drives() -> None:
    rig = resting(S.UNPOWERED)
    rig.refuse_plans = "the feet are not on the ground"
    rig.send(K.ACT, A.INITIALISE)
    rig.tick(10)
    assert rig.joints.state is DriveState.PROBED
    assert now(rig).gait.state is S.UNPOWERED
    assert now(rig).reports[-1].outcome is Outcome.REFUSED


def test_legs_that_begin_to_sink_before_power_comes_get_none() -> None:
    rig = resting(S.UNPOWERED)
    rig.answer_ticks = 10
    rig.send(K.ACT, A.INITIALISE)
    rig.tick(5)
    assert now(rig).running is not None
    rig.joints.velocity_rad_s = np.array([0.0, 0.6, 0.0, 0.0])
    rig.tick(20)
    assert rig.joints.state is DriveState.PROBED
    assert now(rig).gait.state is S.UNPOWERED
    assert (now(rig).reports[-1].outcome, now(rig).refusal) == (Outcome.REFUSED, reason(Event.LEGS_MOVING))
    rig.joints.velocity_rad_s = np.zeros(4)
    rig.tick(LINGER_NS // TICK_NS + 2)
    rig.act(A.INITIALISE)
    assert now(rig).gait.state is S.STANDING


def test_legs_that_moved_while_the_drives_woke_are_planned_for_anew() -> None:
    rig = resting(S.UNPOWERED)
    rig.send(K.ACT, A.INITIALISE)
    rig.run_until(lambda m: m.running is not None and m.running.stage is Stage.ENABLING)
    rig.joints.position_rad = rig.joints.position_rad + 0.3
    held_from = rig.joints.position_rad.copy()
    rig.run_until(lambda m: m.running is not None and m.running.stage is Stage.MOVING)
    plan = now(rig).motion.plan
    assert plan is not None
    assert plan.position_rad[0] == pytest.approx(held_from)
    rig.settle()
    assert now(rig).gait.state is S.STANDING


def test_a_path_that_is_not_free_any_more_leaves_the_gripped_joints_held() -> None:
    rig = resting(S.UNPOWERED)
    rig.send(K.ACT, A.INITIALISE)
    rig.run_until(lambda m: m.running is not None and m.running.stage is Stage.STIFFENING)
    rig.refuse_plans = "not free"
    rig.answer_ticks = 1
    rig.tick(300)
    assert now(rig).gait.state is S.BETWEEN
    assert now(rig).motion.mode is Mode.HOLDING
    assert rig.joints.state is DriveState.ENABLED


def test_drives_that_do_not_wake_end_the_action_with_their_reason() -> None:
    rig = resting(S.UNPOWERED)
    rig.joints.refuse_enable = "left hip does not answer: check its cable"
    rig.send(K.ACT, A.INITIALISE)
    rig.tick(6)
    assert now(rig).running is None
    assert now(rig).reports[-1].reason == reason_of(OSError("left hip does not answer: check its cable"))
    assert now(rig).gait.state is S.UNPOWERED
    assert Event.DRIVE_ORDER_FAILED.value in rig.events()


def test_drives_that_never_report_that_they_woke_are_given_up() -> None:
    rig = resting(S.UNPOWERED)
    rig.send(K.ACT, A.INITIALISE)
    rig.run_until(lambda m: m.running is not None and m.running.stage is Stage.ENABLING)
    rig.joints.state = DriveState.PROBED
    rig.tick(1502)
    assert now(rig).running is None
    assert now(rig).reports[-1].reason == reason(RequestRefusal.ENABLE_TIMEOUT)


def test_a_stop_while_the_drives_wake_leaves_them_neutral() -> None:
    rig = resting(S.UNPOWERED)
    rig.send(K.ACT, A.INITIALISE)
    rig.run_until(lambda m: m.running is not None and m.running.stage is Stage.ENABLING)
    rig.send(K.STOP)
    rig.tick(300)
    assert now(rig).gait.state is S.UNPOWERED
    assert rig.command.stiffness_nm_rad.max() == 0
    rig.send(K.ACKNOWLEDGE)
    rig.tick()
    rig.send(K.TORQUE_OFF)
    rig.tick()
    assert rig.joints.state is DriveState.DISABLED


def test_a_second_stop_damps_drives_that_a_stop_left_neutral() -> None:
    rig = resting(S.UNPOWERED)
    rig.send(K.ACT, A.INITIALISE)
    rig.run_until(lambda m: m.running is not None and m.running.stage is Stage.ENABLING)
    rig.send(K.STOP)
    rig.tick(5)
    assert rig.command.damping_nm_s_rad.max() == 0
    rig.send(K.STOP)
    rig.tick(5)
    assert np.array_equal(rig.command.damping_nm_s_rad, rig.settings.gains.damped_nm_s_rad)
    assert rig.command.stiffness_nm_rad.max() == 0
    rig.send(K.TORQUE_OFF)
    rig.tick(2)
    assert rig.joints.state is DriveState.DISABLED
    assert now(rig).motion.mode is Mode.DISABLED


def test_a_control_that_the_guardian_has_stood_in_for_does_not_pull_the_legs_back() -> None:
    rig = standing()
    rig.tick()
    missed = 750
    rig.now_ns += missed * TICK_NS
    sunk(rig, *Joint)
    rig.guardian_health = {"acted": True}
    health = GuardianHealth(at_ns=rig.now_ns, acted=True)
    rig.spoil = {"late_ns": missed * TICK_NS, "missed_ticks": missed, "guardian": health}
    for _ in range(400):
        rig.tick()
        assert rig.command.stiffness_nm_rad.max() == 0
        assert rig.command.torque_nm.max() == 0
    assert np.array_equal(rig.command.damping_nm_s_rad, rig.settings.gains.damped_nm_s_rad)
    assert not records_of(rig, records.GuardRefusal)
    assert now(rig).motion.fully_damped


def test_the_guardians_word_ends_a_damping_ramp_that_runs() -> None:
    rig = standing()
    rig.send(K.STOP)
    rig.send(K.STOP)
    rig.tick(30)
    assert rig.command.stiffness_nm_rad.min() > 0
    rig.spoil = {"guardian": GuardianHealth(at_ns=rig.now_ns, acted=True)}
    rig.tick()
    assert rig.command.stiffness_nm_rad.max() == 0


def test_a_control_that_was_late_by_itself_goes_on_holding() -> None:
    rig = standing()
    rig.now_ns += 750 * TICK_NS
    rig.spoil = {"late_ns": 750 * TICK_NS, "missed_ticks": 750}
    rig.tick()
    assert now(rig).effect is Effect.HOLD
    assert rig.command.stiffness_nm_rad.min() > 0


def test_legs_that_swing_after_a_stop_while_the_drives_woke_are_not_gripped() -> None:
    rig = resting(S.UNPOWERED)
    rig.send(K.ACT, A.INITIALISE)
    rig.run_until(lambda m: m.running is not None and m.running.stage is Stage.ENABLING)
    rig.send(K.STOP)
    rig.tick()
    rig.joints.velocity_rad_s = np.array([0.0, 1.5, 0.0, 0.0])
    rig.send(K.ACKNOWLEDGE)
    rig.tick()
    rig.send(K.ACT, A.INITIALISE)
    rig.tick(5)
    assert (now(rig).running, now(rig).refusal) == (None, reason(Event.LEGS_MOVING))
    rig.joints.velocity_rad_s = np.zeros(4)
    rig.tick(LINGER_NS // TICK_NS + 2)
    rig.answer_ticks = 10
    rig.send(K.ACT, A.INITIALISE)
    rig.tick(5)
    assert now(rig).running is not None
    rig.joints.velocity_rad_s = np.array([0.0, 1.5, 0.0, 0.0])
    rig.tick(20)
    assert (now(rig).running, now(rig).refusal) == (None, reason(Event.LEGS_MOVING)), "nor after the plan has come"
    assert rig.joints.state is DriveState.ENABLED
    assert rig.command.stiffness_nm_rad.max() == 0


def test_drives_that_are_awake_already_are_gripped_without_being_woken_again() -> None:
    rig = resting(S.UNPOWERED)
    rig.joints.state = DriveState.ENABLED
    rig.send(K.ACT, A.INITIALISE)
    rig.tick(400)
    assert now(rig).gait.state is S.STANDING
    assert all(outputs.drives is DriveOrder.NONE for _, outputs in rig.history)


def test_when_the_drives_lose_power_the_state_is_reported() -> None:
    rig = moving()
    rig.joints.state = DriveState.DISABLED
    rig.tick()
    assert now(rig).gait.state is S.UNPOWERED
    assert now(rig).motion.mode is Mode.DISABLED
    assert now(rig).reports[-1].outcome is Outcome.STOPPED
    rig.tick(50)
    assert rig._refusal is None, "nothing that the guard would refuse is sent to drives that are off"


def test_one_faulted_drive_leaves_the_others_holding() -> None:
    rig = moving()
    rig.joints.state = DriveState.FAULTED
    rig.tick(HOLD_TICKS + 5)
    assert now(rig).streams.powered
    assert rig.command.stiffness_nm_rad.min() > 0


def test_a_drive_fault_leaves_no_way_on_but_through_torque_off() -> None:
    """Its drive has left motor mode: gesture 0 would move the legs with one joint limp.

    Drivers report a fault until torque off, though it has gone by itself.
    """
    rig = standing()
    none = DriveFault.NONE
    rig.joints.faults = (none, DriveFault.UNDER_VOLTAGE, none, none)
    rig.joints.state = DriveState.FAULTED
    rig.tick(10)
    rig.send(K.ACKNOWLEDGE)
    rig.tick(2)
    assert Event.DRIVE_FAULT.value in rig.events()
    for action in (A.INITIALISE, A.STEP_RIGHT_FIRST):
        rig.send(K.ACT, action)
        rig.tick(20)
        assert now(rig).running is None
    for _ in range(2):
        rig.send(K.STOP)
    rig.run_until(lambda m: m.motion.fully_damped)
    rig.send(K.TORQUE_OFF)
    rig.run_until(lambda _: rig.joints.state is DriveState.DISABLED)
    rig.joints.state, rig.joints.faults = DriveState.PROBED, (none,) * 4
    rig.send(K.ACKNOWLEDGE)
    rig.tick(2)
    assert rig.events() == set()
    rig.act(A.INITIALISE)
    assert (now(rig).gait.state, rig.joints.state) == (S.STANDING, DriveState.ENABLED)


def test_a_bus_that_failed_and_came_back_needs_an_acknowledgement_alone() -> None:
    """STOP twice and torque off would let down a wearer whom the drives have held all along."""
    rig = standing()
    rig.joints.bus, rig.joints.state = BusFault.BUS_OFF, DriveState.FAULTED
    rig.tick(5)
    rig.joints.bus = BusFault.NONE
    rig.tick(5)
    assert rig.events() == {Event.BUS_FAULT.value}
    rig.send(K.ACKNOWLEDGE)
    rig.tick(2)
    assert rig.events() == set()
    rig.send(K.ACT, A.STEP_RIGHT_FIRST)
    rig.tick()
    assert now(rig).running is not None


def test_drives_that_never_answered_can_be_asked_again_by_torque_off() -> None:
    """The console offers it while the effect is to damp, which STOP twice makes of drives without power, too."""
    rig = Rig()
    rig.joints.silent, rig.joints.measured_ns = True, 0
    rig.send(K.CONFIRM_PATIENT)
    rig.tick(2)
    assert Event.JOINT_TIMEOUT.value in rig.events()
    for _ in range(2):
        rig.send(K.STOP)
    rig.tick()
    assert now(rig).effect is Effect.DAMP
    rig.send(K.TORQUE_OFF)
    rig.tick()
    assert rig.outputs is not None
    assert rig.outputs.drives is DriveOrder.DISABLE
    rig.joints.silent = False
    rig.send(K.ACKNOWLEDGE)
    rig.tick(2)
    rig.act(A.INITIALISE)
    assert now(rig).gait.state is S.STANDING


def test_a_drive_that_faults_while_it_wakes_stops_the_action_and_can_be_switched_off() -> None:
    rig = resting(S.UNPOWERED)
    rig.send(K.ACT, A.INITIALISE)
    rig.run_until(lambda m: m.running is not None and m.running.stage is Stage.ENABLING)
    rig.joints.state = DriveState.FAULTED
    rig.joints.faults = (DriveFault.UNDER_VOLTAGE, *rig.joints.faults[1:])
    rig.tick(2)
    assert now(rig).running is None
    rig.send(K.TORQUE_OFF)
    rig.tick()
    rig.joints.faults = (DriveFault.NONE,) * 4
    rig.tick()
    assert rig.joints.state is DriveState.DISABLED
    assert Event.DRIVE_FAULT.value in rig.events(), "until acknowledged: the three beside it had power"
    rig.send(K.ACKNOWLEDGE)
    rig.tick()
    assert Event.DRIVE_FAULT.value not in rig.events()


@pytest.mark.parametrize("asked", ["word", "signal"])
def test_the_end_holds_damps_switches_off_and_finishes(asked: str) -> None:
    rig = moving(A.WALK)
    rig.send(K.SHUT_DOWN)
    if asked == "signal":
        rig._commands.clear()
        rig.spoil["must_end"] = True
    modes: list[Mode] = []
    for _ in range(600):
        state = rig.tick()
        modes.append(state.motion.mode)
        assert rig.outputs is not None
        if rig.outputs.finished:
            break
    order = [mode for i, mode in enumerate(modes) if i == 0 or modes[i - 1] is not mode]
    assert order == [Mode.MOVING, Mode.HOLDING, Mode.DAMPED, Mode.DISABLED]
    assert rig.joints.state is DriveState.DISABLED
    assert now(rig).gait.state is S.UNPOWERED


def test_with_the_drives_off_the_end_comes_at_once() -> None:
    rig = resting(S.UNPOWERED)
    rig.send(K.SHUT_DOWN)
    rig.tick()
    assert rig.outputs is not None
    assert rig.outputs.finished


def test_nothing_is_granted_while_the_session_ends() -> None:
    rig = standing()
    rig.send(K.SHUT_DOWN)
    rig.send(K.ACT, A.WALK)
    rig.tick()
    assert now(rig).running is None
    assert now(rig).refusal_count == 1


def test_every_gesture_has_its_action() -> None:
    assert {ACTION_OF[gesture] for gesture in Gesture} == set(Action)


def test_joints_whose_stiffening_the_guard_refuses_are_damped_and_can_be_switched_off() -> None:
    rig = resting(S.UNPOWERED)
    gains = rig.settings.gains
    rig.settings = replace(rig.settings, gains=replace(gains, stiffness_nm_rad=np.full(4, np.nan)))
    rig.send(K.ACT, A.INITIALISE)
    rig.run_until(lambda m: m.motion.fully_damped)
    assert (now(rig).effect, now(rig).gait.state) == (Effect.HOLD, S.BETWEEN)
    assert np.array_equal(rig.command.damping_nm_s_rad, gains.damped_nm_s_rad)
    assert len(records_of(rig, records.GuardRefusal)) == 1
    rig.send(K.TORQUE_OFF)
    rig.tick(2)
    assert (rig.joints.state, now(rig).motion.mode) == (DriveState.DISABLED, Mode.DISABLED)
