"""Scan, monitor, recorder, decoder and zeroing against emulated drives."""

from __future__ import annotations

import gzip
import io
import math
import struct
import threading
from pathlib import Path

import can
import msgspec
import pytest
from rich.console import Console

from app.cli.drive_table import monitor_table
from hal.errors import CanFault, DrivesFault
from hal.joints.can import zero
from hal.joints.can.bus import open_bus
from hal.joints.can.candump import BusDecoder, FrameKind, LogDecoder, LogSummary, messages_of, open_log
from hal.joints.can.drive import drives_of
from hal.joints.can.driver import SocketCanJoints
from hal.joints.can.recorder import BusRecorder
from hal.joints.can.scan import ALL_IDS, QUESTIONS, BusMonitor, listen, scan
from hal.joints.codecs import CODECS
from hal.joints.codecs.wire import Frame, Order, Reply
from hal.joints.emulator.emulator import DriveEmulator
from hal.joints.emulator.faults import Fault
from hal.joints.protocol import DriveFault, Joint
from testing.emulated_drives import emulating
from tests.support.breaking_bus import BreakingBus
from tests.support.can_rig import CanRig, MakeRig, command, each_joint, small_gear, until, with_motor
from tests.support.errors import refused

PATIENT_S = 0.4  # emulated drives share this machine's processors

PROTOCOLS = {
    "MIT (AK V1/V2, bgkatz)": lambda: with_motor("AK80-64/V2"),
    "Damiao": lambda: with_motor("DM10010/default"),
    "CyberGear": lambda: small_gear("CyberGear/manual"),
    "AK V3 / servo": lambda: with_motor("AK80-64/V3"),
}


def test_every_protocol_is_asked_for_and_tried_here() -> None:
    names = {codec.traits.scan_name for codec in CODECS.values()}
    assert {codec.traits.scan_name for codec, *_ in QUESTIONS} == names, (
        "ask for it: QUESTIONS in hal/joints/can/scan.py"
    )
    assert set(PROTOCOLS) == names, f"add a device to PROTOCOLS in {__file__}"


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_scanning_distinguishes_protocols_and_finds_every_drive(make_rig: MakeRig, protocol: str) -> None:
    device = PROTOCOLS[protocol]()
    make_rig(device)
    with open_bus(device.buses[0]) as bus:
        found = scan(bus, range(1, 9), round_s=PATIENT_S)
    assert sorted((drive.protocol, drive.drive_id, drive.answers) for drive in found) == [
        (protocol, number, 1) for number in range(1, 5)
    ]


def test_scanning_counts_drives_that_share_an_id(make_rig: MakeRig) -> None:
    device = with_motor("AK80-64/V2")
    rig = make_rig(device)
    rig.emulator.inject(Fault.DUPLICATE, Joint.LEFT_KNEE)
    with open_bus(device.buses[0]) as bus:
        found = {drive.drive_id: drive.answers for drive in scan(bus, range(1, 9), round_s=PATIENT_S)}
    assert found == {1: 1, 2: 2, 3: 1, 4: 1}


def test_drives_that_upload_by_themselves_share_no_id() -> None:
    device = with_motor("AK80-64/servo")
    with emulating(DriveEmulator(device)), open_bus(device.buses[0]) as bus:
        traffic = listen(bus, 0.3)
        found = scan(bus, range(1, 9), uploads=traffic.uploads, round_s=PATIENT_S)
    assert not traffic.busy
    assert sorted((drive.drive_id, drive.answers) for drive in found) == [(number, 1) for number in range(1, 5)]


def test_every_id_that_a_description_may_have_is_asked(make_rig: MakeRig) -> None:
    least, greatest = 0, 127
    ids = (least, 1, 2, greatest)
    device = each_joint(
        with_motor("AK80-64/V2"),
        lambda number, joint: msgspec.structs.replace(joint, can_id=ids[number], reply_id=0x200),  # 0 is a drive's here
    )
    make_rig(device)
    with open_bus(device.buses[0]) as bus:
        found = scan(bus, [number for number in ALL_IDS if number in ids], round_s=PATIENT_S)
    assert {drive.drive_id for drive in found} == set(ids)


def start(rig: CanRig) -> None:
    rig.joints.open(rig.now_ns())
    rig.joints.enable(rig.now_ns())


def test_listening_distinguishes_a_bus_in_use_from_one_that_is_still(make_rig: MakeRig) -> None:
    device = with_motor("AK80-64/V2")
    rig = make_rig(device)
    with open_bus(device.buses[0]) as bus:
        assert not listen(bus, 0.05).busy
        start(rig)
        rig.until(lambda now: (now.measured_ns > 0).all(), command())
        assert listen(bus, 0.3).busy


@pytest.mark.parametrize(
    "error",
    [
        IndexError("string index out of range"),
        ValueError("non-hexadecimal number"),
        struct.error("unpack requires a buffer of 4 bytes"),
    ],
)
def test_a_line_that_was_cut_is_told(error: Exception) -> None:
    with BreakingBus(receiving=error) as bus, refused(CanFault.RECEIVE_FAILED, bus=bus.channel_info, detail=str(error)):
        listen(bus, 0.3)


def test_the_monitor_sees_both_sides_and_sends_nothing(make_rig: MakeRig) -> None:
    device = with_motor("AK80-64/V2")
    rig = make_rig(device)
    monitor = BusMonitor(device)
    start(rig)
    for _ in range(5):
        rig.tick(command(0.2, stiffness=100.0))
    rig.joints.close(rig.now_ns())
    before = rig.emulator.received
    monitor.poll(0.05)
    assert rig.emulator.received == before
    for joint in Joint:
        assert monitor.counts[joint, FrameKind.COMMAND] > 0
        assert monitor.counts[joint, FrameKind.REPLY] > 0
        assert monitor.newest[joint, FrameKind.ORDER].content is Order.DISABLE
    shown = Console(width=80, file=io.StringIO())
    shown.print(monitor_table(monitor))
    lines = shown.file.getvalue().splitlines()  # type: ignore[attr-defined]
    assert [line.split("  ")[0] for line in lines[1:5]] == ["left hip", "left knee", "right hip", "right knee"]
    monitor.close()


@pytest.mark.parametrize("motor", ["AK80-64/V2", "AK80-64/V3", "DM10010/default"])
def test_the_monitor_asks_drives_without_power_and_leaves_them_so(make_rig: MakeRig, motor: str) -> None:
    device = with_motor(motor)
    rig = make_rig(device)
    rig.emulator.drives[Joint.LEFT_KNEE].zero_rad = -0.5  # turned by hand
    monitor = BusMonitor(device, ask=True)

    def all_reply_again() -> bool:
        monitor.poll(0.002)
        return all(monitor.counts[joint, FrameKind.REPLY] > 1 for joint in Joint)

    until(all_reply_again)
    newest = monitor.newest[Joint.LEFT_KNEE, FrameKind.REPLY].content
    assert isinstance(newest, Reply)
    assert newest.position_rad == pytest.approx(0.5, abs=0.01)
    assert not any(drive.motor_mode for drive in rig.emulator.drives)
    monitor.close()


@pytest.fixture
def recorded(make_rig: MakeRig, tmp_path: Path) -> Path:
    """A short session's log, with a fault in it."""
    device = with_motor("AK80-64/V2")
    rig = make_rig(device)
    path = tmp_path / "session.can.log"
    recorder, stop = BusRecorder(device, path), threading.Event()
    thread = threading.Thread(target=recorder.run, args=(stop.is_set,))
    thread.start()
    start(rig)
    rig.emulator.inject(Fault.ERROR, Joint.LEFT_KNEE, 2)
    rig.until(lambda now: now.faults[Joint.LEFT_KNEE], command(0.1))
    rig.joints.close(rig.now_ns())
    rig.until(lambda _: recorder.frames >= 60)
    stop.set()
    thread.join()
    recorder.close()
    return path


def read(path: Path) -> tuple[list[FrameKind], LogSummary]:
    decoder, summary = LogDecoder(with_motor("AK80-64/V2")), LogSummary()
    kinds = []
    with open_log(path) as file:
        for message in messages_of(file, summary):
            decoded = decoder.decode(message)
            kinds.append(decoded.kind)
            summary.add(decoded)
    return kinds, summary


def test_a_recorded_session_decodes_to_its_last_frame(recorded: Path) -> None:
    kinds, summary = read(recorded)
    assert summary.broken_lines == 0
    assert len(kinds) == len(list(can.LogReader(recorded))) == len(recorded.read_text().splitlines())
    assert set(kinds) == {FrameKind.ORDER, FrameKind.COMMAND, FrameKind.REPLY}
    assert summary.faults[Joint.LEFT_KNEE] is DriveFault.OVER_CURRENT
    assert summary.faults[Joint.RIGHT_HIP] is DriveFault.NONE


def test_a_log_cut_anywhere_is_read_up_to_its_last_whole_line(recorded: Path, tmp_path: Path) -> None:
    data = recorded.read_bytes()
    cut = tmp_path / "cut.log"
    for length in range(0, 400):
        cut.write_bytes(data[:length])
        kinds, summary = read(cut)
        assert len(kinds) == data[:length].count(b"\n")
        assert summary.broken_lines == (not data[:length].endswith(b"\n") and length > 0)


def test_a_compressed_log_cut_in_half_is_read_as_far_as_it_goes(recorded: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.log.gz"
    whole = gzip.compress(recorded.read_bytes() * 20)
    cut.write_bytes(whole[: len(whole) * 3 // 4])
    kinds, summary = read(cut)
    assert len(kinds) > 60
    assert summary.broken_lines >= 1


def test_lines_that_are_no_frames_are_left_out_and_counted() -> None:
    summary = LogSummary()
    text = "(1.0) can0 001#FF\n\nnonsense\n(2.0) can0 1#\n(3.0) can0 001#FFF\n(4.0) can0 12345678#00 R\n\x00\xff\n"
    assert len(list(messages_of(io.StringIO(text), summary))) == 2
    assert summary.broken_lines == 4


def test_a_log_that_is_not_there_is_reported() -> None:
    with refused(CanFault.LOG_UNREADABLE, path=Path("nowhere.log")):
        open_log(Path("nowhere.log"))


def test_strangers_and_error_frames_decode_to_themselves() -> None:
    decoder = BusDecoder(drives_of(with_motor("AK80-64/V2")))
    stranger = decoder.decode(can.Message(arbitration_id=0x18FEEE00, data=b"\xab\xcd"))
    assert (stranger.kind, stranger.content) == (FrameKind.UNKNOWN, "18FEEE00#ABCD")
    off = can.Message(is_error_frame=True, is_extended_id=False, arbitration_id=0x40, data=bytes(8))
    assert decoder.decode(off).content is CanFault.CONTROLLER_OFF


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(zero, "STILL_FOR_S", 0.05)
    monkeypatch.setattr(zero, "TAKES_EFFECT_S", 0.2)


@pytest.fixture
def opened(make_rig: MakeRig, quick: None) -> tuple[SocketCanJoints, CanRig]:
    """Drives that stand at 0.3 rad, probed."""
    rig = make_rig(with_motor("AK80-64/V2", zero_offset_deg=10.0))
    assert isinstance(rig.joints, SocketCanJoints)
    for drive in rig.emulator.drives:
        drive.zero_rad = -0.3
    rig.joints.open(rig.now_ns())
    return rig.joints, rig


def test_zeroing_makes_the_pose_the_described_offset(opened: tuple[SocketCanJoints, CanRig]) -> None:
    joints, rig = opened
    request = zero.request_zero(joints, Joint.LEFT_KNEE)
    assert zero.set_zero(joints, request, request.code, print) == pytest.approx(math.radians(10.0), abs=0.01)
    assert rig.emulator.drives[Joint.LEFT_HIP].zero_rad == -0.3


def test_zeroing_needs_the_code(opened: tuple[SocketCanJoints, CanRig]) -> None:
    joints, rig = opened
    request = zero.request_zero(joints, Joint.LEFT_KNEE)
    with refused(DrivesFault.ZERO_WRONG_CODE):
        zero.set_zero(joints, request, "yes", print)
    late = zero.ZeroRequest(request.joint, request.angle_rad, request.code, request.at_s - 60)
    with refused(DrivesFault.ZERO_TOO_LATE):
        zero.set_zero(joints, late, request.code, print)
    assert rig.emulator.drives[Joint.LEFT_KNEE].zero_rad == -0.3


def test_zeroing_needs_a_permission_at_the_last_moment(opened: tuple[SocketCanJoints, CanRig]) -> None:
    joints, rig = opened
    request = zero.request_zero(joints, Joint.LEFT_KNEE)

    def refuse() -> None:
        raise PermissionError

    with pytest.raises(PermissionError):
        zero.set_zero(joints, request, request.code, refuse)
    assert rig.emulator.drives[Joint.LEFT_KNEE].zero_rad == -0.3


def test_zeroing_needs_the_joint_still(opened: tuple[SocketCanJoints, CanRig]) -> None:
    joints, rig = opened
    request = zero.request_zero(joints, Joint.LEFT_KNEE)
    rig.emulator.drives[Joint.LEFT_KNEE].zero_rad = -0.35
    with refused(DrivesFault.ZERO_MOVED, joint=Joint.LEFT_KNEE):
        zero.set_zero(joints, request, request.code, print)


@pytest.mark.parametrize(("step_deg", "speed_rad_s"), [(0.2, 0.0), (0.0, 0.2)])
def test_zeroing_needs_a_joint_that_neither_creeps_nor_turns(
    make_rig: MakeRig, monkeypatch: pytest.MonkeyPatch, step_deg: float, speed_rad_s: float
) -> None:
    monkeypatch.setattr(zero, "STILL_FOR_S", 30.0)
    rig = make_rig(with_motor("AK80-64/V2"))
    assert isinstance(rig.joints, SocketCanJoints)
    rig.joints.open(rig.now_ns())
    knee = rig.emulator.drives[Joint.LEFT_KNEE]
    receive = knee.receive

    def creep(frame: Frame, now_ns: int) -> list[Frame]:
        knee.zero_rad -= math.radians(step_deg)
        knee.state = knee.state._replace(velocity_rad_s=speed_rad_s)
        return receive(frame, now_ns)

    monkeypatch.setattr(knee, "receive", creep)
    with refused(DrivesFault.ZERO_MOVING, joint=Joint.LEFT_KNEE):
        zero.request_zero(rig.joints, Joint.LEFT_KNEE)


def test_zeroing_is_refused_while_enabled(opened: tuple[SocketCanJoints, CanRig]) -> None:
    joints, rig = opened
    joints.enable(rig.now_ns())
    with refused(DrivesFault.ZERO_ENABLED):
        zero.request_zero(joints, Joint.LEFT_KNEE)


def test_a_drive_that_ignores_its_zero_is_reported(opened: tuple[SocketCanJoints, CanRig]) -> None:
    joints, rig = opened
    request = zero.request_zero(joints, Joint.LEFT_KNEE)
    rig.emulator.drives[Joint.LEFT_KNEE].ignores_zero = True
    with refused(DrivesFault.ZERO_NOT_TAKEN, joint=Joint.LEFT_KNEE):
        zero.set_zero(joints, request, request.code, print)


@pytest.mark.parametrize(("off_deg", "taken"), [(0.9, False), (0.15, True)])
def test_a_joint_near_its_zero_is_not_taken_for_one_that_was_zeroed(
    make_rig: MakeRig, quick: None, off_deg: float, *, taken: bool
) -> None:
    rig = make_rig(with_motor("AK80-64/V2"))
    assert isinstance(rig.joints, SocketCanJoints)
    knee = rig.emulator.drives[Joint.LEFT_KNEE]
    knee.zero_rad = -math.radians(off_deg)
    knee.ignores_zero = True
    rig.joints.open(rig.now_ns())
    request = zero.request_zero(rig.joints, Joint.LEFT_KNEE)
    if taken:
        angle_rad = zero.set_zero(rig.joints, request, request.code, print)
        assert math.degrees(angle_rad) == pytest.approx(off_deg, abs=0.03)
    else:
        with refused(DrivesFault.ZERO_NOT_TAKEN, joint=Joint.LEFT_KNEE):
            zero.set_zero(rig.joints, request, request.code, print)


def test_a_zero_that_acts_late_is_waited_for(make_rig: MakeRig, quick: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """As CubeMars drives do: until then the joint, near its zero, reads as before."""
    rig = make_rig(with_motor("AK80-64/V2"))
    assert isinstance(rig.joints, SocketCanJoints)
    knee = rig.emulator.drives[Joint.LEFT_KNEE]
    knee.zero_rad, knee.ignores_zero = -math.radians(0.9), True
    rig.joints.open(rig.now_ns())
    request = zero.request_zero(rig.joints, Joint.LEFT_KNEE)
    receive, answered = knee.receive, list[Frame]()

    def act_after_a_second_answer(frame: Frame, now_ns: int) -> list[Frame]:
        replies = receive(frame, now_ns)
        answered.extend(replies)
        if len(answered) == 2:
            knee.zero_rad = knee.state.position_rad
        return replies

    def permit() -> None:
        monkeypatch.setattr(knee, "receive", act_after_a_second_answer)

    angle_rad = zero.set_zero(rig.joints, request, request.code, permit)
    assert math.degrees(angle_rad) == pytest.approx(0.0, abs=0.03)


def test_an_unresponsive_drive_is_reported_when_asked_for_its_zero(opened: tuple[SocketCanJoints, CanRig]) -> None:
    joints, rig = opened
    rig.emulator.inject(Fault.SILENT, Joint.LEFT_KNEE)
    with refused(DrivesFault.ZERO_NO_REPLY, joint=Joint.LEFT_KNEE):
        zero.request_zero(joints, Joint.LEFT_KNEE)
