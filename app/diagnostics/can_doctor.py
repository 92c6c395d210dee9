"""Why a CAN bus or a drive is silent, each finding with the command that repairs it."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections import Counter
from collections.abc import Iterator
from enum import Enum
from pathlib import Path
from typing import Any

import can

from app.diagnostics.doctor_codes import run
from app.diagnostics.findings import Finding, bad, good, note
from hal.errors import HardwareError
from hal.joints.can.bus import open_bus, remedy_command
from hal.joints.can.scan import FoundDrive, listen, scan
from hal.joints.codecs import CODECS
from hal.joints.device import SHARING_INTERFACES, UNSHARED_INTERFACES, BusDevice, Exoskeleton
from hal.joints.motors import WireProtocol, load_motors
from hal.joints.protocol import Joint
from logs.reason import Reason, reason, reason_of

_SHORT_QUEUE = 50  # frames; the kernel's default of 10 gives "No buffer space available" at the first hiccup


class CanFinding(Enum):
    """What is found of a bus or a drive."""

    NO_IP_PROGRAM = "no ip program"
    NO_INTERFACE = "no interface"
    DOWN = "down"
    VIRTUAL = "virtual"
    NOT_SHARED = "not shared"
    SHORT_QUEUE = "short queue"
    WRONG_BITRATE = "wrong bit rate"
    BUS_OFF = "bus off"
    NOT_ACKNOWLEDGED = "not acknowledged"
    BROKEN_FRAMES = "broken frames"
    UP = "up"
    RESTARTS_ITSELF = "restarts itself"
    ERROR_FRAMES = "error frames"
    BUSY = "busy"
    QUIET = "quiet"
    SHARED_ID_IN_DEVICE = "shared ID in the device"
    SHARED_ID = "shared ID"
    ANSWERS = "answers"
    UNDESCRIBED = "undescribed"
    OTHER_PROTOCOL = "other protocol"
    OTHER_REPLY_ID = "other reply ID"
    SILENT = "silent"


class CanRemedy(Enum):
    """What to do about it."""

    CHECK_WIRING = "check wiring"
    CHECK_POWER = "check power"
    CHECK_BITRATE = "check bit rate"
    CHECK_BUS = "check bus"
    END_OTHER_PROGRAM = "end the other program"
    CORRECT_CAN_ID = "correct can_id"
    GIVE_OWN_ID = "give each its own ID"
    CORRECT_EITHER_ID = "correct either ID"
    CORRECT_REPLY_ID = "correct the reply ID"
    CORRECT_MOTOR = "correct the motor"
    CORRECT_MOTOR_TABLE = "correct the motor table"
    CHECK_DRIVE = "check the drive"
    USE_SOCKETCAN = "use SocketCAN"


F, R = CanFinding, CanRemedy


def examine(device: Exoskeleton, motors: Path | None, *, ask: bool = True) -> Iterator[Finding]:
    """Check each bus from the interface up to the drives; `ask` False only listens."""
    for number, bus in enumerate(device.buses):
        subject = bus.channel
        if bus.interface == "socketcan":
            link = read_link(bus.channel)
            if link is None:
                yield note(subject, reason(F.NO_IP_PROGRAM), run("sudo apt install iproute2"))
            else:
                yield from evaluate_link(link, bus)
                if not link or not is_up(link):
                    continue
        if bus.interface not in SHARING_INTERFACES:
            grade = bad if bus.interface in UNSHARED_INTERFACES else note
            yield grade(subject, reason(F.NOT_SHARED, interface=bus.interface), reason(R.USE_SOCKETCAN))
        try:
            opened = open_bus(bus)
        except HardwareError as error:
            yield bad(subject, reason_of(error), _run(remedy_command(bus)))
            continue
        try:
            yield from _examine_traffic(device, number, opened, motors, ask=ask)
        except HardwareError as error:
            yield bad(subject, reason_of(error), _run(_restart(bus)))
        finally:
            opened.shutdown()


def _run(command: str) -> Reason | None:
    """Interfaces besides the kernel's have no command."""
    return run(command) if command else None


def read_link(channel: str) -> dict[str, Any] | None:
    """What the kernel reports of an interface, from `ip`; empty when there is none, None without that program."""
    program = shutil.which("ip") or shutil.which("ip", path="/usr/sbin:/sbin")
    if program is None:
        return None
    command = [program, "-details", "-statistics", "-json", "link", "show", channel]
    done = subprocess.run(command, capture_output=True, check=False, timeout=5)
    try:
        links = json.loads(done.stdout or b"[]")
    except ValueError:
        return {}
    return links[0] if links else {}


def is_up(link: dict[str, Any]) -> bool:
    """Whether the interface is up."""
    return "UP" in link.get("flags", ())


def evaluate_link(link: dict[str, Any], bus: BusDevice) -> Iterator[Finding]:
    """What the kernel's report on the interface means."""
    subject = bus.channel
    if not link:
        yield bad(subject, reason(F.NO_INTERFACE), run(remedy_command(bus)))
        return
    if not is_up(link):
        yield bad(subject, reason(F.DOWN), run(remedy_command(bus, exists=True)))
        return
    kind = link.get("linkinfo", {}).get("info_kind", "")
    if kind in ("vcan", "vxcan"):
        yield good(subject, F.VIRTUAL)
        return
    yield from _evaluate_controller(link.get("linkinfo", {}).get("info_data", {}), bus)
    if link.get("txqlen", 1000) < _SHORT_QUEUE:
        short = reason(F.SHORT_QUEUE, frames=link["txqlen"])
        yield note(subject, short, run(f"sudo ip link set {subject} txqueuelen 1000"))


def _evaluate_controller(data: dict[str, Any], bus: BusDevice) -> Iterator[Finding]:
    subject, state = bus.channel, data.get("state", "?")
    bitrate, restart = data.get("bittiming", {}).get("bitrate"), _restart(bus)
    if bitrate != bus.bitrate:
        wrong = reason(F.WRONG_BITRATE, bitrate=str(bitrate), described=bus.bitrate)
        yield bad(subject, wrong, run(restart))
    sent, received = (data.get("berr_counter", {}).get(name, 0) for name in ("tx", "rx"))
    counters = {"state": state, "sent": sent, "received": received}
    if state == "BUS-OFF":
        yield bad(subject, reason(F.BUS_OFF, **counters), reason(R.CHECK_WIRING, command=restart))
    elif state in ("ERROR-PASSIVE", "ERROR-WARNING") and sent > received:
        yield bad(subject, reason(F.NOT_ACKNOWLEDGED, **counters), reason(R.CHECK_POWER, command=restart))
    elif state in ("ERROR-PASSIVE", "ERROR-WARNING"):
        yield bad(subject, reason(F.BROKEN_FRAMES, **counters), reason(R.CHECK_BITRATE))
    else:
        yield good(subject, F.UP, bitrate=str(bitrate), **counters)
    if data.get("restart_ms", 0):
        command = f"sudo ip link set {subject} down && sudo ip link set {subject} type can restart-ms 0 && "
        yield note(subject, reason(F.RESTARTS_ITSELF), run(f"{command}sudo ip link set {subject} up"))


def _restart(bus: BusDevice) -> str:
    if bus.interface != "socketcan" or bus.channel.startswith("vcan"):
        return remedy_command(bus, exists=True)
    return (
        f"sudo ip link set {bus.channel} down && "
        f"sudo ip link set {bus.channel} up type can bitrate {bus.bitrate} restart-ms 0"
    )


def _examine_traffic(
    device: Exoskeleton, number: int, bus: can.BusABC, motors: Path | None, *, ask: bool
) -> Iterator[Finding]:
    subject = device.buses[number].channel
    traffic = listen(bus)
    if traffic.errors:
        yield bad(subject, reason(F.ERROR_FRAMES, frames=traffic.errors), reason(R.CHECK_BUS))
    if traffic.busy:
        yield note(subject, reason(F.BUSY, frames=traffic.frames), reason(R.END_OTHER_PROGRAM))
        return
    if not ask:
        yield good(subject, F.QUIET)
        return
    found = scan(bus, uploads=traffic.uploads)
    try:
        yield from evaluate_drives(device, number, found, motors)
    except HardwareError as error:
        yield bad(subject, reason_of(error), reason(R.CORRECT_MOTOR_TABLE))


def evaluate_drives(
    device: Exoskeleton, number: int, found: list[FoundDrive], motors: Path | None
) -> Iterator[Finding]:
    """The drives that answered, against those described."""
    table = load_motors(motors)
    joints = [(joint, made) for joint, made in zip(Joint, device.joints, strict=True) if made.can_bus == number]
    answered = {(drive.protocol, drive.drive_id): drive for drive in found}
    ids = Counter(made.can_id for _, made in joints)
    for joint, made in joints:
        wire = table.find(made.motor).protocol
        protocol, reply_id = CODECS[wire].traits.scan_name, f"{made.reply_id:03X}"
        drive = answered.pop((protocol, made.can_id), None)
        if ids[made.can_id] > 1:
            yield bad(joint, reason(F.SHARED_ID_IN_DEVICE, can_id=made.can_id), reason(R.CORRECT_CAN_ID))
        elif drive is None:
            others = [other for other in found if other.drive_id == made.can_id]
            yield _silent(joint, made.can_id, protocol, others)
        elif drive.answers > 1:
            shared = reason(F.SHARED_ID, can_id=made.can_id, answers=drive.answers)
            yield bad(joint, shared, reason(R.GIVE_OWN_ID))
        elif wire is WireProtocol.DAMIAO and drive.values["identifier"] != reply_id:
            other = reason(F.OTHER_REPLY_ID, can_id=made.can_id, described=reply_id, **drive.values)
            yield bad(joint, other, reason(R.CORRECT_REPLY_ID))
        else:
            yield good(joint, F.ANSWERS, can_id=made.can_id, protocol=protocol, detail=reason_of(drive))
    for drive in answered.values():
        unknown = reason(F.UNDESCRIBED, protocol=drive.protocol, can_id=drive.drive_id, detail=reason_of(drive))
        yield note(device.buses[number].channel, unknown, reason(R.CORRECT_EITHER_ID))


def _silent(joint: Joint, can_id: int, protocol: str, others: list[FoundDrive]) -> Finding:
    if others:
        other = reason(F.OTHER_PROTOCOL, can_id=can_id, protocol=others[0].protocol, described=protocol)
        return bad(joint, other, reason(R.CORRECT_MOTOR))
    return bad(joint, reason(F.SILENT, can_id=can_id, protocol=protocol), reason(R.CHECK_DRIVE))
