"""Silent joints, and every fault that drives and bus can report."""

from __future__ import annotations

import numpy as np
import pytest

from app.ipc.states import Effect
from hal.joints.protocol import BusFault, DriveFault
from tests.app.control.causes import E, fault, names_in
from tests.app.control.moments import moving, standing
from tests.app.control.rig import Rig


def test_a_silent_joint_counts_within_twenty_milliseconds() -> None:
    rig = standing()
    rig.joints.silent = True
    rig.tick(7)
    assert E.JOINT_TIMEOUT.value not in rig.events()
    rig.tick(2)
    assert E.JOINT_TIMEOUT.value in rig.events()


def stall(rig: Rig, ms: int) -> None:
    """Control misses so many milliseconds; no drive is asked meanwhile."""
    rig.now_ns += ms * 1_000_000
    rig.spoil.update(late_ns=ms * 1_000_000, missed_ticks=ms // 2)


def test_drives_that_nobody_asked_are_not_called_silent() -> None:
    rig = standing()
    rig.joints.silent = True
    stall(rig, 14)
    rig.tick(2)  # the answer to the first command after it may take longer than until the next tick
    rig.joints.silent = False
    rig.tick(20)
    assert E.JOINT_TIMEOUT.value not in {event for state, _ in rig.history for event in names_in(state)}
    rig.joints.silent = True
    rig.tick(9)
    assert E.JOINT_TIMEOUT.value in rig.events(), "what was excused once is not excused again"


@pytest.mark.parametrize("stalls", [1, 2, 3])
def test_missed_ticks_only_put_off_the_silence_of_a_drive(stalls: int) -> None:
    rig = standing()
    rig.joints.silent = True
    for _ in range(stalls):
        stall(rig, 14)
        rig.tick(1)
    rig.tick(9 - stalls)
    assert E.JOINT_TIMEOUT.value in rig.events()


def test_joints_may_settle_for_half_a_second_after_a_movement() -> None:
    rig = moving()
    rig.run_until(lambda m: m.running is None)
    rig.joints.velocity_rad_s = np.full(4, 0.7)
    rig.tick(249)
    assert E.UNEXPECTED_MOTION.value not in rig.events()
    rig.tick(3)
    assert E.UNEXPECTED_MOTION.value in rig.events()


@pytest.mark.parametrize("what", [fault for fault in DriveFault if fault])
def test_every_drive_fault_stops_the_legs(what: DriveFault) -> None:
    rig = standing()
    rig.joints.faults = fault(what)
    rig.tick()
    assert rig.state is not None
    assert rig.state.effect >= Effect.HOLD


@pytest.mark.parametrize("what", [fault for fault in BusFault if fault])
def test_every_bus_fault_is_an_event(what: BusFault) -> None:
    rig = standing()
    rig.joints.bus = what
    rig.tick()
    assert rig.events() & {E.BUS_FAULT.value, E.BUS_ERRORS.value}
