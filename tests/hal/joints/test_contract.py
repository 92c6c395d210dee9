"""What every driver behind the Joints Protocol keeps: simulated joints and emulated drives of each protocol alike."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import pytest

from hal.errors import HardwareError
from hal.joints.codecs import CODECS
from hal.joints.device import Exoskeleton, load_exoskeleton
from hal.joints.factory import make_joints
from hal.joints.motors import WireProtocol, load_motors
from hal.joints.protocol import (
    BusFault,
    DriveFault,
    DriveState,
    Joint,
    JointCommand,
    JointFeedback,
    Joints,
)
from tests.support.can_rig import MakeRig, command, small_gear, with_motor

TICK_NS = 2_000_000
LIMIT_TICKS = 2_000


@dataclass
class SimulatedRig:
    """Joints that move by the tick, with the tick's own time."""

    joints: Joints
    at_ns: int = 1_000_000_000

    def now_ns(self) -> int:
        return self.at_ns

    def tick(self, wanted: JointCommand | None) -> JointFeedback:
        self.at_ns += TICK_NS
        feedback = self.joints.read(self.at_ns)
        if wanted is not None:
            self.joints.write(wanted, self.at_ns)
        return feedback

    def until(self, reached: Callable[[JointFeedback], object], wanted: JointCommand | None = None) -> JointFeedback:
        for _ in range(LIMIT_TICKS):
            feedback = self.tick(wanted)
            if reached(feedback):
                return feedback
        raise AssertionError(feedback)


DEVICES: dict[str, Callable[[], Exoskeleton]] = {
    "AK80-64 V2": lambda: with_motor("AK80-64/V2"),
    "AK80-64 V3": lambda: with_motor("AK80-64/V3"),
    "AK10-9 V2": lambda: small_gear("AK10-9/V2"),
    "mini-cheetah": lambda: small_gear("mini-cheetah/bgkatz"),
    "Damiao": lambda: with_motor("DM10010/default"),
    "CyberGear": lambda: small_gear("CyberGear/manual"),
}


def test_drives_of_every_protocol_are_held_to_it() -> None:
    commanded = {protocol for protocol in WireProtocol if not CODECS[protocol].traits.read_only}
    missing = commanded - {load_motors().find(made().left_hip.motor).protocol for made in DEVICES.values()}
    assert not missing, f"nothing here runs over {missing}: add a device to DEVICES in {__file__}"


@pytest.fixture(params=["simulated", *DEVICES])
def rig(request: pytest.FixtureRequest, make_rig: MakeRig) -> Iterator[object]:
    """A driver, not yet open, with what it moves."""
    if request.param == "simulated":
        from hal.joints.body import average_body

        joints = make_joints("simulated", load_exoskeleton(), average_body(1.75, 75.0))
        yield SimulatedRig(joints)
        joints.close(0)
    else:
        yield make_rig(DEVICES[request.param]())


def start(rig: SimulatedRig) -> None:
    """Open and enable."""
    rig.joints.open(rig.now_ns())
    rig.joints.enable(rig.now_ns())


def test_the_life_cycle_is_reported(rig: SimulatedRig) -> None:
    rig.joints.open(rig.now_ns())
    assert rig.tick(None).state is DriveState.PROBED
    rig.joints.enable(rig.now_ns())
    assert rig.tick(None).state is DriveState.ENABLED
    rig.joints.close(rig.now_ns())
    assert rig.joints.read(rig.now_ns()).state is DriveState.DISABLED


def test_closing_is_harmless_whenever(rig: SimulatedRig) -> None:
    rig.joints.close(rig.now_ns())
    start(rig)
    rig.joints.close(rig.now_ns())
    rig.joints.close(rig.now_ns())


def test_it_opens_again_after_closing(rig: SimulatedRig) -> None:
    start(rig)
    rig.joints.close(rig.now_ns())
    start(rig)
    assert rig.tick(None).state is DriveState.ENABLED


def test_enabling_needs_opening(rig: SimulatedRig) -> None:
    with pytest.raises(HardwareError):
        rig.joints.enable(rig.now_ns())


def test_enabling_twice_is_refused(rig: SimulatedRig) -> None:
    start(rig)
    with pytest.raises(HardwareError):
        rig.joints.enable(rig.now_ns())


def test_feedback_is_four_of_everything_and_well(rig: SimulatedRig) -> None:
    start(rig)
    feedback = rig.until(lambda now: (now.measured_ns > 0).all(), command(stiffness=0.0))
    for column in (feedback.position_rad, feedback.velocity_rad_s, feedback.torque_nm, feedback.temperature_c):
        assert column.shape == (4,)
        assert column.dtype == np.float64
    assert feedback.faults == (DriveFault.NONE,) * 4
    assert feedback.bus is BusFault.NONE


def test_feedback_never_comes_from_the_future_nor_grows_older(rig: SimulatedRig) -> None:
    start(rig)
    last = np.zeros(4, dtype=np.int64)
    for _ in range(20):
        feedback = rig.tick(command(stiffness=0.0))
        assert (feedback.measured_ns <= rig.now_ns()).all()
        assert (feedback.measured_ns >= last).all()
        last = feedback.measured_ns
    assert (last > 0).all()


def test_writing_before_enabling_moves_nothing(rig: SimulatedRig) -> None:
    rig.joints.open(rig.now_ns())
    before = rig.tick(None).position_rad
    for _ in range(25):
        feedback = rig.tick(command(0.5))
    assert np.abs(feedback.position_rad - before).max() < 0.05


@pytest.mark.parametrize("joint", list(Joint))
def test_a_set_point_moves_its_own_joint_towards_it(rig: SimulatedRig, joint: Joint) -> None:
    start(rig)
    target = rig.tick(None).position_rad.copy()
    target[joint] += 0.2
    wanted = command(target, stiffness=180.0)
    feedback = rig.until(lambda now: abs(now.position_rad[joint] - target[joint]) < 0.08, wanted)
    others = [other for other in Joint if other is not joint]
    assert np.abs(feedback.position_rad - target)[others].max() < 0.12


def test_speed_has_the_sign_of_the_motion(rig: SimulatedRig) -> None:
    start(rig)
    begin = rig.tick(None).position_rad
    wanted = command(begin + 0.3, stiffness=180.0)
    feedback = rig.until(lambda now: (now.position_rad - begin > 0.05).any(), wanted)
    moved = feedback.position_rad - begin > 0.05
    rig.until(lambda now: (now.velocity_rad_s[moved] > 0).all(), wanted)


def test_torque_off_means_no_torque(rig: SimulatedRig) -> None:
    start(rig)
    strongest = np.zeros(4)

    def have_all_pulled(now: JointFeedback) -> bool:
        np.maximum(strongest, np.abs(now.torque_nm), out=strongest)
        return bool(strongest.min() > 1.0)

    rig.until(have_all_pulled, command(0.3, stiffness=180.0))
    rig.until(lambda now: np.abs(now.torque_nm).max() < 0.5, command(stiffness=0.0, damping=0.0))


def test_a_command_that_is_no_number_raises_nothing_and_moves_nothing(rig: SimulatedRig) -> None:
    start(rig)
    before = rig.tick(command(stiffness=0.0)).position_rad
    for _ in range(10):
        feedback = rig.tick(command(float("nan")))
    assert np.isfinite(feedback.position_rad).all()
    assert np.abs(feedback.position_rad - before).max() < 0.05
