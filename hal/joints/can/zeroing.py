"""Setting a drive's zero: with the operator's word twice, the joint still, and the effect verified."""

from __future__ import annotations

import math
import secrets
import time
from dataclasses import dataclass

from hal.errors import HardwareError
from hal.joints.can.drive import Station
from hal.joints.can.driver import SocketCanJoints
from hal.joints.codecs.wire import Order
from hal.joints.protocol import DriveState, Joint

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
