"""Why a CAN bus or a drive is silent, each finding with the command that mends it."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import can

from app.diagnostics.findings import Finding, bad, good, note
from hal.errors import HardwareError
from hal.joints.can.bus import open_bus, remedy_command
from hal.joints.can.scan import Found, listen, scan
from hal.joints.device import BusDevice, Exoskeleton
from hal.joints.motors import WireProtocol, load_motors

_PROTOCOL_NAMES = {
    WireProtocol.MIT: "MIT (AK V1/V2, bgkatz)",
    WireProtocol.DAMIAO: "Damiao",
    WireProtocol.CYBERGEAR: "CyberGear",
    WireProtocol.AK_V3: "AK V3 / servo",
    WireProtocol.SERVO: "AK V3 / servo",
}
_SHORT_QUEUE = 50  # frames; the kernel's default of 10 gives "No buffer space available" at the first hiccup


def examine(device: Exoskeleton, motors: Path | None, *, ask: bool = True) -> Iterator[Finding]:
    """Look at each bus from the interface up to the drives; `ask` False only listens."""
    for number, bus in enumerate(device.buses):
        subject = bus.channel
        if bus.interface == "socketcan":
            link = read_link(bus.channel)
            yield from judge_link(link, bus)
            if not link or not is_up(link):
                continue
        try:
            opened = open_bus(bus)
        except HardwareError as error:
            yield bad(subject, str(error), remedy_command(bus))
            continue
        try:
            yield from _examine_traffic(device, number, opened, motors, ask=ask)
        except HardwareError as error:
            yield bad(subject, str(error), _restart(bus))
        finally:
            opened.shutdown()


def read_link(channel: str) -> dict[str, Any]:
    """The kernel's word on an interface, from `ip`; empty when there is none."""
    program = shutil.which("ip") or shutil.which("ip", path="/usr/sbin:/sbin")
    if program is None:
        return {}
    command = [program, "-details", "-statistics", "-json", "link", "show", channel]
    told = subprocess.run(command, capture_output=True, text=True, check=False, timeout=5)
    try:
        links = json.loads(told.stdout or "[]")
    except json.JSONDecodeError:
        return {}
    return links[0] if links else {}


def is_up(link: dict[str, Any]) -> bool:
    """Whether the interface is up."""
    return "UP" in link.get("flags", ())


def judge_link(link: dict[str, Any], bus: BusDevice) -> Iterator[Finding]:
    """What the kernel's word on the interface means."""
    subject = bus.channel
    if not link:
        yield bad(subject, "there is no such interface", remedy_command(bus))
        return
    if not is_up(link):
        yield bad(subject, "the interface is down", remedy_command(bus))
        return
    kind = link.get("linkinfo", {}).get("info_kind", "")
    if kind == "vcan":
        yield good(subject, "up, virtual: no bit rate, no error counters")
        return
    yield from _judge_controller(link.get("linkinfo", {}).get("info_data", {}), bus)
    if link.get("txqlen", 1000) < _SHORT_QUEUE:
        yield note(
            subject,
            f"the send queue holds {link['txqlen']} frames only: a hiccup gives “No buffer space available”",
            f"sudo ip link set {subject} txqueuelen 1000",
        )


def _judge_controller(data: dict[str, Any], bus: BusDevice) -> Iterator[Finding]:
    subject, state = bus.channel, data.get("state", "?")
    bitrate = data.get("bittiming", {}).get("bitrate")
    if bitrate != bus.bitrate:
        yield bad(subject, f"the bit rate is {bitrate}, the device description says {bus.bitrate}", _restart(bus))
    counters = data.get("berr_counter", {})
    told = f"{state}, errors sent {counters.get('tx', 0)}, received {counters.get('rx', 0)}"
    if state == "BUS-OFF":
        yield bad(subject, f"{told}: wiring or termination (60 Ω between CAN_H and CAN_L?), then", _restart(bus))
    elif state in ("ERROR-PASSIVE", "ERROR-WARNING") and counters.get("tx", 0) > counters.get("rx", 0):
        yield bad(
            subject,
            f"{told}: nobody acknowledges",
            f"check that the drives have power and the same bit rate, and the termination; then {_restart(bus)}",
        )
    elif state in ("ERROR-PASSIVE", "ERROR-WARNING"):
        yield bad(subject, f"{told}: frames arrive broken", "check the bit rate of every drive, and the termination")
    else:
        yield good(subject, f"up, {bitrate} bit/s, {told}")
    if data.get("restart_ms", 0):
        yield note(
            subject,
            "the controller restarts by itself after bus-off; the drives must not come back unasked",
            f"sudo ip link set {subject} down && sudo ip link set {subject} type can restart-ms 0 && "
            f"sudo ip link set {subject} up",
        )


def _restart(bus: BusDevice) -> str:
    if bus.interface != "socketcan" or bus.channel.startswith("vcan"):
        return remedy_command(bus)
    return (
        f"sudo ip link set {bus.channel} down && "
        f"sudo ip link set {bus.channel} up type can bitrate {bus.bitrate} restart-ms 0"
    )


def _examine_traffic(
    device: Exoskeleton, number: int, bus: can.BusABC, motors: Path | None, *, ask: bool
) -> Iterator[Finding]:
    subject = device.buses[number].channel
    heard = listen(bus)
    if heard.errors:
        yield bad(subject, f"{heard.errors} error frames while listening", "check bit rate and termination")
    if heard.busy:
        yield note(
            subject,
            f"{heard.frames} frames without being asked: another program talks here, so nobody was asked",
            "end the session or the other program, then run this again",
        )
        return
    if not ask:
        yield good(subject, "still; nobody was asked")
        return
    yield from judge_drives(device, number, scan(bus), motors)


def judge_drives(device: Exoskeleton, number: int, found: list[Found], motors: Path | None) -> Iterator[Finding]:
    """Who answered, against who should."""
    table = load_motors(motors)
    names = ("left hip", "left knee", "right hip", "right knee")
    joints = [(name, joint) for name, joint in zip(names, device.joints, strict=True) if joint.can_bus == number]
    answered = {(drive.protocol, drive.drive_id): drive for drive in found}
    ids = Counter(joint.can_id for _, joint in joints)
    for name, joint in joints:
        protocol = _PROTOCOL_NAMES[table.find(joint.motor).protocol]
        drive = answered.pop((protocol, joint.can_id), None)
        if ids[joint.can_id] > 1:
            yield bad(name, f"ID {joint.can_id} is given to two joints", "correct can_id in the device description")
        elif drive is None:
            others = [other for other in found if other.drive_id == joint.can_id]
            yield _silent(name, joint.can_id, protocol, others)
        elif drive.answers > 1:
            yield bad(
                name,
                f"ID {joint.can_id} answers {drive.answers} times: several drives share it",
                "connect the drives one by one and give each its own ID with the maker's tool",
            )
        else:
            yield good(name, f"ID {joint.can_id}, {protocol}, {drive.detail}")
    for drive in answered.values():
        yield note(
            device.buses[number].channel,
            f"{drive.protocol} drive with ID {drive.drive_id} is in nobody's description ({drive.detail})",
            "if it is one of the silent ones, correct can_id, or the drive's ID with the maker's tool",
        )


def _silent(name: str, can_id: int, protocol: str, others: list[Found]) -> Finding:
    if others:
        text = f"ID {can_id} speaks {others[0].protocol}, the device description says {protocol}"
        return bad(name, text, "name the motor entry of that protocol in the device description")
    return bad(
        name,
        f"ID {can_id} does not answer in {protocol}",
        "check its power, its two signal wires, its bit rate, its ID and its mode (MIT) with the maker's tool",
    )
