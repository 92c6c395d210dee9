"""Setting a joint's zero offset: asked for, confirmed by the operator's code, and read back from the drive."""

from __future__ import annotations

import math
import secrets
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from hal.errors import DrivesFault, HardwareError
from hal.joints.can.drive import Drive
from hal.joints.codecs.wire import Order
from hal.joints.protocol import DriveState, Joint

if TYPE_CHECKING:
    from hal.joints.can.driver import SocketCanJoints

CONFIRM_WITHIN_S = 30.0
STILL_FOR_S = 1.0
STILL_WITHIN_RAD = math.radians(0.5)
STILL_SPEED_RAD_S = 0.1
TAKES_EFFECT_S = 1.5  # CubeMars drives act on it after 0.5 to 1.5 s, and write it to flash
REPLY_WITHIN_S = 0.5  # a drive takes milliseconds; a busy computer may take longer to ask and to look
ZERO_WITHIN_RAD = math.radians(1.0)
UNCHANGED_WITHIN_RAD = math.radians(0.2)  # where the angle has not shown that the zero was taken


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
    before_rad = _watch_still(joints, drive)
    if abs(before_rad - request.angle_rad) > STILL_WITHIN_RAD:
        raise HardwareError(DrivesFault.ZERO_MOVED, **drive.identity)
    permit()
    joints.send(drive, drive.order(Order.ZERO))
    return _verify(joints, drive, before_rad)


def _idle_drive(joints: SocketCanJoints, joint: Joint) -> Drive:
    if joints.state is not DriveState.PROBED:
        raise HardwareError(DrivesFault.ZERO_ENABLED)
    return joints.drives[joint]


def _poll(joints: SocketCanJoints, drive: Drive) -> float:
    """The joint's angle by a fresh answer. Raises HardwareError when it is silent."""
    before = drive.replies
    for _ in range(3):
        joints.send(drive, drive.order(Order.DISABLE))
        if joints.listen(lambda: drive.replies > before, REPLY_WITHIN_S):
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


def _verify(joints: SocketCanJoints, drive: Drive, before_rad: float) -> float:
    """A joint that stood near its zero reads nearly the same if the drive ignores it: then the time must be over."""
    wanted_rad, begin_s = drive.transmission.zero_offset_rad, time.monotonic()
    waited_s = 0.0
    while waited_s < 2 * TAKES_EFFECT_S:
        waited_s = time.monotonic() - begin_s
        angle_rad = _poll(joints, drive)
        changed = abs(angle_rad - before_rad) >= 0.5 * abs(wanted_rad - before_rad)
        within_rad = ZERO_WITHIN_RAD if changed else max(UNCHANGED_WITHIN_RAD, _quantum_rad(drive))
        if abs(angle_rad - wanted_rad) <= within_rad and (changed or waited_s >= TAKES_EFFECT_S):
            return angle_rad
        joints.listen(lambda: False, 0.05)
    raise HardwareError(DrivesFault.ZERO_NOT_TAKEN, **drive.identity, angle_rad=drive.position_rad)


def _quantum_rad(drive: Drive) -> float:
    """What an angle on the wire can resolve, at the joint: 16 bits of the range, or 0.1 degrees in servo mode."""
    return max(2 * drive.model.position_rad / 0xFFFF, math.radians(0.1)) / abs(drive.transmission.ratio)
