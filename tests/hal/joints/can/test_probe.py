"""Opening: frames may be lost, no drive is powered, and what a drive reports of itself is asked until it answers."""

from __future__ import annotations

from collections.abc import Callable

import msgspec
import pytest

from hal.errors import DrivesFault
from hal.joints.codecs import damiao
from hal.joints.codecs.wire import Frame, Order, SetPoint, WireQuantity
from hal.joints.device import Exoskeleton
from hal.joints.emulator.faults import Fault
from hal.joints.emulator.firmware import EmulatedDrive
from hal.joints.factory import make_joints
from hal.joints.protocol import BusFault, DriveState, Joint
from tests.support.can_rig import (
    CanRig,
    MakeRig,
    answer_with_power_alone,
    assert_damping,
    command,
    each_joint,
    listening,
    small_gear,
    with_motor,
)
from tests.support.errors import refused

KNEE = Joint.LEFT_KNEE


def lose(
    monkeypatch: pytest.MonkeyPatch, drive: EmulatedDrive, count: int, wanted: Callable[[Frame], bool]
) -> list[bool]:
    """The bus loses the first frames of a kind before the drive receives them; whether it was on after each frame."""
    receive, lost, powered = drive.receive, list[Frame](), list[bool]()

    def receive_others(frame: Frame, now_ns: int) -> list[Frame]:
        if wanted(frame) and len(lost) < count:
            lost.append(frame)
            return []
        replies = receive(frame, now_ns)
        powered.append(drive.motor_mode)
        return replies

    monkeypatch.setattr(drive, "receive", receive_others)
    return powered


def with_v3_that_loses(make_rig: MakeRig, monkeypatch: pytest.MonkeyPatch, orders: int) -> tuple[CanRig, list[bool]]:
    """A knee that does not hear so many orders to disable; whether it had power after each other frame."""
    rig = make_rig(with_motor("AK80-64/V3"))
    knee = rig.emulator.drives[KNEE]
    off = knee._codec.order(knee.device.can_id, Order.DISABLE)
    return rig, lose(monkeypatch, knee, orders, lambda frame: frame in off)


def test_a_v3_drive_whose_orders_were_lost_is_powered_by_no_question(
    make_rig: MakeRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig, powered = with_v3_that_loses(make_rig, monkeypatch, 2)
    rig.joints.open(rig.now_ns())
    at_probe = rig.joints.read(rig.now_ns()).measured_ns.copy()
    feedback = rig.until(lambda now: (now.measured_ns > at_probe).all(), command())
    assert (feedback.state, feedback.unasked) == (DriveState.PROBED, frozenset())
    rig.joints.close(rig.now_ns())
    assert not any(powered)
    assert not any(drive.motor_mode for drive in rig.emulator.drives)


def test_a_v3_drive_that_answers_no_order_is_refused_without_power(
    make_rig: MakeRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig, powered = with_v3_that_loses(make_rig, monkeypatch, 100)
    with refused(DrivesFault.NO_REPLY, joints=(KNEE,)):
        rig.joints.open(rig.now_ns())
    assert not any(powered)


@pytest.mark.parametrize("register", [damiao.Register.POSITION_MAX, damiao.Register.TORQUE_MAX])
def test_a_lost_question_hides_no_wrong_range(
    make_rig: MakeRig, monkeypatch: pytest.MonkeyPatch, register: damiao.Register
) -> None:
    rig = make_rig(with_motor("DM8009/default", max_torque_nm=50.0))
    knee = rig.emulator.drives[KNEE]
    knee._registers[damiao.Register.TORQUE_MAX] = 20.0
    question = damiao.read_register(knee.device.can_id, register)
    lose(monkeypatch, knee, 1, lambda frame: frame == question)
    with refused(DrivesFault.RANGE_MISMATCH, joint=KNEE, quantity=WireQuantity.TORQUE, value=20.0):
        rig.joints.open(rig.now_ns())


def test_a_drive_that_reports_no_register_is_refused(make_rig: MakeRig, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = make_rig(with_motor("DM8009/default", max_torque_nm=50.0))
    lose(monkeypatch, rig.emulator.drives[KNEE], 100, lambda frame: frame.arbitration_id == damiao.REGISTER_ID)
    with refused(DrivesFault.RANGES_UNREPORTED, joint=KNEE):
        rig.joints.open(rig.now_ns())


def with_reply_ids_exchanged(device: Exoskeleton) -> Exoskeleton:
    """The left hip's drive answers on the left knee's identifier, and the other way round."""
    hip, knee = device.left_hip, device.left_knee
    return msgspec.structs.replace(
        device,
        left_hip=msgspec.structs.replace(hip, reply_id=knee.reply_id),
        left_knee=msgspec.structs.replace(knee, reply_id=hip.reply_id),
    )


def test_damiao_drives_whose_reply_ids_are_exchanged_are_refused(make_rig: MakeRig) -> None:
    device = with_motor("DM10010/default")
    rig = make_rig(device, with_reply_ids_exchanged(device))
    with refused(DrivesFault.NO_REPLY_BUS_FAULT, joints=(Joint.LEFT_HIP, KNEE)):
        rig.joints.open(rig.now_ns())


def test_exchanged_reply_ids_of_drives_that_share_four_bits_show_in_their_registers(make_rig: MakeRig) -> None:
    ids = (0x01, 0x11, 0x21, 0x31)
    device = each_joint(
        with_motor("DM10010/default"),
        lambda number, joint: msgspec.structs.replace(joint, can_id=ids[number], reply_id=0x51 + number),
    )
    rig = make_rig(device, with_reply_ids_exchanged(device))
    with refused(DrivesFault.RANGES_UNREPORTED, joint=Joint.LEFT_HIP):
        rig.joints.open(rig.now_ns())


def with_other_knee(make_rig: MakeRig, described: str, real: str) -> CanRig:
    """Drives as described, but for the knee's firmware."""
    device = with_motor(described, max_torque_nm=15.0)
    knee = msgspec.structs.replace(device.left_knee, motor=real)
    return make_rig(device, msgspec.structs.replace(device, left_knee=knee))


@pytest.mark.parametrize(
    ("described", "real", "size", "expected"),
    [("AK80-9/V2", "AK80-9/V1.1", 6, 8), ("AK80-9/V1.1", "AK80-9/V2", 8, 6)],
)
def test_a_drive_whose_replies_have_another_length_than_its_entry_says_is_refused(
    make_rig: MakeRig, described: str, real: str, size: int, expected: int
) -> None:
    """Neither its temperature nor its errors would ever be seen."""
    rig = with_other_knee(make_rig, described, real)
    with refused(DrivesFault.REPLY_SIZE_MISMATCH, joint=KNEE, size=size, expected=expected):
        rig.joints.open(rig.now_ns())
    assert not any(drive.motor_mode for drive in rig.emulator.drives)


def test_a_reply_that_only_lacks_the_voltage_is_accepted(make_rig: MakeRig) -> None:
    """bgkatz's firmware sends six bytes or seven, by its version; the seventh is not used."""
    rig = with_other_knee(make_rig, "mini-cheetah/bgkatz", "AK80-9/V1.1")
    rig.joints.open(rig.now_ns())
    assert rig.joints.read(rig.now_ns()).state is DriveState.PROBED


def test_a_short_reply_to_an_order_alone_is_accepted(make_rig: MakeRig, monkeypatch: pytest.MonkeyPatch) -> None:
    """In a session set-points are answered: the length of those replies counts."""
    rig = make_rig(with_motor("AK80-64/V2"))
    knee = rig.emulator.drives[KNEE]
    receive = knee.receive

    def answer_orders_briefly(frame: Frame, now_ns: int) -> list[Frame]:
        replies = receive(frame, now_ns)
        return [reply._replace(data=reply.data[:6]) for reply in replies] if frame.data[:7] == b"\xff" * 7 else replies

    monkeypatch.setattr(knee, "receive", answer_orders_briefly)
    rig.joints.open(rig.now_ns())
    assert rig.joints.read(rig.now_ns()).state is DriveState.PROBED


def test_replies_that_can_not_be_read_at_all_are_none(make_rig: MakeRig) -> None:
    rig = make_rig(with_motor("AK80-64/V2"))
    rig.emulator.inject(Fault.GARBAGE, KNEE)
    with refused(DrivesFault.NO_REPLY_BUS_FAULT, joints=(KNEE,)):
        rig.joints.open(rig.now_ns())


def of_a_session(rig: CanRig) -> CanRig:
    """The same drives with the driver that a session opens."""
    return CanRig(make_joints("can", rig.emulator.device), rig.emulator)


@pytest.mark.parametrize(
    "device",
    [
        lambda: with_motor("AK80-64/V2"),
        lambda: with_motor("DM10010/default"),
        lambda: small_gear("CyberGear/manual"),
    ],
)
def test_drives_that_a_dead_session_left_stiff_are_damped_before_their_torque_goes_off(
    make_rig: MakeRig, monkeypatch: pytest.MonkeyPatch, device: Callable[[], Exoskeleton]
) -> None:
    rig = of_a_session(make_rig(device()))
    for drive in rig.emulator.drives:
        drive.motor_mode, drive._target = True, SetPoint(0.1, 0.0, 200.0, 2.0, 0.0)
    told = [listening(monkeypatch, drive) for drive in rig.emulator.drives]
    rig.joints.open(rig.now_ns())
    for drive, asked in zip(rig.emulator.drives, told, strict=True):
        damped = asked[: asked.index(Order.DISABLE)]
        assert len(damped) == 15, "each 20 ms for 0.3 s"
        assert_damping(drive, damped)
        assert not drive.motor_mode
    rig.joints.close(rig.now_ns())
    for asked in told:
        asked.clear()
    rig.joints.open(rig.now_ns())
    assert {asked[0] for asked in told} == {Order.DISABLE}, "they have been off since"
    rig.joints.close(rig.now_ns())


@pytest.mark.parametrize("answers_set_points", [True, False])
@pytest.mark.parametrize("motor", ["AK80-64/V2", "AK80-64/V3", "DM10010/default"])
def test_drives_that_are_off_are_not_powered_by_it_and_what_they_answer_or_not_is_no_fault(
    make_rig: MakeRig, monkeypatch: pytest.MonkeyPatch, motor: str, *, answers_set_points: bool
) -> None:
    rig = of_a_session(make_rig(with_motor(motor)))
    powered = [lose(monkeypatch, drive, 0, lambda _: False) for drive in rig.emulator.drives]
    knee = rig.emulator.drives[KNEE]
    receive = knee.receive

    def answer_orders_alone(frame: Frame, now_ns: int) -> list[Frame]:
        replies = receive(frame, now_ns)
        asked = knee._codec.read_command(knee.device.can_id, frame)
        return replies if answers_set_points or not isinstance(asked, SetPoint) else []

    monkeypatch.setattr(knee, "receive", answer_orders_alone)
    rig.joints.open(rig.now_ns())
    at_probe = rig.joints.read(rig.now_ns()).measured_ns.copy()
    for _ in range(20):
        feedback = rig.tick(command())
        assert (feedback.state, feedback.bus, feedback.unasked) == (DriveState.PROBED, BusFault.NONE, frozenset())
    rig.until(lambda now: (now.measured_ns > at_probe).all(), command())
    rig.joints.close(rig.now_ns())
    assert not any(on for drive in powered for on in drive)


def test_a_held_up_reply_to_the_damping_is_no_answer_without_power(
    make_rig: MakeRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It comes while the drive is asked by the order to disable, which it answers in motor mode alone."""
    rig = of_a_session(make_rig(with_motor("AK80-64/V2")))
    knee = rig.emulator.drives[KNEE]
    knee.motor_mode = True
    rig.emulator.inject(Fault.LATE, KNEE, 60)
    answer_with_power_alone(monkeypatch, knee)
    rig.joints.open(rig.now_ns())
    assert rig.joints.read(rig.now_ns()).unasked == {KNEE}
    rig.joints.close(rig.now_ns())
