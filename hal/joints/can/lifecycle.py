"""From unconfigured to enabled and back: each step is confirmed by the drives' replies."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

from hal.errors import DrivesFault, HardwareError
from hal.joints.can.drive import Drive
from hal.joints.codecs import damiao, mit
from hal.joints.codecs.wire import NEUTRAL, Order, SetPoint, WireQuantity
from hal.joints.motors import ReplyLayout, WireProtocol
from hal.joints.protocol import LEFT_ON_DAMPING_S, DriveFault, DriveState

if TYPE_CHECKING:
    from hal.joints.can.driver import SocketCanJoints

_REPLY_TIMEOUT_S = 0.15  # a drive answers within a millisecond; a busy host needs the rest
ATTEMPTS = 3
# Drives with a watchdog of their own go limp without commands, the mini-cheetah's after 25 ms. More often, and their
# replies would vote on the ranges: at this rate too coarse for it (`range_check`).
_LEFT_ON_PERIOD_S = 0.02

Request = Callable[["SocketCanJoints", Drive], bool]  # whether the bus took it


def damp_left_on(joints: SocketCanJoints, drives: Iterable[Drive]) -> None:
    """Damp those of these drives that a dead session or an unconfirmed end may have left stiff, before torque off.

    Not drives that any set-point would power. Others that are off stay off, and need not answer; but what one answers
    is waited for: held up, it would look like the answer to the next question.
    """
    drives = [drive for drive in drives if not drive.codec.traits.enabled_by_command]
    before = {drive.joint: drive.replies for drive in drives}
    times = round(LEFT_ON_DAMPING_S / _LEFT_ON_PERIOD_S) if drives else 0
    for _ in range(times):
        for drive in drives:
            _damp(joints, drive)
        joints.listen(lambda: False, _LEFT_ON_PERIOD_S)
    joints.listen(lambda: all(drive.replies - before[drive.joint] in {0, times} for drive in drives), _REPLY_TIMEOUT_S)


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
        drive.latched, drive.silent_commands = DriveFault.NONE, 0
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
        _damp(joints, drive)
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


def _damp(joints: SocketCanJoints, drive: Drive) -> None:
    damping = SetPoint(0.0, 0.0, 0.0, drive.device.damp_nm_s_rad, 0.0)
    joints.send(drive, [drive.command(damping)])


def _answers_alike(joints: SocketCanJoints, drive: Drive) -> bool:
    """Whether a drive's reply to being disabled is the same with power and without."""
    return drive.enabled is None and joints.questions.get(drive.joint) is _by_disabling


def _by_disabling(joints: SocketCanJoints, drive: Drive) -> bool:
    return joints.send(drive, drive.order(Order.DISABLE))


def _by_clearing(joints: SocketCanJoints, drive: Drive) -> bool:
    return joints.send(drive, drive.order(Order.CLEAR))


def _by_enabling(joints: SocketCanJoints, drive: Drive) -> bool:
    return joints.send(drive, drive.order(Order.ENABLE))


def _by_neutral_command(joints: SocketCanJoints, drive: Drive) -> bool:
    return joints.send(drive, [drive.ask(drive.codec.command(drive.device.can_id, NEUTRAL))])


def _by_neutral_question(joints: SocketCanJoints, drive: Drive) -> bool:
    """For drives without power; not for those that it would enable."""
    return not drive.codec.traits.enabled_by_command and _by_neutral_command(joints, drive)


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
