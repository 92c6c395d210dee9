"""Emulated firmware keeps the quirks that have hurt people: it holds, it limps, it replays, it ignores."""

from __future__ import annotations

import msgspec
import pytest

from hal.errors import DeviceFault
from hal.joints.codecs import codec_of, cybergear, damiao
from hal.joints.codecs.wire import NEUTRAL, Frame, Order, SetPoint
from hal.joints.device import load_exoskeleton
from hal.joints.emulator.faults import Fault, read_schedule
from hal.joints.emulator.firmware import EmulatedDrive
from hal.joints.emulator.plant import Motion
from hal.joints.motors import OnTimeout, Watchdog, load_motors
from hal.joints.protocol import DriveFault, Joint
from tests.support.errors import refused

MS = 1_000_000
HOUR_NS = 3_600_000 * MS
STIFF = SetPoint(0.5, 0.0, 20.0, 1.0, 0.0)


class Bench:
    """One drive and the codec to speak to it."""

    def __init__(self, motor: str, reply_id: int = 0) -> None:
        joint = msgspec.structs.replace(load_exoskeleton().left_knee, can_id=5, reply_id=reply_id)
        self.model = load_motors().find(motor)
        self.codec = codec_of(self.model)
        self.drive = EmulatedDrive(joint, self.model)

    def order(self, order: Order, now_ns: int = 0) -> list[Frame]:
        return [answer for frame in self.codec.order(5, order) for answer in self.drive.receive(frame, now_ns)]

    def command(self, target: SetPoint, now_ns: int = 0) -> list[Frame]:
        return self.drive.receive(self.codec.command(5, target), now_ns)

    def stiffness(self, now_ns: int) -> float:
        return self.drive.effective(now_ns).stiffness_nm_rad


def test_an_ak_drive_holds_its_last_command_for_ever() -> None:
    bench = Bench("AK80-64/V2")
    bench.order(Order.ENABLE)
    bench.command(STIFF)
    assert bench.stiffness(HOUR_NS) == pytest.approx(20.0, abs=0.2)


def test_a_bgkatz_drive_limps_after_25_ms_and_comes_back_with_the_next_command() -> None:
    bench = Bench("mini-cheetah/bgkatz")
    bench.order(Order.ENABLE)
    bench.command(STIFF)
    assert bench.stiffness(25 * MS) == pytest.approx(20.0, abs=0.2)
    assert bench.stiffness(26 * MS) == 0.0
    bench.command(STIFF, 30 * MS)
    assert bench.stiffness(31 * MS) == pytest.approx(20.0, abs=0.2)


def test_a_damiao_watchdog_latches_lost_communication() -> None:
    bench = Bench("DM4310/default", reply_id=0x15)
    watchdog = Watchdog(on_silence=OnTimeout.LIMPS, after_ms=10.0)
    bench.drive.model = msgspec.structs.replace(bench.model, watchdog=watchdog)
    bench.order(Order.ENABLE)
    bench.command(STIFF)
    assert bench.stiffness(11 * MS) == 0.0
    reply = bench.codec.read_reply(bench.command(STIFF, 12 * MS)[0])
    assert reply is not None
    assert (reply.faults, reply.enabled) == (DriveFault.LOST_COMMUNICATION, False)
    assert bench.stiffness(13 * MS) == 0.0
    bench.order(Order.CLEAR)
    bench.order(Order.ENABLE)
    assert bench.drive.motor_mode


def test_a_drive_replays_its_last_command_on_enabling() -> None:
    """The kick that a neutral command before enabling prevents."""
    bench = Bench("AK80-64/V2")
    bench.order(Order.ENABLE)
    bench.command(STIFF)
    bench.order(Order.DISABLE)
    assert bench.stiffness(0) == 0.0
    bench.order(Order.ENABLE)
    assert bench.stiffness(0) > 19.0


@pytest.mark.parametrize(("motor", "obeys"), [("AK80-64/V2", False), ("DM4310/default", True)])
def test_setting_zero_in_motor_mode(motor: str, obeys: bool) -> None:
    bench = Bench(motor)
    bench.drive.state = Motion(0.7, 0.0, 0.0, 25.0)
    bench.order(Order.ENABLE)
    bench.order(Order.ZERO)
    assert (bench.drive.zero_rad == 0.7) is obeys
    bench.order(Order.DISABLE)
    bench.order(Order.ZERO)
    assert bench.drive.zero_rad == 0.7
    reply = bench.codec.read_reply(bench.command(NEUTRAL)[0])
    assert reply is not None
    assert reply.position_rad == pytest.approx(0.0, abs=0.002)


def test_after_zeroing_commands_count_from_the_new_zero() -> None:
    bench = Bench("AK80-64/V2")
    bench.drive.state = Motion(0.7, 0.0, 0.0, 25.0)
    bench.order(Order.ZERO)
    bench.order(Order.ENABLE)
    bench.command(STIFF)
    assert bench.drive.effective(0).position_rad == pytest.approx(1.2, abs=0.001)


@pytest.mark.parametrize(
    ("motor", "identifier"),
    [("AK80-64/V2", 0), ("AK80-64/V3", 0x2905), ("DM4310/default", 0x15), ("CyberGear/manual", 0x0280_05FD)],
)
def test_replies_come_on_the_identifier_of_their_protocol(motor: str, identifier: int) -> None:
    bench = Bench(motor, reply_id=0x15 if motor.startswith("DM") else 0)
    bench.order(Order.ENABLE)
    (reply,) = bench.command(NEUTRAL)
    assert reply.arbitration_id == identifier


def test_a_command_to_another_drive_is_not_answered() -> None:
    bench = Bench("AK80-64/V2")
    assert bench.drive.receive(bench.codec.command(6, STIFF), 0) == []


def test_an_error_lets_go_of_the_joint_and_forbids_enabling() -> None:
    bench = Bench("AK80-64/V2")
    bench.order(Order.ENABLE)
    bench.command(STIFF)
    bench.drive.inject(Fault.ERROR, 2)
    assert bench.stiffness(0) == 0.0
    reply = bench.codec.read_reply(bench.order(Order.ENABLE)[0])
    assert reply is not None
    assert reply.faults is DriveFault.OVER_CURRENT
    assert not bench.drive.motor_mode


def test_damiao_registers_are_reported_and_written() -> None:
    bench = Bench("DM4310/default", reply_id=0x15)
    (reported,) = bench.drive.receive(damiao.read_register(5, damiao.Register.VELOCITY_MAX), 0)
    assert reported.arbitration_id == 0x15
    assert damiao.register_reply(reported) == (5, damiao.Register.VELOCITY_MAX, 30.0)
    assert bench.drive.receive(damiao.read_register(6, damiao.Register.VELOCITY_MAX), 0) == []
    write = Frame(damiao.REGISTER_ID, bytes((5, 0, damiao.WRITE, damiao.Register.TIMEOUT, 0x90, 0x01, 0, 0)))
    (reported,) = bench.drive.receive(write, 0)
    assert damiao.register_reply(reported._replace(data=reported.data)) == (5, damiao.Register.TIMEOUT, 400.0)
    (status,) = bench.drive.receive(Frame(damiao.REGISTER_ID, bytes((5, 0, damiao.REFRESH, 0, 0, 0, 0, 0))), 0)
    assert status.data[0] == 0x05


def test_a_cybergear_reports_its_number_and_answers_parameters() -> None:
    bench = Bench("CyberGear/manual")
    (reported,) = bench.drive.receive(cybergear.who(5), 0)
    assert cybergear.unpack_identifier(reported.arbitration_id) == (0, 5, 0xFE)
    (status,) = bench.drive.receive(cybergear.operation_control(5), 0)
    assert cybergear.unpack_identifier(status.arbitration_id).kind == cybergear.Kind.FEEDBACK


@pytest.mark.parametrize(
    ("motor", "frame"),
    [
        (
            "DM4310/default",
            damiao.read_register(5, damiao.Register.TIMEOUT)._replace(
                data=bytes((5, 0, damiao.WRITE, damiao.Register.TIMEOUT, 0x90, 0x01, 0, 0))
            ),
        ),
        ("CyberGear/manual", Frame(0x1200FD05, bytes.fromhex("0C20 0000 9001 0000"), extended=True)),
    ],
)
def test_a_watchdog_set_over_the_bus_acts_after_its_time(motor: str, frame: Frame) -> None:
    """400 times 50 µs are 20 ms."""
    bench = Bench(motor, reply_id=0x15)
    bench.drive.receive(frame, 0)
    bench.order(Order.ENABLE)
    bench.command(STIFF)
    assert bench.stiffness(20 * MS) > 19.0
    assert bench.stiffness(21 * MS) == 0.0


def test_a_cybergear_reports_its_position_as_a_parameter() -> None:
    bench = Bench("CyberGear/manual")
    bench.drive.state = Motion(1.25, 0.0, 0.0, 25.0)
    (reported,) = bench.drive.receive(Frame(0x1100FD05, bytes.fromhex("1970 0000 0000 0000"), extended=True), 0)
    assert reported.arbitration_id == 0x110005FD
    assert reported.data == bytes.fromhex("1970 0000 0000 A03F")


def test_a_servo_drive_uploads_by_itself() -> None:
    bench = Bench("AK80-64/servo")
    bench.drive.state = Motion(1.0, 2.0, 3.0, 33.0)
    (frame,) = bench.drive.upload()
    reply = bench.codec.read_reply(frame)
    assert reply is not None
    assert reply.position_rad == pytest.approx(1.0, abs=0.001)
    assert reply.temperature_c == 33.0


def test_schedules_are_read() -> None:
    reported = read_schedule("left_knee:error=2@10")
    assert (reported.fault, reported.joint, reported.after_s, reported.value) == (
        Fault.ERROR,
        Joint.LEFT_KNEE,
        10.0,
        2.0,
    )
    assert read_schedule("late").value == 30.0
    assert read_schedule("wrong-id=255").value == 255.0
    assert read_schedule("bus-off@3").joint is None


@pytest.mark.parametrize("text", ["", "explode", "left_toe:silent", "silent@soon", "error=many", "wrong-id=256"])
def test_a_schedule_that_makes_no_sense_is_refused_with_the_choices(text: str) -> None:
    with refused(DeviceFault.BAD_FAULT_SCHEDULE):
        read_schedule(text)
