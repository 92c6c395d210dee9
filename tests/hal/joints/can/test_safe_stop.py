"""The guardian's frames save a wearer whose drives hold their last command for ever."""

from __future__ import annotations

import time

import msgspec
import numpy as np
import pytest

from hal.errors import CanFault
from hal.joints.can.bus import open_bus
from hal.joints.can.drive import drives_of
from hal.joints.can.port import message_of
from hal.joints.can.safe_stop import SafeStop
from hal.joints.codecs.wire import Order, SetPoint
from hal.joints.device import JointDevice, load_exoskeleton
from hal.joints.emulator.faults import Fault
from hal.joints.protocol import Joint
from tests.support.breaking_bus import BreakingBus
from tests.support.can_rig import (
    CanRig,
    MakeRig,
    assert_damping,
    command,
    each_joint,
    listening,
    small_gear,
    until,
    with_motor,
)
from tests.support.errors import refused

DEVICES = {
    "AK80-64 V2, holds for ever": lambda: with_motor("AK80-64/V2"),
    "AK80-64 V3": lambda: with_motor("AK80-64/V3"),
    "Damiao": lambda: with_motor("DM10010/default"),
    "CyberGear": lambda: small_gear("CyberGear/manual"),
}


def pushing(rig: CanRig) -> None:
    """Control drives the legs to a target out of reach, then falls silent."""
    rig.joints.open(rig.now_ns())
    rig.joints.enable(rig.now_ns())
    strong = command(1.5, stiffness=150.0)
    rig.until(lambda now: np.abs(now.torque_nm).min() > 5.0 and (now.position_rad > 0.1).all(), strong)


@pytest.fixture(params=DEVICES)
def rig(request: pytest.FixtureRequest, make_rig: MakeRig) -> CanRig:
    """Drives that go on pushing."""
    rig = make_rig(DEVICES[request.param]())
    pushing(rig)
    return rig


def stiffness(rig: CanRig) -> list[float]:
    now_ns = time.monotonic_ns()
    return [drive.effective(now_ns).stiffness_nm_rad for drive in rig.emulator.drives]


def test_without_the_guardian_the_drives_push_on(rig: CanRig) -> None:
    before = [drive.state.position_rad for drive in rig.emulator.drives]
    until(
        lambda: all(
            abs(drive.state.position_rad - begin) > 0.05
            for drive, begin in zip(rig.emulator.drives, before, strict=True)
        )
    )
    assert min(stiffness(rig)) > 10.0


def test_damping_then_off(rig: CanRig) -> None:
    guardian = SafeStop(rig.emulator.device)
    guardian.open()
    assert guardian.damp()
    until(lambda: max(stiffness(rig)) < 0.2)
    ratios = [joint.transmission**2 for joint in rig.emulator.device.joints]
    dampings = [drive.effective(time.monotonic_ns()).damping_nm_s_rad for drive in rig.emulator.drives]
    assert np.allclose(np.array(dampings) * ratios, 4.0, atol=0.02)
    until(lambda: all(abs(drive.state.velocity_rad_s) < 0.05 for drive in rig.emulator.drives))
    assert guardian.exit()
    until(lambda: not any(drive.motor_mode for drive in rig.emulator.drives))
    until(lambda: guardian.answered() == set(Joint) or guardian.exit() is None)
    guardian.close()
    guardian.close()


def test_what_may_be_stiff_is_damped_but_a_drive_that_a_set_point_would_power_is_ordered_off(
    rig: CanRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    drives = rig.emulator.drives
    powered_by_command = drives[0]._codec.traits.enabled_by_command
    guardian = SafeStop(rig.emulator.device)
    guardian.open()
    assert guardian.damp_left_on()
    until(lambda: max(stiffness(rig)) < 0.2)
    assert [drive.motor_mode for drive in drives] == [not powered_by_command] * 4
    told = [listening(monkeypatch, drive) for drive in drives]
    guardian.exit()
    guardian.damp_left_on()
    until(lambda: all(len(asked) == 2 for asked in told))
    assert not any(drive.motor_mode for drive in drives), "those that are off stay off"
    for drive, (exit_order, asked) in zip(drives, told, strict=True):
        assert exit_order is Order.DISABLE
        if powered_by_command:
            assert asked is Order.DISABLE
        else:
            assert_damping(drive, [asked])
    guardian.close()


def test_an_unresponsive_drive_is_not_counted_as_answered(rig: CanRig) -> None:
    rig.emulator.inject(Fault.SILENT, Joint.LEFT_KNEE)
    rig.until(lambda now: rig.now_ns() - now.measured_ns[Joint.LEFT_KNEE] > 50e6)  # no answer of its own on the way
    guardian = SafeStop(rig.emulator.device)
    guardian.open()
    guardian.damp()
    received: set[Joint] = set()

    def listen() -> bool:
        received.update(guardian.answered())
        return len(received) == 3

    until(listen)
    assert received == set(Joint) - {Joint.LEFT_KNEE}
    guardian.close()


@pytest.mark.parametrize("ids", [(0x21, 0x22, 0x23, 0x24), (0x01, 0x11, 0x21, 0x31)], ids=["above 15", "alike"])
def test_damiao_drives_are_told_apart_although_they_answer_with_four_bits(
    make_rig: MakeRig, ids: tuple[int, ...]
) -> None:
    def change(number: int, joint: JointDevice) -> JointDevice:
        return msgspec.structs.replace(joint, can_id=ids[number], reply_id=0x51 + number)

    rig = make_rig(each_joint(with_motor("DM10010/default"), change))
    rig.emulator.inject(Fault.SILENT, Joint.LEFT_KNEE)
    guardian = SafeStop(rig.emulator.device)
    guardian.open()
    received: set[Joint] = set()

    def others_answer() -> bool:
        guardian.exit()
        received.update(guardian.answered())
        return received >= set(Joint) - {Joint.LEFT_KNEE}

    until(others_answer)
    assert Joint.LEFT_KNEE not in received
    rig.emulator.inject(Fault.HEALED)
    until(lambda: guardian.exit() and Joint.LEFT_KNEE in guardian.answered())
    guardian.close()


@pytest.mark.parametrize("motor", ["AK80-64/V2", "AK80-64/V3", "DM10010/default"])
def test_controls_own_commands_are_no_answers(motor: str) -> None:
    """Four bits of a command's angle can be those by which a Damiao drive names itself."""
    device = with_motor(motor)
    guardian = SafeStop(device)
    guardian.open()
    with open_bus(device.buses[0]) as control:
        for drive in drives_of(device):
            for position_rad in np.arange(-1.5, 1.5, 0.05):
                target = SetPoint(float(position_rad), 0.0, 0.0, 4.0, 0.0)
                control.send(message_of(drive.codec.command(drive.device.can_id, target)))
    assert guardian.answered() == frozenset()
    guardian.close()


def test_unopened_it_reports_that_nothing_left() -> None:
    guardian = SafeStop(with_motor("AK80-64/V2"))
    assert not guardian.damp()
    assert not guardian.exit()


def test_a_missing_bus_is_reported_with_the_command_that_repairs_it() -> None:
    with refused(CanFault.NO_INTERFACE, command="sudo ip link set can0 up type can bitrate 1000000 restart-ms 0"):
        SafeStop(load_exoskeleton()).open()


def test_a_line_that_was_cut_ends_no_guardian(monkeypatch: pytest.MonkeyPatch) -> None:
    """python-can's slcan raises these; the bus counts as failed, so that it is opened anew."""
    for error in (IndexError("string index out of range"), ValueError("non-hexadecimal number")):
        bus = BreakingBus(receiving=error)
        monkeypatch.setattr("hal.joints.can.safe_stop.open_bus", lambda _, bus=bus: bus)
        guardian = SafeStop(load_exoskeleton())
        guardian.open()
        assert guardian.answered() == frozenset()
        assert guardian.failed
        guardian.close()
