"""From unconfigured to enabled and back, and setting a zero: each step is confirmed by the drives' replies."""

from __future__ import annotations

import math
import secrets
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from hal.errors import DrivesFault, HardwareError
from hal.joints.can.drive import Drive
from hal.joints.codecs import damiao, mit
from hal.joints.codecs.wire import NEUTRAL, Order, SetPoint, WireQuantity
from hal.joints.motors import ReplyLayout, WireProtocol
from hal.joints.protocol import DriveFault, DriveState, Joint

if TYPE_CHECKING:
    from hal.joints.can.driver import SocketCanJoints

_REPLY_TIMEOUT_S = 0.15  # a drive answers within a millisecond; a busy host needs the rest
ATTEMPTS = 3

Request = Callable[["SocketCanJoints", Drive], bool]  # whether the bus took it


def probe(joints: SocketCanJoints) -> None:
    """Ask every drive for a reply that moves nothing; read back ranges where the drive reports them.

    Raises HardwareError naming the joints that do not answer or disagree.
    """
    joints.questions = {}
    silent = list(joints.drives)
    for attempt in (*(_by_disabling,) * ATTEMPTS, *(_by_neutral_question,) * 2, *(_by_neutral_entry,) * 2):
        asked, silent = silent, _ask_once(joints, silent, attempt)
        if attempt in _POWERLESS:
            joints.questions |= {drive.joint: attempt for drive in asked if drive not in silent}
    if silent:
        raise _no_reply(joints, silent)
    _forget_questions_of_drives_left_on(joints)
    for drive in joints.drives:
        _check_reply_size(joints, drive)
        _check_ranges(joints, drive)
    if joints.state is DriveState.DISABLED:
        _clear_faults(joints)
    joints.listen(lambda: False, 0.005)  # late answers to the second and third question
    joints.take_bus_fault()


def _forget_questions_of_drives_left_on(joints: SocketCanJoints) -> None:
    """One that answers in motor mode alone, and was in it, answers the order to disable no more."""
    silent = [drive for drive in joints.drives if joints.questions.get(drive.joint) is _by_disabling]
    for _ in range(ATTEMPTS):
        silent = _ask_once(joints, silent, _by_disabling)
    for drive in silent:
        del joints.questions[drive.joint]


def poll(joints: SocketCanJoints) -> None:
    """Ask every drive without power where it is, by the question without effect that it answered at the probe."""
    for drive in joints.drives:
        question = joints.questions.get(drive.joint)
        if question is not None:
            question(joints, drive)


def _clear_faults(joints: SocketCanJoints) -> None:
    """After torque off: some firmware reports a fault until it is cleared. What has not gone is reported again.

    Clearing neither powers nor moves a drive. At the first opening a fault is left to be seen.
    """
    faulted = [drive for drive in joints.drives if drive.faults and not drive.enabled]
    _ask_once(joints, [drive for drive in faulted if drive.codec.order(drive.device.can_id, Order.CLEAR)], _by_clearing)
    _ask_once(joints, faulted, _by_disabling)


def enable(joints: SocketCanJoints) -> None:
    """Neutral, enable, neutral, each confirmed by feedback. Raises HardwareError with all drives disabled."""
    faulted = [drive for drive in joints.drives if drive.faults]
    if faulted:
        raise _faulted(faulted[0], faulted[0].faults)
    for drive in joints.drives:  # of before: whoever still reports a fault has just been refused
        drive.latched = DriveFault.NONE
    _ask_once(joints, list(joints.drives), _by_neutral_command)
    silent = _unanswered(joints, _by_enabling)
    silent += _unanswered_together(joints)
    not_on = [drive for drive in joints.drives if drive.enabled is False and drive not in silent]
    faulted = [drive for drive in joints.drives if drive.latched]
    if silent or not_on or faulted:
        joints.unconfirmed = disable(joints)
        if silent:
            raise _no_reply(joints, silent)
        if faulted:
            raise _faulted(faulted[0], faulted[0].latched)
        raise HardwareError(DrivesFault.STAYS_DISABLED, **not_on[0].identity)


def disable(joints: SocketCanJoints) -> list[Drive]:
    """Damp, take the torque off, wait for each drive's reply; the drives that did not confirm."""
    for drive in joints.drives:
        damping = SetPoint(0.0, 0.0, 0.0, drive.device.damp_nm_s_rad, 0.0)
        joints.send(drive, [drive.command(damping, time.monotonic_ns())])
    joints.listen(lambda: False, 0.004)
    return confirm_off(joints, list(joints.drives))


def confirm_off(joints: SocketCanJoints, waiting: list[Drive]) -> list[Drive]:
    """Take the torque off these drives, wait for each one's reply; the drives that did not confirm.

    A reply that does not say whether its drive is on may be the one to the command before, held up: then the reply to
    a second order counts. Not of a drive that answers no such order once it is off.
    """
    for _ in range(ATTEMPTS):
        asked, waiting = waiting, _ask_once(joints, waiting, _by_disabling)
        unsure = [drive for drive in asked if drive not in waiting and _answers_alike(joints, drive)]
        waiting += _ask_once(joints, unsure, _by_disabling)
        waiting += [drive for drive in joints.drives if drive.enabled and drive not in waiting]
    return waiting


def _answers_alike(joints: SocketCanJoints, drive: Drive) -> bool:
    """Whether a drive's reply to being disabled is the same with power and without."""
    return drive.enabled is None and joints.questions.get(drive.joint) is _by_disabling


def _by_disabling(joints: SocketCanJoints, drive: Drive) -> bool:
    return joints.send(drive, drive.order(Order.DISABLE, time.monotonic_ns()))


def _by_clearing(joints: SocketCanJoints, drive: Drive) -> bool:
    return joints.send(drive, drive.order(Order.CLEAR, time.monotonic_ns()))


def _by_enabling(joints: SocketCanJoints, drive: Drive) -> bool:
    return joints.send(drive, drive.order(Order.ENABLE, time.monotonic_ns()))


def _by_neutral_command(joints: SocketCanJoints, drive: Drive) -> bool:
    return joints.send(drive, [drive.ask(drive.codec.command(drive.device.can_id, NEUTRAL), time.monotonic_ns())])


def _by_neutral_question(joints: SocketCanJoints, drive: Drive) -> bool:
    """For drives without power; not for V3 drives, which it would enable."""
    return drive.model.protocol is not WireProtocol.AK_V3 and _by_neutral_command(joints, drive)


def _by_neutral_entry(joints: SocketCanJoints, drive: Drive) -> bool:
    """The last resort: some firmware answers in motor mode only, so enter it without any gain and leave again."""
    steps = (_by_neutral_command, _by_enabling, _by_neutral_command, _by_disabling)
    asked = [step(joints, drive) for step in steps] if drive.model.protocol is WireProtocol.MIT else []
    return all(asked)


_POWERLESS = (_by_disabling, _by_neutral_question)  # questions that power nothing, for drives without power


def _unanswered(joints: SocketCanJoints, ask: Request) -> list[Drive]:
    """The drives that do not answer, asked several times: one frame may be lost."""
    silent = list(joints.drives)
    for _ in range(ATTEMPTS):
        silent = _ask_once(joints, silent, ask)
    return silent


def _unanswered_together(joints: SocketCanJoints) -> list[Drive]:
    """The drives that do not answer a neutral command to all.

    After a lost frame all are asked again: the wait for one makes the others' answers older than control allows.
    """
    silent = list(joints.drives)
    for _ in range(ATTEMPTS):
        silent = _ask_once(joints, list(joints.drives), _by_neutral_command)
        if not silent:
            break
    return silent


def _ask_once(joints: SocketCanJoints, drives: list[Drive], ask: Request) -> list[Drive]:
    before = {drive.joint: drive.replies for drive in drives}
    asked = {drive.joint for drive in drives if ask(joints, drive)}  # not where the bus refused the question

    def missing() -> list[Drive]:
        return [drive for drive in drives if drive.joint not in asked or drive.replies == before[drive.joint]]

    joints.listen(lambda: not missing(), _REPLY_TIMEOUT_S if drives else 0.0)
    return missing()


def _no_reply(joints: SocketCanJoints, silent: list[Drive]) -> HardwareError:
    silent = list(dict.fromkeys(silent))
    names = tuple(drive.joint for drive in silent)
    ids = ", ".join(str(drive.device.can_id) for drive in silent)
    bus = joints.take_bus_fault()
    if bus is None:
        return HardwareError(DrivesFault.NO_REPLY, joints=names, can_ids=ids)
    return HardwareError(DrivesFault.NO_REPLY_BUS_FAULT, joints=names, can_ids=ids, detail=bus)


def _faulted(drive: Drive, faults: DriveFault) -> HardwareError:
    return HardwareError(DrivesFault.FAULT_BEFORE_ENABLING, **drive.identity, faults=tuple(faults))


def _check_reply_size(joints: SocketCanJoints, drive: Drive) -> None:
    """Raises HardwareError when an MIT drive does not report temperature and error as its entry says: a wrong entry.

    One whose reply to an order differs is asked by a set-point before, as in a session. Whether the bus voltage comes
    does not count: nothing reads it, and bgkatz's firmware sends it or not, by its version.
    """
    if drive.model.protocol is not WireProtocol.MIT or _fits_layout(drive):
        return
    for _ in range(ATTEMPTS):
        _ask_once(joints, [drive], _by_neutral_question)
        if _fits_layout(drive):
            return
    expected = mit.LENGTH_OF[drive.model.reply]
    raise HardwareError(DrivesFault.REPLY_SIZE_MISMATCH, **drive.identity, size=drive.reply_size, expected=expected)


def _fits_layout(drive: Drive) -> bool:
    reports_errors = drive.reply_size == mit.LENGTH_OF[ReplyLayout.TEMPERATURE]
    return reports_errors == (drive.model.reply is ReplyLayout.TEMPERATURE)


def _check_ranges(joints: SocketCanJoints, drive: Drive) -> None:
    """Damiao drives report their ranges; raises HardwareError when they don't, or when these are not the table's."""
    if drive.model.protocol is not WireProtocol.DAMIAO:
        return
    wanted = {
        damiao.Register.POSITION_MAX: (WireQuantity.ANGLE, drive.model.position_rad),
        damiao.Register.VELOCITY_MAX: (WireQuantity.SPEED, drive.model.velocity_rad_s),
        damiao.Register.TORQUE_MAX: (WireQuantity.TORQUE, drive.model.torque_nm),
        damiao.Register.CONTROL_MODE: (WireQuantity.CONTROL_MODE, float(damiao.MIT_MODE)),
    }
    reported = joints.registers(drive, tuple(wanted))
    if not reported:
        raise HardwareError(DrivesFault.RANGES_UNREPORTED, **drive.identity)
    for register, (quantity, expected) in wanted.items():
        if register in reported and not math.isclose(reported[register], expected, rel_tol=0.01):
            raise HardwareError(
                DrivesFault.RANGE_MISMATCH,
                **drive.identity,
                quantity=quantity,
                value=reported[register],
                expected=expected,
            )


CONFIRM_WITHIN_S = 30.0
STILL_FOR_S = 1.0
STILL_WITHIN_RAD = math.radians(0.5)
STILL_SPEED_RAD_S = 0.1
TAKES_EFFECT_S = 1.5  # CubeMars drives act on it after 0.5 to 1.5 s, and write it to flash
ZERO_WITHIN_RAD = math.radians(1.0)
LOSE_ZERO = frozenset({WireProtocol.AK_V3, WireProtocol.CYBERGEAR})  # keep it until power-off only


@dataclass(frozen=True, slots=True)
class ZeroRequest:
    """What the operator confirms by giving `code` back in time."""

    joint: Joint
    angle_rad: float
    code: str
    at_s: float


def request_zero(joints: SocketCanJoints, joint: Joint) -> ZeroRequest:
    """Watch the joint be still; the request names its present angle. Raises HardwareError when it moves or is on."""
    drive = _idle_drive(joints, joint)
    angle_rad = _watch_still(joints, drive)
    return ZeroRequest(joint, angle_rad, secrets.token_hex(2), time.monotonic())


def set_zero(joints: SocketCanJoints, request: ZeroRequest, code: str, permit: Callable[[], object]) -> float:
    """Make the present angle the joint's zero offset, and verify it; the drive's own new angle, radians.

    permit: called right before the drive is asked; raises when it may not be.
    Raises HardwareError when the code is wrong or late, the joint has moved, or the drive did not take the zero.
    """
    if code != request.code:
        raise HardwareError(DrivesFault.ZERO_WRONG_CODE)
    if time.monotonic() - request.at_s > CONFIRM_WITHIN_S:
        raise HardwareError(DrivesFault.ZERO_TOO_LATE, limit_s=CONFIRM_WITHIN_S)
    drive = _idle_drive(joints, request.joint)
    if abs(_watch_still(joints, drive) - request.angle_rad) > STILL_WITHIN_RAD:
        raise HardwareError(DrivesFault.ZERO_MOVED, **drive.identity)
    permit()
    joints.send(drive, drive.order(Order.ZERO, time.monotonic_ns()))
    return _verify(joints, drive)


def _idle_drive(joints: SocketCanJoints, joint: Joint) -> Drive:
    if joints.state is not DriveState.PROBED:
        raise HardwareError(DrivesFault.ZERO_ENABLED)
    return joints.drives[joint]


def _poll(joints: SocketCanJoints, drive: Drive) -> float:
    """The joint's angle by a fresh answer. Raises HardwareError when it is silent."""
    before = drive.replies
    for _ in range(3):
        joints.send(drive, drive.order(Order.DISABLE, time.monotonic_ns()))
        if joints.listen(lambda: drive.replies > before, 0.1):
            return drive.position_rad
    raise HardwareError(DrivesFault.ZERO_NO_REPLY, **drive.identity)


def _watch_still(joints: SocketCanJoints, drive: Drive) -> float:
    first_rad = _poll(joints, drive)
    end_s = time.monotonic() + STILL_FOR_S
    while time.monotonic() < end_s:
        angle_rad = _poll(joints, drive)
        if abs(angle_rad - first_rad) > STILL_WITHIN_RAD or abs(drive.velocity_rad_s) > STILL_SPEED_RAD_S:
            raise HardwareError(DrivesFault.ZERO_MOVING, **drive.identity)
        joints.listen(lambda: False, 0.02)
    return first_rad


def _verify(joints: SocketCanJoints, drive: Drive) -> float:
    wanted_rad = drive.transmission.zero_offset_rad
    end_s = time.monotonic() + 2 * TAKES_EFFECT_S
    while time.monotonic() < end_s:
        angle_rad = _poll(joints, drive)
        if abs(angle_rad - wanted_rad) <= ZERO_WITHIN_RAD:
            return angle_rad
        joints.listen(lambda: False, 0.05)
    raise HardwareError(DrivesFault.ZERO_NOT_TAKEN, **drive.identity, angle_rad=drive.position_rad)
