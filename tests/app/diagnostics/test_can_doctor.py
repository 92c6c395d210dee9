"""What the CAN doctor makes of the kernel's word and of the drives' answers."""

from __future__ import annotations

import io
import shutil
from pathlib import Path
from typing import Any

import can
import msgspec
import pytest
from rich.console import Console

from app.diagnostics import can_doctor
from app.diagnostics.can_doctor import CanFinding as F
from app.diagnostics.can_doctor import CanRemedy, evaluate_drives, evaluate_link, examine
from app.diagnostics.findings import Finding, Grade, show
from app.text.catalogue import render
from hal.joints.can.bus import with_bus
from hal.joints.can.scan import FoundDrive, ScanReply
from hal.joints.device import BusDevice, Exoskeleton, JointDevice, load_exoskeleton
from hal.joints.emulator.emulator import DriveEmulator
from hal.joints.protocol import Joint
from logs.reason import key_of, reason
from testing.emulated_drives import emulating
from tests.support.can_rig import each_joint, with_motor

CAN0 = BusDevice()
MIT = "MIT (AK V1/V2, bgkatz)"
DEVICE = load_exoskeleton()


def link(**changes: Any) -> dict[str, Any]:
    """As `ip -details -json link show can0` tells a healthy controller."""
    data = {
        "state": "ERROR-ACTIVE",
        "berr_counter": {"tx": 0, "rx": 0},
        "bittiming": {"bitrate": 1_000_000},
        "restart_ms": 0,
    }
    info = {"info_kind": "can", "info_data": data | changes.pop("data", {})}
    return {"ifname": "can0", "flags": ["NOARP", "UP"], "txqlen": 1000, "linkinfo": info, **changes}


def worst(findings: list[Finding]) -> Finding:
    return max(findings, key=lambda finding: list(Grade).index(finding.grade))


@pytest.mark.parametrize(
    ("reported", "grade", "code", "remedy"),
    [
        (link(), Grade.GOOD, F.UP, ""),
        ({}, Grade.BAD, F.NO_INTERFACE, "ip link set can0 up type can bitrate 1000000"),
        (link(flags=["NOARP"]), Grade.BAD, F.DOWN, "ip link set can0 up"),
        (link(data={"bittiming": {"bitrate": 500_000}}), Grade.BAD, F.WRONG_BITRATE, "bitrate 1000000"),
        (link(data={"state": "BUS-OFF"}), Grade.BAD, F.BUS_OFF, "ip link set can0 down"),
        (
            link(data={"state": "ERROR-PASSIVE", "berr_counter": {"tx": 128, "rx": 0}}),
            Grade.BAD,
            F.NOT_ACKNOWLEDGED,
            "power",
        ),
        (
            link(data={"state": "ERROR-WARNING", "berr_counter": {"tx": 0, "rx": 100}}),
            Grade.BAD,
            F.BROKEN_FRAMES,
            "bit rate",
        ),
        (link(data={"restart_ms": 100}), Grade.NOTE, F.RESTARTS_ITSELF, "restart-ms 0"),
        (link(txqlen=10), Grade.NOTE, F.SHORT_QUEUE, "txqueuelen 1000"),
        ({"flags": ["UP"], "linkinfo": {"info_kind": "vcan"}}, Grade.GOOD, F.VIRTUAL, ""),
        ({"flags": ["UP"], "linkinfo": {"info_kind": "vxcan"}}, Grade.GOOD, F.VIRTUAL, ""),
    ],
)
def test_the_link_is_evaluated_with_its_remedy(reported: dict[str, Any], grade: Grade, code: F, remedy: str) -> None:
    finding = worst(list(evaluate_link(reported, CAN0)))
    assert finding.grade is grade
    assert finding.what.code == key_of(code)
    assert render(finding.what)
    assert remedy in (render(finding.remedy) if finding.remedy else "")


ON_ID: tuple[ScanReply, dict[str, object]] = (ScanReply.ANSWERS_ON, {"identifier": "000"})


def answers(**by_id: Any) -> list[FoundDrive]:
    return [FoundDrive(MIT, number, by_id.get(f"id{number}", 1), *ON_ID) for number in range(1, 5)]


def evaluated(found: list[FoundDrive], device: Exoskeleton = DEVICE) -> dict[object, Finding]:
    return {finding.subject: finding for finding in evaluate_drives(device, 0, found, None)}


def test_four_drives_that_answer_once_are_good() -> None:
    assert {finding.grade for finding in evaluated(answers()).values()} == {Grade.GOOD}


def test_an_unresponsive_drive_is_named() -> None:
    finding = evaluated(answers()[1:])[Joint.LEFT_HIP]
    assert finding.grade is Grade.BAD
    assert finding.what.code == key_of(F.SILENT)
    assert "ID 1 does not answer" in render(finding.what)


def test_a_shared_id_is_reported() -> None:
    finding = evaluated(answers(id3=2))[Joint.RIGHT_HIP]
    assert (finding.what.code, finding.what.values["answers"]) == (key_of(F.SHARED_ID), 2)


def test_a_drive_in_another_protocol_is_reported() -> None:
    finding = evaluated([*answers()[1:], FoundDrive("Damiao", 1, 1, *ON_ID)])[Joint.LEFT_HIP]
    assert (finding.what.code, finding.what.values["protocol"]) == (key_of(F.OTHER_PROTOCOL), "Damiao")
    assert finding.remedy == reason(CanRemedy.CORRECT_MOTOR)


def test_a_damiao_drive_that_answers_on_another_identifier_than_described_is_reported() -> None:
    device = with_motor("DM10010/default")
    exchanged = {0x11: 0x12, 0x12: 0x11}

    def change(_: int, joint: JointDevice) -> JointDevice:
        return msgspec.structs.replace(joint, reply_id=exchanged.get(joint.reply_id, joint.reply_id))

    with emulating(DriveEmulator(each_joint(device, change))):
        findings = {finding.subject: finding for finding in examine(device, None)}
    assert [findings[joint].grade for joint in Joint] == [Grade.BAD] * 2 + [Grade.GOOD] * 2
    values = {"can_id": 1, "identifier": "012", "described": "011"}
    assert findings[Joint.LEFT_HIP].what == reason(F.OTHER_REPLY_ID, **values)
    assert findings[Joint.LEFT_HIP].remedy == reason(CanRemedy.CORRECT_REPLY_ID)


def test_a_drive_nobody_described_is_reported() -> None:
    assert evaluated([*answers(), FoundDrive(MIT, 9, 1, *ON_ID)])["can0"].what.values["can_id"] == 9


def test_two_joints_with_one_id_are_reported() -> None:
    same = msgspec.structs.replace(DEVICE.left_knee, can_id=1)
    device = msgspec.structs.replace(DEVICE, left_knee=same)
    assert evaluated(answers(), device)[Joint.LEFT_KNEE].what.code == key_of(F.SHARED_ID_IN_DEVICE)


def test_an_emulated_bus_is_examined_to_the_drives() -> None:
    device = with_bus(DEVICE, "virtual", "doctor")
    with emulating(DriveEmulator(device)):
        still = list(examine(device, None, ask=False))
    assert [finding.grade for finding in still] == [Grade.GOOD]


def test_drives_that_upload_by_themselves_share_no_id() -> None:
    device = with_motor("AK80-64/servo")
    with emulating(DriveEmulator(device)):
        codes = [finding.what.code for finding in examine(device, None)]
    assert key_of(F.ANSWERS) in codes
    assert key_of(F.SHARED_ID) not in codes


@pytest.mark.parametrize(("interface", "grade"), [("slcan", Grade.BAD), ("gs_usb", Grade.NOTE)])
def test_a_bus_that_a_session_may_not_share_is_told_before_its_drives(interface: str, grade: Grade) -> None:
    first, *_ = examine(with_bus(DEVICE, interface, "can77"), None)
    assert (first.grade, first.what) == (grade, reason(F.NOT_SHARED, interface=interface))
    assert first.remedy == reason(CanRemedy.USE_SOCKETCAN)


def test_a_missing_interface_is_reported_and_nothing_else_is_tried() -> None:
    device = with_bus(DEVICE, "socketcan", "can77")
    findings = list(examine(device, None))
    assert [finding.grade for finding in findings] == [Grade.BAD]


def test_an_interface_whose_name_is_no_utf8_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The program names it in its error as it is."""
    program = tmp_path / "ip"
    program.write_text("#!/bin/sh\nprintf 'Device \"a\\377\" does not exist.' >&2\nexit 1\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    (finding,) = examine(with_bus(DEVICE, "socketcan", "a\udcff"), None)
    assert finding.what == reason(F.NO_INTERFACE)


@pytest.mark.parametrize(("name", "shown"), [("a\udcff", "a\\udcff"), ("[/]a", "[/]a"), ("a\x1b[1m", "a\\x1b[1m")])
def test_the_name_of_an_interface_is_shown_safely(name: str, shown: str) -> None:
    screen = io.TextIOWrapper(io.BytesIO(), encoding="utf-8")
    bus = BusDevice(channel=name)
    assert not show(Console(file=screen), evaluate_link({}, bus))
    screen.seek(0)
    assert screen.read().count(shown) == 2  # the interface, and the command that brings it up


def test_without_the_program_ip_the_bus_is_examined_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda *_, **__: None)
    monkeypatch.setattr(can_doctor, "open_bus", lambda bus: can.Bus(bus.channel, "virtual"))
    missing, still = examine(with_bus(DEVICE, "socketcan", "can77"), None, ask=False)
    assert (missing.grade, missing.what) == (Grade.NOTE, reason(F.NO_IP_PROGRAM))
    assert (still.grade, still.what) == (Grade.GOOD, reason(F.QUIET))


def test_a_bus_that_no_command_brings_up_has_no_empty_remedy() -> None:
    findings = list(examine(with_bus(DEVICE, "local", "no port"), None))
    assert [(finding.grade, finding.remedy) for finding in findings] == [(Grade.BAD, None)]


@pytest.mark.parametrize("motor", ["AK80-64/V2", "nobody's"])
def test_an_unknown_motor_and_an_unreadable_table_are_not_mended_by_the_interface(motor: str, tmp_path: Path) -> None:
    device = with_bus(DEVICE, "virtual", f"motor of {motor}")
    described = msgspec.structs.replace(device, left_hip=msgspec.structs.replace(DEVICE.left_hip, motor=motor))
    table = tmp_path / "motors.toml"
    table.write_text("" if motor == "nobody's" else "no table")
    with emulating(DriveEmulator(device)):
        finding = worst(list(examine(described, table)))
    assert finding.remedy == reason(CanRemedy.CORRECT_MOTOR_TABLE)
    assert "motor" in render(finding.remedy)


def test_a_virtual_interface_that_is_down_is_only_brought_up() -> None:
    (finding,) = evaluate_link({"flags": ["NOARP"]}, BusDevice(channel="vcan0"))
    assert finding.remedy is not None
    assert "ip link set vcan0 up" in render(finding.remedy)
    assert "ip link add" not in render(finding.remedy)
