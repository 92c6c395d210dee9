"""What the CAN doctor makes of the kernel's word and of the drives' answers."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from app.diagnostics.can_doctor import examine, judge_drives, judge_link
from app.diagnostics.findings import Finding, Grade
from hal.joints.can.bus import with_bus
from hal.joints.can.scan import Found
from hal.joints.device import BusDevice, Exoskeleton, load_exoskeleton
from hal.joints.emulator.emulator import DriveEmulator, EmulatorThread

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
    ("told", "grade", "text", "remedy"),
    [
        (link(), Grade.GOOD, "ERROR-ACTIVE", ""),
        ({}, Grade.BAD, "no such interface", "ip link set can0 up type can bitrate 1000000"),
        (link(flags=["NOARP"]), Grade.BAD, "down", "ip link set can0 up"),
        (link(data={"bittiming": {"bitrate": 500_000}}), Grade.BAD, "500000", "bitrate 1000000"),
        (link(data={"state": "BUS-OFF"}), Grade.BAD, "termination", "ip link set can0 down"),
        (
            link(data={"state": "ERROR-PASSIVE", "berr_counter": {"tx": 128, "rx": 0}}),
            Grade.BAD,
            "nobody acknowledges",
            "power",
        ),
        (
            link(data={"state": "ERROR-WARNING", "berr_counter": {"tx": 0, "rx": 100}}),
            Grade.BAD,
            "arrive broken",
            "bit rate",
        ),
        (link(data={"restart_ms": 100}), Grade.NOTE, "restarts by itself", "restart-ms 0"),
        (link(txqlen=10), Grade.NOTE, "No buffer space", "txqueuelen 1000"),
        (
            {"flags": ["UP"], "linkinfo": {"info_kind": "vcan"}},
            Grade.GOOD,
            "virtual",
            "",
        ),
    ],
)
def test_the_link_is_judged_with_what_mends_it(told: dict[str, Any], grade: Grade, text: str, remedy: str) -> None:
    finding = worst(list(judge_link(told, CAN0)))
    assert finding.grade is grade
    assert text in finding.text
    assert remedy in finding.remedy


def answers(**by_id: Any) -> list[Found]:
    return [Found(MIT, number, by_id.get(f"id{number}", 1), "") for number in range(1, 5)]


def judged(found: list[Found], device: Exoskeleton = DEVICE) -> dict[str, Finding]:
    return {finding.subject: finding for finding in judge_drives(device, 0, found, None)}


def test_four_drives_that_answer_once_are_good() -> None:
    assert {finding.grade for finding in judged(answers()).values()} == {Grade.GOOD}


def test_a_silent_drive_is_named() -> None:
    finding = judged(answers()[1:])["left hip"]
    assert finding.grade is Grade.BAD
    assert "ID 1 does not answer" in finding.text


def test_a_shared_id_is_told() -> None:
    finding = judged(answers(id3=2))["right hip"]
    assert "answers 2 times" in finding.text


def test_a_drive_in_another_protocol_is_told() -> None:
    finding = judged([*answers()[1:], Found("Damiao", 1, 1, "")])["left hip"]
    assert "speaks Damiao" in finding.text


def test_a_drive_nobody_described_is_told() -> None:
    assert "ID 9" in judged([*answers(), Found(MIT, 9, 1, "")])["can0"].text


def test_two_joints_with_one_id_are_told() -> None:
    same = msgspec.structs.replace(DEVICE.left_knee, can_id=1)
    device = msgspec.structs.replace(DEVICE, left_knee=same)
    assert "given to two joints" in judged(answers(), device)["left knee"].text


def test_an_emulated_bus_is_examined_to_the_drives() -> None:
    device = with_bus(DEVICE, "virtual", "doctor")
    with EmulatorThread(DriveEmulator(device)):
        still = list(examine(device, None, ask=False))
    assert [finding.grade for finding in still] == [Grade.GOOD]


def test_a_missing_interface_is_told_and_nothing_else_is_tried() -> None:
    device = with_bus(DEVICE, "socketcan", "can77")
    findings = list(examine(device, None))
    assert [finding.grade for finding in findings] == [Grade.BAD]
