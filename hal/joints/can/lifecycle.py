"""From unconfigured to enabled and back, and setting a zero: each step is confirmed by the drives' replies."""

from __future__ import annotations

import math
import secrets
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from hal.errors import HardwareError
from hal.joints.can.drive import Station
from hal.joints.codecs import damiao
from hal.joints.codecs.wire import NEUTRAL, Order, SetPoint
from hal.joints.motors import WireProtocol
from hal.joints.protocol import DriveState, Joint

if TYPE_CHECKING:
    from hal.joints.can.driver import SocketCanJoints

_PATIENCE_S = 0.15  # a drive answers within a millisecond; a busy host needs the rest
_ATTEMPTS = 3

Ask = Callable[["SocketCanJoints", Station], None]


def check_wire_range(station: Station) -> None:
    """The joint's limits must fit into the motor's wire format. Raises HardwareError with the numbers."""
    device, model = station.device, station.model
    ends = (station.transmission.angle_to_motor(math.radians(degrees)) for degrees in (device.min_deg, device.max_deg))
    extreme = station.transmission.to_motor(
        SetPoint(
            0.0,
            math.radians(device.max_speed_deg_s),
            device.max_stiffness_nm_rad,
            device.max_damping_nm_s_rad,
            device.max_torque_nm,
        )
    )
    rows = (
        ("angle", max(map(abs, ends)), model.position_rad, "rad"),
        ("speed", abs(extreme.velocity_rad_s), model.velocity_rad_s, "rad/s"),
        ("stiffness", extreme.stiffness_nm_rad, model.stiffness_nm_rad, "Nm/rad"),
        ("damping", extreme.damping_nm_s_rad, model.damping_nm_s_rad, "Nm·s/rad"),
        ("torque", abs(extreme.torque_nm), model.torque_nm, "Nm"),
    )
    for what, needed, carried, unit in rows:
        if needed > carried * (1 + 1e-9):
            raise HardwareError(
                f"The {station.name}: its largest {what} is {needed:.1f} {unit} at the motor, but the wire carries "
                f"{carried:.1f}; lower the limit in the device description or name another motor entry."
            )


def probe(joints: SocketCanJoints) -> tuple[str, ...]:
    """Ask every drive for a heartbeat that moves nothing; read back ranges where the drive can tell.

    Returns notes for people. Raises HardwareError naming the first joint that does not answer or disagrees.
    """
    silent = list(joints.stations)
    for attempt in (_by_disabling, _by_neutral_command, _by_neutral_entry):
        for _ in range(_ATTEMPTS - 1):
            asked, silent = silent, _still_silent(joints, silent, attempt)
            if attempt in _HARMLESS:
                joints.questions |= {station.joint: attempt for station in asked if station not in silent}
    if silent:
        raise HardwareError(_silence(joints, silent))
    notes = [note for station in joints.stations for note in _read_back(joints, station)]
    joints.listen(lambda: False, 0.005)  # late answers to the second and third question
    joints.bus_sentence()
    return tuple(notes)


def look(joints: SocketCanJoints) -> None:
    """Ask every drive without power where it is, by the harmless question that it answered at the probe."""
    for station in joints.stations:
        question = joints.questions.get(station.joint)
        if question is not None:
            question(joints, station)


def enable(joints: SocketCanJoints) -> None:
    """Neutral, enable, neutral, each confirmed by feedback. Raises HardwareError with all drives disabled."""
    faulted = [station for station in joints.stations if station.faults]
    if faulted:
        raise HardwareError(_fault_sentence(faulted[0]))
    _still_silent(joints, list(joints.stations), _by_neutral_command)
    silent = _silent_for_good(joints, _by_enabling)
    silent += _silent_for_good(joints, _by_neutral_command)
    not_on = [station for station in joints.stations if station.enabled is False and station not in silent]
    faulted = [station for station in joints.stations if station.faults]
    if silent or not_on or faulted:
        disable(joints)
        if silent:
            raise HardwareError(_silence(joints, silent))
        if faulted:
            raise HardwareError(_fault_sentence(faulted[0]))
        raise HardwareError(f"The {not_on[0].name} answers but stays disabled: check its mode and its supply.")


def disable(joints: SocketCanJoints) -> list[Station]:
    """Damp, take the torque off, wait for each drive's word; the stations that did not confirm."""
    for station in joints.stations:
        damping = SetPoint(0.0, 0.0, 0.0, station.device.damp_nm_s_rad, 0.0)
        joints.send(station, [station.command(damping, joints.now_ns())])
    joints.listen(lambda: False, 0.004)
    waiting = list(joints.stations)
    for _ in range(_ATTEMPTS):
        waiting = _still_silent(joints, waiting, _by_disabling)
        waiting += [station for station in joints.stations if station.enabled and station not in waiting]
    return waiting


def _by_disabling(joints: SocketCanJoints, station: Station) -> None:
    joints.send(station, station.order(Order.DISABLE, joints.now_ns()))


def _by_enabling(joints: SocketCanJoints, station: Station) -> None:
    joints.send(station, station.order(Order.ENABLE, joints.now_ns()))


def _by_neutral_command(joints: SocketCanJoints, station: Station) -> None:
    joints.send(station, [station.ask(station.codec.command(station.device.can_id, NEUTRAL), joints.now_ns())])


def _by_neutral_entry(joints: SocketCanJoints, station: Station) -> None:
    """The last resort: some firmware speaks in motor mode only, so enter it without any gain and leave again."""
    if station.model.protocol is WireProtocol.MIT:
        for step in (_by_neutral_command, _by_enabling, _by_neutral_command, _by_disabling):
            step(joints, station)


_HARMLESS = (_by_disabling, _by_neutral_command)  # questions that power nothing, for drives without power


def _silent_for_good(joints: SocketCanJoints, ask: Ask) -> list[Station]:
    """Who does not answer, asked several times: one lost frame is no silence."""
    silent = list(joints.stations)
    for _ in range(_ATTEMPTS):
        silent = _still_silent(joints, silent, ask)
    return silent


def _still_silent(joints: SocketCanJoints, stations: list[Station], ask: Ask) -> list[Station]:
    before = {station.joint: station.answered for station in stations}
    for station in stations:
        ask(joints, station)

    def missing() -> list[Station]:
        return [station for station in stations if station.answered == before[station.joint]]

    joints.listen(lambda: not missing(), _PATIENCE_S if stations else 0.0)
    return missing()


def _silence(joints: SocketCanJoints, silent: list[Station]) -> str:
    names = ", ".join(station.name for station in silent)
    bus = joints.bus_sentence()
    return (
        f"No answer from {names}{f' ({bus})' if bus else ''}: check power, ID, bit rate and termination, "
        f"or run `rleex can doctor`."
    )


def _fault_sentence(station: Station) -> str:
    fault = (station.faults.name or str(station.faults)).lower().replace("_", " ")
    return f"The {station.name} reports {fault}: find the cause and clear it before enabling."


def _read_back(joints: SocketCanJoints, station: Station) -> list[str]:
    """Damiao drives tell their ranges; raises HardwareError when they are not the table's."""
    if station.model.protocol is not WireProtocol.DAMIAO:
        return []
    wanted = {
        damiao.Register.POSITION_MAX: ("position range, rad", station.model.position_rad),
        damiao.Register.VELOCITY_MAX: ("velocity range, rad/s", station.model.velocity_rad_s),
        damiao.Register.TORQUE_MAX: ("torque range, Nm", station.model.torque_nm),
        damiao.Register.CONTROL_MODE: ("control mode (1 = MIT)", float(damiao.MIT_MODE)),
    }
    told = joints.registers(station, tuple(wanted))
    for register, (what, expected) in wanted.items():
        if register in told and not math.isclose(told[register], expected, rel_tol=0.01):
            raise HardwareError(
                f"The {station.name} says its {what} is {told[register]:g}, the motor table says {expected:g}: name "
                f"the entry that fits in the device description, or set the drive."
            )
    return [] if told else [f"{station.name} does not tell its ranges: they are the table's word only"]


CONFIRM_WITHIN_S = 30.0
STILL_FOR_S = 1.0
STILL_WITHIN_RAD = math.radians(0.5)
STILL_SPEED_RAD_S = 0.1
TAKES_EFFECT_S = 1.5  # CubeMars drives act on it after 0.5 to 1.5 s, and write it to flash
ZERO_WITHIN_RAD = math.radians(1.0)


@dataclass(frozen=True, slots=True)
class ZeroRequest:
    """The operator's first word; the second is to give it back in time."""

    joint: Joint
    angle_rad: float
    word: str
    at_s: float


def ask_zero(joints: SocketCanJoints, joint: Joint) -> ZeroRequest:
    """Watch the joint be still; the request names its present angle. Raises HardwareError when it moves or is on."""
    station = _idle_station(joints, joint)
    angle_rad = _watch_still(joints, station)
    return ZeroRequest(joint, angle_rad, secrets.token_hex(2), time.monotonic())


def set_zero(joints: SocketCanJoints, request: ZeroRequest, word: str) -> float:
    """Make the present angle the joint's zero offset, and verify it; the drive's own new angle, radians.

    Raises HardwareError when the second word is wrong or late, the joint has moved, or the drive did not obey.
    """
    if word != request.word:
        raise HardwareError("The second word was not the one shown: nothing was changed.")
    if time.monotonic() - request.at_s > CONFIRM_WITHIN_S:
        raise HardwareError(f"The second word came after more than {CONFIRM_WITHIN_S:.0f} s: ask again.")
    station = _idle_station(joints, request.joint)
    if abs(_watch_still(joints, station) - request.angle_rad) > STILL_WITHIN_RAD:
        raise HardwareError(f"The {station.name} has moved since you asked: nothing was changed.")
    joints.send(station, station.order(Order.ZERO, joints.now_ns()))
    return _verify(joints, station)


def _idle_station(joints: SocketCanJoints, joint: Joint) -> Station:
    if joints.state is not DriveState.PROBED:
        raise HardwareError("Set zeros with the joints open and not enabled: firmware ignores it in motor mode.")
    return joints.stations[joint]


def _poll(joints: SocketCanJoints, station: Station) -> float:
    """The joint's angle by a fresh answer. Raises HardwareError when it is silent."""
    before = station.answered
    for _ in range(3):
        joints.send(station, station.order(Order.DISABLE, joints.now_ns()))
        if joints.listen(lambda: station.answered > before, 0.1):
            return station.position_rad
    raise HardwareError(f"No answer from the {station.name}: nothing can be said about its zero.")


def _watch_still(joints: SocketCanJoints, station: Station) -> float:
    first_rad = _poll(joints, station)
    end_s = time.monotonic() + STILL_FOR_S
    while time.monotonic() < end_s:
        angle_rad = _poll(joints, station)
        if abs(angle_rad - first_rad) > STILL_WITHIN_RAD or abs(station.velocity_rad_s) > STILL_SPEED_RAD_S:
            raise HardwareError(f"The {station.name} moves: hold it still while its zero is set.")
        joints.listen(lambda: False, 0.02)
    return first_rad


def _verify(joints: SocketCanJoints, station: Station) -> float:
    wanted_rad = station.transmission.zero_offset_rad
    end_s = time.monotonic() + 2 * TAKES_EFFECT_S
    while time.monotonic() < end_s:
        angle_rad = _poll(joints, station)
        if abs(angle_rad - wanted_rad) <= ZERO_WITHIN_RAD:
            return angle_rad
        joints.listen(lambda: False, 0.05)
    raise HardwareError(
        f"The {station.name} still reports {math.degrees(station.position_rad):.1f}°: it did not take the zero; "
        f"switch its power off and on, or use the maker's tool."
    )
