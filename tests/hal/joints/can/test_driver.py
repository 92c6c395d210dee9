"""The driver's honesty: faults of drives and bus as flags, never exceptions; a life cycle that never heals itself."""

from __future__ import annotations

from collections.abc import Callable

import can
import msgspec
import numpy as np
import pytest

from hal.errors import CanFault, DrivesFault
from hal.joints.can.drive import Drive
from hal.joints.can.driver import SocketCanJoints
from hal.joints.can.port import CAN_ERR_LOSTARB
from hal.joints.codecs.wire import Frame, Order, SetPoint, WireQuantity
from hal.joints.device import Exoskeleton, load_exoskeleton
from hal.joints.emulator.faults import Fault
from hal.joints.emulator.firmware import EmulatedDrive
from hal.joints.protocol import BusFault, DriveFault, DriveState, Joint, JointFeedback
from tests.support.can_rig import (
    LOOKS,
    CanRig,
    MakeRig,
    answer_with_power_alone,
    assert_damping,
    command,
    each_joint,
    listening,
    on_test_bus,
    small_gear,
    until,
    with_motor,
)
from tests.support.errors import refused

HOLD = command(0.1, stiffness=150.0)
KNEE = Joint.LEFT_KNEE
ENTER = b"\xff" * 7 + b"\xfc"  # motor mode


@pytest.fixture
def rig(make_rig: MakeRig) -> CanRig:
    """AK80-64 drives, enabled and holding."""
    rig = make_rig(with_motor("AK80-64/V2"))
    start(rig)
    return rig


def start(rig: CanRig) -> None:
    rig.joints.open(rig.now_ns())
    rig.joints.enable(rig.now_ns())
    rig.until(lambda now: (now.measured_ns > 0).all(), HOLD)


def another_sender(device: Exoskeleton) -> can.BusABC:
    bus = device.buses[0]
    return can.Bus(interface=bus.interface, channel=bus.channel)


def drive_of(rig: CanRig) -> Drive:
    """The host's side of the knee."""
    assert isinstance(rig.joints, SocketCanJoints)
    return rig.joints.drives[KNEE]


def fault_in_one_answer(
    monkeypatch: pytest.MonkeyPatch, drive: EmulatedDrive, to: Callable[[Frame], bool] = lambda _: True
) -> list[Frame]:
    """The drive reports OVER_CURRENT in its next answer to such a frame, and no fault after it; what it receives."""
    receive, received, failed = drive.receive, list[Frame](), list[Frame]()

    def fail_once(frame: Frame, now_ns: int) -> list[Frame]:
        if failed or not to(frame):
            replies = receive(frame, now_ns)
        else:
            failed.append(frame)
            drive.fail(2)
            replies = receive(frame, now_ns)
            drive.heal()
        received.append(frame)
        return replies

    monkeypatch.setattr(drive, "receive", fail_once)
    return received


def has_bus(flag: BusFault) -> object:
    return lambda now: flag in now.bus


@pytest.mark.parametrize("motor", ["AK80-64/V2", "AK80-64/V3", "DM10010/default"])
def test_drives_without_power_are_still_asked_where_they_are(make_rig: MakeRig, motor: str) -> None:
    """Power comes only when the legs are still: a leg that swung at the probe must be seen coming to rest."""
    rig = make_rig(with_motor(motor))
    rig.joints.open(rig.now_ns())
    at_probe = rig.joints.read(rig.now_ns()).measured_ns.copy()
    rig.until(lambda now: (now.measured_ns > at_probe).all(), HOLD)
    assert rig.joints.read(rig.now_ns()).state is DriveState.PROBED


def test_an_error_code_becomes_its_fault_and_the_joint_is_named(rig: CanRig) -> None:
    rig.emulator.inject(Fault.ERROR, KNEE, 2)
    feedback = rig.until(lambda now: now.faults[KNEE], HOLD)
    assert feedback.faults[KNEE] is DriveFault.OVER_CURRENT
    assert feedback.faults[Joint.LEFT_HIP] is DriveFault.NONE
    assert feedback.state is DriveState.FAULTED
    assert feedback.detail is not None
    assert feedback.detail.code is DrivesFault.FAULT_REPORTED
    assert feedback.detail.values["joint"] is KNEE
    assert feedback.detail.values["faults"] == (DriveFault.OVER_CURRENT,)


def test_an_unresponsive_joint_grows_old_while_the_others_stay_fresh(rig: CanRig) -> None:
    rig.emulator.inject(Fault.SILENT, KNEE)
    others = [joint for joint in Joint if joint is not KNEE]
    rig.until(lambda now: (now.measured_ns[others] - now.measured_ns[KNEE] > 50e6).all(), HOLD)


def test_a_drive_that_answers_late_holds_up_no_other_late_one(rig: CanRig) -> None:
    rig.emulator.inject(Fault.LATE, KNEE, 3_600_000)
    rig.emulator.inject(Fault.LATE, Joint.RIGHT_KNEE, 10)
    begin_ns = rig.now_ns()
    rig.until(lambda now: now.measured_ns[Joint.RIGHT_KNEE] > begin_ns + 10_000_000, HOLD)


@pytest.mark.parametrize(
    ("fault", "flag"),
    [
        (Fault.WRONG_ID, BusFault.UNKNOWN_ID),
        (Fault.DUPLICATE, BusFault.DUPLICATE_ID),
        (Fault.GARBAGE, BusFault.MALFORMED),
    ],
)
def test_replies_that_are_wrong_become_flags_of_the_bus(rig: CanRig, fault: Fault, flag: BusFault) -> None:
    rig.emulator.inject(fault, KNEE)
    assert rig.until(lambda now: flag in now.bus, HOLD).detail


def test_bus_off_is_reported_and_ends_in_the_faulted_state(rig: CanRig) -> None:
    rig.emulator.inject(Fault.BUS_OFF)
    feedback = rig.until(lambda now: BusFault.BUS_OFF in now.bus, HOLD)
    assert feedback.state is DriveState.FAULTED
    assert feedback.detail is not None
    assert feedback.detail.code is CanFault.CONTROLLER_OFF


def test_after_a_bus_that_failed_and_came_back_the_drives_follow_and_report_no_fault(rig: CanRig) -> None:
    rig.emulator.inject(Fault.BUS_OFF)
    rig.until(lambda now: BusFault.BUS_OFF in now.bus, HOLD)
    rig.emulator.inject(Fault.HEALED)
    moved = command(0.3, stiffness=400.0)
    feedback = rig.until(lambda now: np.abs(now.position_rad - 0.3).max() < 0.05 and not now.bus, moved)
    assert (feedback.state, feedback.faults) == (DriveState.FAULTED, (DriveFault.NONE,) * 4)


def test_an_error_frame_is_reported_and_leaves_the_drives_enabled(rig: CanRig) -> None:
    rig.emulator.inject(Fault.ERROR_FRAMES)
    feedback = rig.until(lambda now: BusFault.ERROR_FRAME in now.bus, HOLD)
    assert feedback.state is DriveState.ENABLED
    assert feedback.detail is not None
    assert feedback.detail.code is CanFault.NOT_ACKNOWLEDGED


def test_lost_arbitration_is_reported(make_rig: MakeRig) -> None:
    device = with_motor("AK80-64/V2")
    rig = make_rig(device)
    start(rig)
    with another_sender(device) as bus:
        bus.send(can.Message(is_error_frame=True, is_extended_id=False, arbitration_id=CAN_ERR_LOSTARB, data=bytes(8)))
        rig.until(lambda now: BusFault.ARBITRATION_LOST in now.bus, HOLD)


@pytest.mark.parametrize(
    ("message", "flag"),
    [
        (can.Message(arbitration_id=0x123, is_extended_id=False, data=b"\x99"), BusFault.UNKNOWN_ID),
        (can.Message(arbitration_id=0x18FFAA01, data=bytes(8)), BusFault.UNKNOWN_ID),
        (can.Message(arbitration_id=0, is_extended_id=False, data=b""), BusFault.UNKNOWN_ID),
        (can.Message(arbitration_id=0, is_extended_id=False, data=b"\x02\x7f"), BusFault.MALFORMED),
        (can.Message(arbitration_id=0, is_extended_id=False, is_remote_frame=True, dlc=8), BusFault.MALFORMED),
        (
            can.Message(arbitration_id=2, is_extended_id=False, data=bytes.fromhex("8FFF7FF0000007FF")),
            BusFault.DUPLICATE_ID,
        ),
    ],
    ids=["unknown", "unknown extended", "empty", "short", "remote", "second commander"],
)
def test_frames_of_others_become_flags(make_rig: MakeRig, message: can.Message, flag: BusFault) -> None:
    device = with_motor("AK80-64/V2")
    rig = make_rig(device)
    start(rig)
    with another_sender(device) as bus:
        bus.send(message)
        rig.until(lambda now: flag in now.bus, HOLD)


def test_a_strangers_frame_that_names_a_damiao_drive_is_not_its_answer(make_rig: MakeRig) -> None:
    """It reads as the knee's answer without power; that drive answers on an identifier of its own."""
    device = with_motor("DM10010/default")
    rig = make_rig(device)
    start(rig)
    with another_sender(device) as bus:
        bus.send(can.Message(arbitration_id=0x181, is_extended_id=False, data=bytes.fromhex("0200640000000000")))
        feedback = rig.until(lambda now: BusFault.UNKNOWN_ID in now.bus, HOLD)
    assert (feedback.state, set(feedback.faults)) == (DriveState.ENABLED, {DriveFault.NONE})


def test_a_fault_never_heals_into_enabled(rig: CanRig) -> None:
    rig.emulator.inject(Fault.ERROR, KNEE, 1)
    rig.until(lambda now: now.state is DriveState.FAULTED, HOLD)
    rig.emulator.inject(Fault.HEALED, KNEE)
    feedback = rig.until(lambda _: not drive_of(rig).faults, HOLD)
    assert (feedback.state, feedback.faults[KNEE]) == (DriveState.FAULTED, DriveFault.OVER_TEMPERATURE)
    assert not rig.emulator.drives[KNEE].motor_mode
    with refused(DrivesFault.NOT_READY_TO_ENABLE, state=DriveState.FAULTED):
        rig.joints.enable(rig.now_ns())
    rig.joints.close(rig.now_ns())
    start(rig)
    assert rig.tick(HOLD).state is DriveState.ENABLED


def test_a_fault_in_one_of_two_answers_to_a_read_is_reported(rig: CanRig, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its drive has left motor mode: the joint would be without torque while the drives count as enabled."""
    received = fault_in_one_answer(monkeypatch, rig.emulator.drives[KNEE])
    for _ in range(3):
        rig.joints.write(HOLD, rig.now_ns())
    until(lambda: len(received) >= 3)  # so two answers are on the bus
    feedback = rig.joints.read(rig.now_ns())
    assert not drive_of(rig).faults
    assert (feedback.state, feedback.faults[KNEE]) == (DriveState.FAULTED, DriveFault.OVER_CURRENT)
    assert feedback.detail is not None
    assert feedback.detail.code is DrivesFault.FAULT_REPORTED


def test_a_fault_in_the_answer_to_enabling_alone_leaves_none_enabled(
    make_rig: MakeRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = make_rig(with_motor("AK80-64/V2"))
    rig.joints.open(rig.now_ns())
    fault_in_one_answer(monkeypatch, rig.emulator.drives[KNEE], lambda frame: frame.data == ENTER)
    with refused(DrivesFault.FAULT_BEFORE_ENABLING, joint=KNEE, faults=(DriveFault.OVER_CURRENT,)):
        rig.joints.enable(rig.now_ns())
    assert not any(drive.motor_mode for drive in rig.emulator.drives)
    rig.joints.enable(rig.now_ns())
    assert rig.tick(HOLD).state is DriveState.ENABLED


def test_a_drive_that_falls_silent_while_it_is_enabled_is_reported_by_closing(
    make_rig: MakeRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = make_rig(with_motor("AK80-64/V2"))
    rig.joints.open(rig.now_ns())
    knee = rig.emulator.drives[KNEE]
    receive = knee.receive

    def answer_enabling_last(frame: Frame, now_ns: int) -> list[Frame]:
        replies = receive(frame, now_ns)
        knee.silent = knee.silent or frame.data == ENTER
        return replies

    monkeypatch.setattr(knee, "receive", answer_enabling_last)
    with refused(DrivesFault.NO_REPLY, joints=(KNEE,)):
        rig.joints.enable(rig.now_ns())
    assert knee.motor_mode
    with refused(DrivesFault.NOT_CONFIRMED_OFF, joints=(KNEE,)):
        rig.joints.close(rig.now_ns())


@pytest.mark.parametrize("motor", ["DM10010/default"])
def test_a_drive_that_disables_itself_is_a_fault(make_rig: MakeRig, motor: str) -> None:
    rig = make_rig(with_motor(motor))
    start(rig)
    rig.emulator.inject(Fault.DISABLED, KNEE)
    feedback = rig.until(lambda now: now.faults[KNEE], HOLD)
    assert feedback.faults[KNEE] is DriveFault.UNEXPECTEDLY_DISABLED
    assert feedback.state is DriveState.FAULTED


def test_a_fault_that_leaves_a_drive_disabled_is_what_is_reported_of_it(make_rig: MakeRig) -> None:
    rig = make_rig(with_motor("DM10010/default"))
    start(rig)
    rig.emulator.inject(Fault.ERROR, KNEE, 9)
    rig.until(lambda now: now.faults[KNEE], HOLD)
    rig.emulator.inject(Fault.HEALED, KNEE)
    feedback = rig.until(lambda _: drive_of(rig).enabled is False, HOLD)
    assert (feedback.state, feedback.faults[KNEE]) == (DriveState.FAULTED, DriveFault.UNDER_VOLTAGE)


@pytest.mark.parametrize(
    ("motor", "commands", "fault"),
    [
        ("AK80-64/V2", 126, DriveFault.UNEXPECTEDLY_DISABLED),
        ("AK80-64/V2", 80, DriveFault.NONE),
        ("AK80-64/V3", 126, DriveFault.NONE),
    ],
    ids=["restarted", "short", "powered by the next set-point"],
)
def test_a_drive_that_answers_again_after_being_silent_alone_may_be_without_power(
    make_rig: MakeRig, motor: str, commands: int, fault: DriveFault
) -> None:
    """Its replies are the same with power and without."""
    rig = make_rig(with_motor(motor))
    start(rig)
    rig.emulator.inject(Fault.SILENT, KNEE)
    rig.until(lambda _: drive_of(rig).silent_commands >= commands, HOLD)
    replies = drive_of(rig).replies
    rig.emulator.inject(Fault.HEALED)
    feedback = rig.until(lambda _: drive_of(rig).replies > replies + 20, HOLD)
    assert feedback.faults[KNEE] is fault
    assert feedback.state is (DriveState.FAULTED if fault else DriveState.ENABLED)
    rig.joints.close(rig.now_ns())
    start(rig)
    assert set(rig.tick(HOLD).faults) == {DriveFault.NONE}


def test_a_bus_that_was_silent_as_a_whole_tells_of_no_drive(rig: CanRig) -> None:
    rig.emulator.inject(Fault.SILENT)
    for _ in range(200):
        rig.tick(HOLD)
    replies = drive_of(rig).replies
    rig.emulator.inject(Fault.HEALED)
    feedback = rig.until(lambda _: drive_of(rig).replies > replies + 20, HOLD)
    assert set(feedback.faults) == {DriveFault.NONE}


def test_commands_that_the_bus_refused_are_none_that_a_drive_left_unanswered(
    rig: CanRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A transmit queue that stays full takes the other drives' frames and not this one's."""
    assert isinstance(rig.joints, SocketCanJoints)
    knee = drive_of(rig)
    port = rig.joints._ports[knee.device.can_bus]
    send = port.send

    def refuse_the_knees(*frames: Frame) -> bool:
        send(*(frame for frame in frames if frame.arbitration_id != knee.device.can_id))
        return False

    with monkeypatch.context() as full:
        full.setattr(port, "send", refuse_the_knees)
        for _ in range(300):
            rig.tick(HOLD)
    replies = knee.replies
    feedback = rig.until(lambda _: knee.replies > replies + 20, HOLD)
    assert set(feedback.faults) == {DriveFault.NONE}


def test_a_faulted_v3_drive_gets_damping_only(make_rig: MakeRig) -> None:
    """Its firmware knows no enabling: the next stiff command would start it again."""
    rig = make_rig(with_motor("AK80-64/V3"))
    start(rig)
    rig.emulator.inject(Fault.ERROR, KNEE, 1)
    rig.until(lambda now: now.faults[KNEE], HOLD)
    rig.emulator.inject(Fault.HEALED, KNEE)
    rig.until(lambda _: not drive_of(rig).faults, HOLD)
    rig.tick(HOLD)
    held = rig.emulator.drives[KNEE].effective(rig.now_ns())
    assert held.stiffness_nm_rad == pytest.approx(0.0, abs=0.2)
    assert held.damping_nm_s_rad > 0


def test_a_v3_drive_that_had_a_fault_before_it_was_enabled_is_stiff_afterwards(make_rig: MakeRig) -> None:
    """Under-voltage before the supply comes on."""
    rig = make_rig(with_motor("AK80-64/V3"))
    rig.emulator.inject(Fault.ERROR, KNEE, 1)
    rig.joints.open(rig.now_ns())
    rig.until(lambda now: now.faults[KNEE], HOLD)
    rig.emulator.inject(Fault.HEALED, KNEE)
    rig.until(lambda now: not now.faults[KNEE], HOLD)
    rig.joints.enable(rig.now_ns())
    rig.until(lambda _: rig.emulator.drives[KNEE].effective(rig.now_ns()).stiffness_nm_rad > 100.0, HOLD)


def test_ranges_that_differ_from_the_firmwares_are_found_in_motion(make_rig: MakeRig) -> None:
    rig = make_rig(with_motor("AK80-64/V2"))
    rig.emulator.inject(Fault.WRONG_RANGE, KNEE)
    start(rig)
    angles = iter(np.tile(np.sin(np.linspace(0, 6 * np.pi, 1500)) * 0.5, 100))
    swinging = (rig.tick(command(next(angles), stiffness=300.0)) for _ in range(4 * LOOKS))
    assert any(feedback.faults[KNEE] is DriveFault.WRONG_RANGE for feedback in swinging)
    assert rig.joints.read(rig.now_ns()).faults[Joint.LEFT_HIP] is DriveFault.NONE


def test_ranges_that_a_drive_reports_are_compared_before_enabling(make_rig: MakeRig) -> None:
    rig = make_rig(with_motor("DM4340/default", transmission=2.0, max_torque_nm=50.0, max_speed_deg_s=200.0))
    rig.emulator.inject(Fault.WRONG_RANGE, KNEE, 1.25)
    with refused(DrivesFault.RANGE_MISMATCH, joint=KNEE, quantity=WireQuantity.SPEED, value=10.0, expected=8.0):
        rig.joints.open(rig.now_ns())


def test_a_missing_drive_is_named_at_opening(make_rig: MakeRig) -> None:
    rig = make_rig(with_motor("AK80-64/V2"))
    rig.emulator.inject(Fault.SILENT, Joint.RIGHT_HIP)
    with refused(DrivesFault.NO_REPLY, joints=(Joint.RIGHT_HIP,), can_ids="3"):
        rig.joints.open(rig.now_ns())
    rig.emulator.inject(Fault.HEALED)
    rig.joints.open(rig.now_ns())


def test_a_late_reply_about_a_register_is_no_angle(make_rig: MakeRig) -> None:
    """Read as a status it would be an angle of -12.48 rad."""
    rig = make_rig(with_motor("DM10010/default"))
    rig.emulator.inject(Fault.LATE, value=60)
    rig.joints.open(rig.now_ns())
    assert np.abs(rig.tick(None).position_rad).max() < 0.05


def test_a_drive_that_dies_before_enabling_leaves_none_enabled(make_rig: MakeRig) -> None:
    rig = make_rig(with_motor("AK80-64/V2"))
    rig.joints.open(rig.now_ns())
    rig.emulator.inject(Fault.SILENT, KNEE)
    with refused(DrivesFault.NO_REPLY, joints=(KNEE,)):
        rig.joints.enable(rig.now_ns())
    assert not any(drive.motor_mode for drive in rig.emulator.drives)


def test_a_lost_answer_leaves_no_joint_behind_the_others_when_enabling(
    make_rig: MakeRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """While one is asked again the others' answers would become older than control allows."""
    rig = make_rig(with_motor("AK80-64/V2"))
    rig.joints.open(rig.now_ns())
    hip = rig.emulator.drives[Joint.LEFT_HIP]
    commanded_ns: list[int] = []
    receive = hip.receive

    def lose_one(frame: Frame, now_ns: int) -> list[Frame]:
        replies = receive(frame, now_ns)
        if hip.motor_mode and frame.data != ENTER:
            commanded_ns.append(now_ns)
            return replies if len(commanded_ns) > 1 else []
        return replies

    monkeypatch.setattr(hip, "receive", lose_one)
    rig.joints.enable(rig.now_ns())
    assert len(commanded_ns) == 2
    stamps_differ_ns = 1_000_000  # of wall clock and monotonic clock
    assert (rig.joints.read(rig.now_ns()).measured_ns > commanded_ns[-1] - stamps_differ_ns).all()


def test_a_fault_present_at_opening_forbids_enabling(make_rig: MakeRig) -> None:
    rig = make_rig(with_motor("AK80-64/V2"))
    rig.emulator.inject(Fault.ERROR, KNEE, 5)
    rig.joints.open(rig.now_ns())
    with refused(DrivesFault.FAULT_BEFORE_ENABLING, joint=KNEE, faults=(DriveFault.ENCODER,)):
        rig.joints.enable(rig.now_ns())


@pytest.mark.parametrize(
    ("device", "code"),
    [(lambda: with_motor("DM10010/default"), 9), (lambda: small_gear("CyberGear/manual"), 1)],
    ids=["Damiao", "CyberGear"],
)
def test_a_fault_that_stays_until_it_is_cleared_is_cleared_after_torque_off(
    make_rig: MakeRig, device: Callable[[], Exoskeleton], code: int
) -> None:
    rig = make_rig(device())
    rig.emulator.inject(Fault.ERROR, KNEE, code)
    rig.joints.open(rig.now_ns())
    with refused(DrivesFault.FAULT_BEFORE_ENABLING, joint=KNEE, faults=(DriveFault.UNDER_VOLTAGE,)):
        rig.joints.enable(rig.now_ns())
    rig.joints.close(rig.now_ns())
    rig.joints.open(rig.now_ns())
    assert not any(drive.motor_mode for drive in rig.emulator.drives)
    rig.joints.enable(rig.now_ns())
    assert rig.tick(HOLD).state is DriveState.ENABLED


def test_a_fault_that_clearing_does_not_end_is_refused_again(
    make_rig: MakeRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = make_rig(with_motor("DM10010/default"))
    knee = rig.emulator.drives[KNEE]
    execute = knee._execute

    def faulty(asked: SetPoint | Order) -> None:
        execute(asked)
        knee.fail(9)

    monkeypatch.setattr(knee, "_execute", faulty)
    rig.joints.open(rig.now_ns())
    rig.joints.close(rig.now_ns())
    rig.joints.open(rig.now_ns())
    with refused(DrivesFault.FAULT_BEFORE_ENABLING, joint=KNEE, faults=(DriveFault.UNDER_VOLTAGE,)):
        rig.joints.enable(rig.now_ns())


def test_a_wrong_range_that_was_mended_is_measured_anew_after_torque_off(make_rig: MakeRig) -> None:
    rig = make_rig(with_motor("AK80-64/V2"))
    rig.joints.open(rig.now_ns())
    drive = drive_of(rig)
    for number in range(1, 600):
        drive.range_check.check(number * 0.004, 0.9, number * 2_000_000)
    drive.latched = drive.faults = DriveFault.WRONG_RANGE
    rig.joints.close(rig.now_ns())
    rig.joints.open(rig.now_ns())
    assert drive.faults is DriveFault.NONE
    rig.joints.enable(rig.now_ns())
    assert rig.tick(HOLD).state is DriveState.ENABLED


def test_a_drive_that_does_not_confirm_its_end_is_reported_by_closing(rig: CanRig) -> None:
    rig.emulator.inject(Fault.SILENT, KNEE)
    with refused(DrivesFault.NOT_CONFIRMED_OFF, joints=(KNEE,)):
        rig.joints.close(rig.now_ns())
    assert rig.joints.read(rig.now_ns()).state is DriveState.DISABLED


def test_a_drive_that_did_not_confirm_its_end_is_asked_again_by_the_next_closing(rig: CanRig) -> None:
    rig.emulator.inject(Fault.SILENT, KNEE)
    for _ in range(2):
        with refused(DrivesFault.NOT_CONFIRMED_OFF, joints=(KNEE,)):
            rig.joints.close(rig.now_ns())
    assert rig.emulator.drives[KNEE].motor_mode
    rig.emulator.inject(Fault.HEALED, KNEE)
    rig.joints.close(rig.now_ns())
    assert not any(drive.motor_mode for drive in rig.emulator.drives)
    rig.joints.close(rig.now_ns())


@pytest.mark.parametrize(
    "device",
    [
        lambda: with_motor("AK80-64/V2"),
        lambda: with_motor("DM10010/default"),
        lambda: small_gear("CyberGear/manual"),
    ],
)
def test_a_drive_that_stayed_stiff_out_of_reach_is_damped_before_the_next_closing_takes_its_torque(
    make_rig: MakeRig, monkeypatch: pytest.MonkeyPatch, device: Callable[[], Exoskeleton]
) -> None:
    rig = make_rig(device())
    start(rig)
    knee = rig.emulator.drives[KNEE]
    rig.until(lambda _: knee.effective(rig.now_ns()).stiffness_nm_rad > 10.0, HOLD)
    rig.emulator.inject(Fault.SILENT, KNEE)
    with refused(DrivesFault.NOT_CONFIRMED_OFF, joints=(KNEE,)):
        rig.joints.close(rig.now_ns())
    assert knee.effective(rig.now_ns()).stiffness_nm_rad > 10.0
    rig.emulator.inject(Fault.HEALED, KNEE)
    told = [listening(monkeypatch, drive) for drive in rig.emulator.drives]
    rig.joints.close(rig.now_ns())
    damping = told[KNEE][: told[KNEE].index(Order.DISABLE)]
    assert len(damping) == 15, "each 20 ms for 0.3 s"
    assert_damping(knee, damping)
    assert not knee.motor_mode
    assert not any(asked for joint, asked in zip(Joint, told, strict=True) if joint is not KNEE), "they are off"


@pytest.mark.parametrize("motor", ["AK80-64/V2", "AK80-64/V3"])
def test_a_held_up_reply_to_the_damping_before_confirms_no_end(
    make_rig: MakeRig, monkeypatch: pytest.MonkeyPatch, motor: str
) -> None:
    """The orders are lost; these protocols do not report whether a drive is on."""
    rig = make_rig(with_motor(motor))
    start(rig)
    knee = rig.emulator.drives[KNEE]
    receive, held_up = knee.receive, list[Frame]()
    off = knee._codec.order(knee.device.can_id, Order.DISABLE)

    def lose_orders(frame: Frame, now_ns: int) -> list[Frame]:
        if frame in off:
            replies, held_up[:] = held_up[:], []
            return replies
        held_up[:] = receive(frame, now_ns)
        return []

    monkeypatch.setattr(knee, "receive", lose_orders)
    with refused(DrivesFault.NOT_CONFIRMED_OFF, joints=(KNEE,)):
        rig.joints.close(rig.now_ns())
    assert knee.motor_mode
    monkeypatch.setattr(knee, "receive", receive)
    rig.joints.close(rig.now_ns())
    assert not any(drive.motor_mode for drive in rig.emulator.drives)


def test_an_order_that_the_bus_refuses_is_confirmed_by_no_reply(rig: CanRig, monkeypatch: pytest.MonkeyPatch) -> None:
    assert isinstance(rig.joints, SocketCanJoints)
    send, knee = rig.joints.send, rig.emulator.drives[KNEE]
    off = knee._codec.order(knee.device.can_id, Order.DISABLE)

    def refuse_order(drive: Drive, frames: list[Frame]) -> bool:
        if frames[0] not in off:
            return send(drive, frames)
        drive.replies += 1  # to what was sent before
        return False

    monkeypatch.setattr(rig.joints, "send", refuse_order)
    with refused(DrivesFault.NOT_CONFIRMED_OFF, joints=(KNEE,)):
        rig.joints.close(rig.now_ns())


@pytest.mark.parametrize("left_on", [False, True])
def test_a_drive_that_answers_in_motor_mode_alone_is_not_asked_without_power_and_confirms_its_end(
    make_rig: MakeRig, monkeypatch: pytest.MonkeyPatch, *, left_on: bool
) -> None:
    rig = make_rig(with_motor("AK80-64/V2"))
    knee = rig.emulator.drives[KNEE]
    knee.motor_mode = left_on
    answer_with_power_alone(monkeypatch, knee)
    rig.joints.open(rig.now_ns())
    assert rig.joints.read(rig.now_ns()).unasked == {KNEE}
    rig.joints.enable(rig.now_ns())
    rig.until(lambda now: (now.measured_ns > 0).all(), HOLD)
    rig.joints.close(rig.now_ns())
    assert not any(drive.motor_mode for drive in rig.emulator.drives)


def test_a_v3_drive_that_is_off_is_not_powered_when_another_one_is_asked_again(make_rig: MakeRig) -> None:
    rig = make_rig(with_motor("AK80-64/V3"))
    start(rig)
    rig.emulator.inject(Fault.SILENT, KNEE)
    with refused(DrivesFault.NOT_CONFIRMED_OFF, joints=(KNEE,)):
        rig.joints.close(rig.now_ns())
    device = rig.emulator.device
    with another_sender(device) as bus:
        with refused(DrivesFault.NOT_CONFIRMED_OFF, joints=(KNEE,)):
            rig.joints.close(rig.now_ns())
        sent = {message.arbitration_id for message in iter(lambda: bus.recv(0), None)}
    assert sent == {(1 << 8) | device.left_knee.can_id}, "a current of 0 A, to the silent one alone"


def test_closing_takes_the_torque_off(rig: CanRig) -> None:
    rig.joints.close(rig.now_ns())
    assert not any(drive.motor_mode for drive in rig.emulator.drives)


def test_enabling_replays_no_old_command(make_rig: MakeRig) -> None:
    """A drive enabled again follows its last command until the next: so the neutral one has to come first."""
    rig = make_rig(with_motor("AK80-64/V2"))
    start(rig)
    rig.until(lambda now: np.abs(now.position_rad - 0.1).max() < 0.05, HOLD)
    rig.joints.close(rig.now_ns())
    rig.joints.open(rig.now_ns())
    rig.joints.enable(rig.now_ns())
    assert all(drive.effective(rig.now_ns()).stiffness_nm_rad < 0.2 for drive in rig.emulator.drives)


@pytest.mark.parametrize(("after_s", "share"), [(0.0, 0.0), (1.0, 0.2), (2.5, 0.5), (5.0, 1.0), (9.0, 1.0)])
def test_stiffness_and_torque_rise_after_enabling(make_rig: MakeRig, after_s: float, share: float) -> None:
    rig = make_rig(msgspec.structs.replace(with_motor("AK80-64/V2"), soft_start_s=5.0))
    enabled_ns = rig.now_ns() + 60_000_000_000
    rig.joints.open(rig.now_ns())
    rig.joints.enable(enabled_ns)
    rig.joints.write(command(0.1, stiffness=200.0, damping=3.0, torque=10.0), enabled_ns + int(after_s * 1e9))
    drive = rig.emulator.drives[0]
    until(lambda: drive._target.position_rad == pytest.approx(0.1, abs=0.01))
    risen = (drive._target.stiffness_nm_rad, drive._target.damping_nm_s_rad, drive._target.torque_nm)
    assert risen == pytest.approx((200.0 * share, 3.0, 10.0 * share), abs=0.2)


def test_a_command_that_is_no_number_becomes_damping_and_is_reported(rig: CanRig) -> None:
    rig.until(
        lambda now: (
            BusFault.SEND_FAILED in now.bus and rig.emulator.drives[0].effective(rig.now_ns()).stiffness_nm_rad < 0.2
        ),
        command(float("nan")),
    )
    damping = pytest.approx(4.0, abs=0.01)
    rig.until(lambda _: rig.emulator.drives[0].effective(rig.now_ns()).damping_nm_s_rad == damping)


def test_a_closed_bus_is_an_interface_gone_not_an_exception(make_rig: MakeRig) -> None:
    device = with_motor("AK80-64/V2")
    if device.buses[0].interface != "virtual":
        pytest.skip("a kernel interface is taken down in test_vcan.py")
    rig = make_rig(device)
    start(rig)
    assert isinstance(rig.joints, SocketCanJoints)
    rig.joints._ports[0]._bus.shutdown()  # the interface vanishes under the driver
    feedback = rig.until(lambda now: BusFault.INTERFACE_GONE in now.bus, HOLD)
    assert feedback.state is DriveState.FAULTED


def test_two_buses_carry_two_legs(make_rig: MakeRig) -> None:
    first, second = on_test_bus(load_exoskeleton()), on_test_bus(load_exoskeleton())
    buses = tuple(msgspec.structs.replace(device.buses[0], bitrate=500_000) for device in (first, second))
    if buses[0] == buses[1]:
        pytest.skip("one kernel bus only")
    legs = each_joint(
        load_exoskeleton(), lambda n, joint: msgspec.structs.replace(joint, can_bus=n // 2, can_id=n % 2 + 1)
    )
    rig = make_rig(msgspec.structs.replace(legs, buses=buses))
    start(rig)
    target = np.array([0.2, 0.3, 0.1, 0.4])
    rig.until(lambda now: np.abs(now.position_rad - target).max() < 0.05, command(target, stiffness=400.0))


def feedback_age_ms(feedback: JointFeedback, now_ns: int) -> float:
    return float((now_ns - feedback.measured_ns).max() / 1e6)


def test_a_step_of_the_wall_clock_makes_no_feedback_fresh_or_old(rig: CanRig, monkeypatch: pytest.MonkeyPatch) -> None:
    """Receive stamps are wall-clock time: a jump of an hour either way must not show."""
    assert isinstance(rig.joints, SocketCanJoints)
    port = rig.joints._ports[0]
    for step_ns in (3_600_000_000_000, -3_600_000_000_000):
        wall_ns = port._wall_ns
        monkeypatch.setattr(port, "_wall_ns", lambda now=wall_ns, step=step_ns: now() + step)
        rig.tick(HOLD)
        feedback = rig.until(lambda now: feedback_age_ms(now, rig.now_ns()) < 100, HOLD)
        assert (feedback.measured_ns <= rig.now_ns()).all()
