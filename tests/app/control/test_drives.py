"""The door to the joints: what is off is asked where it is, and at the end neither damped nor guarded."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest

from app.control.drives import Drives
from app.control.inputs import DriveOrder
from app.ipc.messages import OperatorKind
from app.ipc.states import Action, Event, GaitState
from app.motion import follower
from app.motion.follower import gains_of
from app.motion.plan import body_of
from hal.errors import DrivesFault
from hal.joints.can import lifecycle
from hal.joints.can.drive import Drive
from hal.joints.can.driver import SocketCanJoints
from hal.joints.device import load_exoskeleton
from hal.joints.emulator.emulator import DriveEmulator
from hal.joints.emulator.faults import Fault
from hal.joints.guard import limits_of
from hal.joints.protocol import DriveFault, DriveState, Joint, JointCommand, JointFeedback
from hal.joints.simulated.driver import SimulatedJoints
from logs.reason import key_of
from profiles.schema import DEMO_PATIENT
from testing.emulated_drives import emulating
from tests.app.control.moments import resting
from tests.support.can_rig import until, with_motor

DEVICE = load_exoskeleton()


class CountingJoints(SimulatedJoints):
    """Counts what is written."""

    writes = 0

    def write(self, command: JointCommand, now_ns: int) -> None:
        self.writes += 1
        super().write(command, now_ns)


def powered() -> tuple[CountingJoints, Drives]:
    joints = CountingJoints(DEVICE, body_of(DEMO_PATIENT))
    drives = Drives(joints, limits_of(DEVICE), gains_of(DEVICE, 1.0, 1.0))
    drives.open(1)
    drives.execute(DriveOrder.ENABLE, 2)
    feedback = drives.read(3)
    drives.write(follower.NEUTRAL, feedback, 3)
    assert drives.powered
    return joints, drives


def test_drives_commanded_off_are_off_at_once() -> None:
    joints, drives = powered()
    assert drives.execute(DriveOrder.DISABLE, 4)
    assert not drives.powered
    before = joints.writes
    assert drives.close() is None
    assert joints.writes == before, "an orderly end has damped already: to do it again takes a third of a second"


def test_only_joints_that_are_not_held_any_more_lose_their_stiffness_at_once() -> None:
    _, drives = powered()
    gains = gains_of(DEVICE, 1.0, 1.0)
    stiff = dataclasses.replace(follower.NEUTRAL, stiffness_nm_rad=gains.stiffness_nm_rad)
    damped = follower.start_damped(gains).command
    for unheld in (frozenset[Joint](), frozenset({Joint.LEFT_HIP}), frozenset(Joint)):
        drives.written = stiff
        drives.write(damped, drives.read(4), 4, unheld)
        assert (drives.refusal is None) is (unheld == frozenset(Joint))
        assert drives.written.stiffness_nm_rad[Joint.LEFT_HIP] == 0 or not unheld


def test_drives_left_powered_are_damped_before_they_are_let_go() -> None:
    joints, drives = powered()
    before = joints.writes
    assert drives.close() is None
    assert joints.writes > before
    assert joints.read(10).state is DriveState.DISABLED
    assert np.allclose(joints.torque_nm, 0.0)


def test_while_they_are_damped_the_guardian_is_informed_and_at_last_that_their_answers_are_awaited() -> None:
    joints, drives = powered()
    informed: list[str] = []
    before = joints.writes
    assert drives.close(beat=lambda: informed.append("beat"), awaiting=lambda: informed.append("awaiting")) is None
    assert informed == ["beat"] * (joints.writes - before) + ["awaiting"]


@dataclass
class DrivesOnCan:
    """The door to emulated drives on a bus, ticked as control's loop does."""

    drives: Drives
    emulator: DriveEmulator

    def tick(self, order: DriveOrder = DriveOrder.NONE) -> JointFeedback:
        """The feedback, read before the order."""
        now_ns = time.monotonic_ns()
        feedback = self.drives.read(now_ns)
        self.drives.write(follower.NEUTRAL, feedback, now_ns)
        self.drives.execute(order, now_ns)
        return feedback

    def state_after(self, order: DriveOrder) -> DriveState:
        """The drives' state two ticks after an order."""
        self.tick(order)
        self.tick()
        return self.tick().state


@pytest.fixture
def on_can() -> Iterator[DrivesOnCan]:
    device = with_motor("AK80-64/V2")
    with emulating(DriveEmulator(device)) as emulator:
        drives = Drives(SocketCanJoints(device), limits_of(device), gains_of(device, 1.0, 1.0))
        yield DrivesOnCan(drives, emulator)
        emulator.inject(Fault.HEALED)
        drives.close()


def error_code(drives: Drives) -> str:
    return "" if drives.error is None else drives.error.code


def test_after_torque_off_the_drives_are_still_asked_where_they_are(on_can: DrivesOnCan) -> None:
    """Old values would go on forbidding gesture 0, or permitting it."""
    on_can.drives.open(time.monotonic_ns())
    on_can.tick(DriveOrder.ENABLE)
    on_can.emulator.inject(Fault.ERROR, Joint.LEFT_KNEE, 2)
    until(lambda: on_can.tick().state is DriveState.FAULTED)
    assert on_can.state_after(DriveOrder.DISABLE) is DriveState.PROBED
    assert on_can.tick().faults[Joint.LEFT_KNEE] is DriveFault.OVER_CURRENT
    on_can.emulator.inject(Fault.HEALED)
    off_ns = time.monotonic_ns()
    until(lambda: (on_can.tick().measured_ns > off_ns).all() and not any(on_can.tick().faults))
    assert not on_can.drives.powered
    assert not any(drive.motor_mode for drive in on_can.emulator.drives)
    on_can.tick(DriveOrder.ENABLE)
    assert on_can.tick().state is DriveState.ENABLED


def test_drives_that_are_switched_off_at_the_end_are_not_opened_again(on_can: DrivesOnCan) -> None:
    on_can.drives.open(time.monotonic_ns())
    on_can.tick(DriveOrder.ENABLE)
    on_can.tick(DriveOrder.DISABLE)
    assert on_can.drives.close() is None
    assert on_can.drives.read(time.monotonic_ns()).state is DriveState.DISABLED


def test_torque_off_tries_again_to_open_drives_that_were_silent(on_can: DrivesOnCan) -> None:
    on_can.emulator.inject(Fault.SILENT, Joint.LEFT_KNEE)
    on_can.drives.open(time.monotonic_ns())
    assert on_can.state_after(DriveOrder.DISABLE) is DriveState.UNCONFIGURED
    on_can.tick(DriveOrder.DISABLE)
    on_can.tick()
    assert error_code(on_can.drives) == key_of(DrivesFault.NO_REPLY)
    on_can.emulator.inject(Fault.HEALED)
    assert on_can.state_after(DriveOrder.DISABLE) is DriveState.PROBED
    assert error_code(on_can.drives) == ""
    assert (on_can.tick().measured_ns > 0).all()


def test_drives_that_fall_silent_with_torque_off_can_be_asked_again(on_can: DrivesOnCan) -> None:
    on_can.drives.open(time.monotonic_ns())
    on_can.tick(DriveOrder.ENABLE)
    on_can.tick()
    on_can.emulator.inject(Fault.SILENT, Joint.LEFT_KNEE)
    assert on_can.state_after(DriveOrder.DISABLE) is DriveState.DISABLED
    assert on_can.emulator.drives[Joint.LEFT_KNEE].motor_mode
    frozen = on_can.tick()
    assert (frozen.measured_ns == 0).tolist() == [joint is Joint.LEFT_KNEE for joint in Joint]
    rig = resting(GaitState.UNPOWERED)
    rig.spoil = {"feedback": frozen}
    rig.send(OperatorKind.ACT, Action.INITIALISE)
    refusal = rig.tick().refusal
    assert refusal is not None
    assert refusal.code == key_of(Event.JOINT_TIMEOUT), "gesture 0 would plan from angles that nobody measures"
    on_can.emulator.inject(Fault.HEALED)
    assert on_can.drives.unconfirmed
    assert on_can.state_after(DriveOrder.DISABLE) is DriveState.PROBED
    assert not any(drive.motor_mode for drive in on_can.emulator.drives)
    assert not on_can.drives.unconfirmed


def test_a_drive_that_falls_silent_while_it_is_powered_counts_as_unconfirmed_until_it_is_off(
    on_can: DrivesOnCan, monkeypatch: pytest.MonkeyPatch
) -> None:
    confirm = lifecycle._unanswered_together

    def silenced(joints: SocketCanJoints) -> list[Drive]:
        on_can.emulator.inject(Fault.SILENT, Joint.LEFT_KNEE)
        return confirm(joints)

    monkeypatch.setattr(lifecycle, "_unanswered_together", silenced)
    on_can.drives.open(time.monotonic_ns())
    on_can.tick(DriveOrder.ENABLE)
    assert error_code(on_can.drives) == key_of(DrivesFault.NO_REPLY)
    assert (on_can.drives.powered, on_can.drives.unconfirmed) == (False, True)
    assert [drive.motor_mode for drive in on_can.emulator.drives] == [joint is Joint.LEFT_KNEE for joint in Joint]
    on_can.emulator.inject(Fault.HEALED)
    on_can.tick(DriveOrder.DISABLE)
    assert not on_can.drives.unconfirmed
    assert not any(drive.motor_mode for drive in on_can.emulator.drives)


def test_a_power_on_that_a_fault_refuses_leaves_no_drive_that_may_be_on(on_can: DrivesOnCan) -> None:
    on_can.drives.open(time.monotonic_ns())
    on_can.emulator.inject(Fault.ERROR, Joint.LEFT_KNEE)
    until(lambda: on_can.tick().faults[Joint.LEFT_KNEE] is not DriveFault.NONE)
    on_can.tick(DriveOrder.ENABLE)
    assert on_can.drives.error is not None
    assert not on_can.drives.unconfirmed


def test_drives_that_fault_before_their_first_feedback_with_power_count_as_powered(on_can: DrivesOnCan) -> None:
    on_can.tick(DriveOrder.ENABLE)
    assert on_can.drives.error is None
    on_can.emulator.inject(Fault.BUS_OFF)
    until(lambda: on_can.tick().state is DriveState.FAULTED)
    assert on_can.drives.powered, "three of them hold the legs, and the guardian has to guard them"
    on_can.emulator.inject(Fault.HEALED)


def test_a_session_ends_with_the_drives_that_did_not_confirm(on_can: DrivesOnCan) -> None:
    on_can.drives.open(time.monotonic_ns())
    on_can.tick(DriveOrder.ENABLE)
    on_can.tick()
    on_can.emulator.inject(Fault.SILENT, Joint.LEFT_KNEE)
    before = on_can.drives.unconfirmed
    on_can.tick(DriveOrder.DISABLE)
    assert (before, on_can.drives.unconfirmed) == (False, True)
    unconfirmed = on_can.drives.close()
    assert unconfirmed is not None
    assert unconfirmed.code == key_of(DrivesFault.NOT_CONFIRMED_OFF)
