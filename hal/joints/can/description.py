"""Whether drives and buses can carry a device description, before anything is sent."""

from __future__ import annotations

import math
from itertools import permutations

from hal.errors import DeviceFault, HardwareError
from hal.joints.can.bus import LOAD_LIMIT, bus_load, frame_bits
from hal.joints.can.drive import Drive
from hal.joints.codecs import damiao
from hal.joints.codecs.wire import NEUTRAL, SetPoint, WireQuantity
from hal.joints.device import BusDevice, Exoskeleton
from hal.joints.guard import RANGE_MARGIN_RAD, SPEED_MARGIN, TORQUE_MARGIN
from hal.joints.motors import WireProtocol


def check_description(device: Exoskeleton, drives: tuple[Drive, ...]) -> None:
    """Raises HardwareError when these drives, or the buses, can't carry this device."""
    for drive in drives:
        if not 0 <= drive.device.can_bus < len(device.buses):
            values = {"bus": drive.device.can_bus, "count": len(device.buses)}
            raise HardwareError(DeviceFault.NO_SUCH_BUS, **drive.identity, **values)
        _check_wire_range(drive)
    for number, bus in enumerate(device.buses):
        on_bus = [drive for drive in drives if drive.device.can_bus == number]
        _check_load(bus, on_bus)
        _check_identifiers(on_bus)


def _check_wire_range(drive: Drive) -> None:
    """The joint's limits must fit into the motor's wire format. Raises HardwareError with the numbers.

    With the margins from which control's events act: a reading that ends below them would never show too much.
    """
    device, model = drive.device, drive.model
    ends = (math.radians(device.min_deg) - RANGE_MARGIN_RAD, math.radians(device.max_deg) + RANGE_MARGIN_RAD)
    extreme = drive.transmission.to_motor(
        SetPoint(
            0.0,
            math.radians(device.max_speed_deg_s) * SPEED_MARGIN,
            device.max_stiffness_nm_rad,
            device.max_damping_nm_s_rad,
            device.max_torque_nm * TORQUE_MARGIN,
        )
    )
    rows = (
        (WireQuantity.ANGLE, max(abs(drive.transmission.angle_to_motor(end)) for end in ends), model.position_rad),
        (WireQuantity.SPEED, abs(extreme.velocity_rad_s), model.velocity_rad_s),
        (WireQuantity.STIFFNESS, extreme.stiffness_nm_rad, model.stiffness_nm_rad),
        (WireQuantity.DAMPING, extreme.damping_nm_s_rad, model.damping_nm_s_rad),
        (WireQuantity.TORQUE, abs(extreme.torque_nm), model.torque_nm),
    )
    for quantity, needed, limit in rows:
        if needed > limit * (1 + 1e-9):
            values = {"quantity": quantity, "value": needed, "limit": limit}
            raise HardwareError(DeviceFault.BEYOND_WIRE_RANGE, **drive.identity, **values)


def _check_load(bus: BusDevice, drives: list[Drive]) -> None:
    """Raises HardwareError where a command and a reply of each drive in each tick fill the bus beyond the limit."""
    commands = [drive.codec.command(drive.device.can_id, NEUTRAL) for drive in drives]
    load = bus_load([frame_bits(8, extended=frame.extended) * 2 for frame in commands], bitrate=bus.bitrate)
    if load > LOAD_LIMIT:
        values = {"bus": bus.channel, "load": load, "drives": len(drives), "bitrate": bus.bitrate, "limit": LOAD_LIMIT}
        raise HardwareError(DeviceFault.BUS_OVERLOADED, **values)


# What is on its own standard identifier a drive takes for a command, whoever sent it (bgkatz/motorcontrol
# stm32f4xx_it.c). At rest a reply reads as the full stiffness towards a far angle.
_Identifier = tuple[WireProtocol | None, int]  # None: a standard one; extended ones of two protocols never meet


def _check_identifiers(drives: list[Drive]) -> None:
    """Raises HardwareError where a drive would take another one's commands or replies for its own commands."""
    for drive, other in permutations(drives, 2):
        for _, identifier in _obeyed(drive) & ({_own(other)} | _replied(other)):
            values = {"other": other.joint, "identifier": identifier}
            raise HardwareError(DeviceFault.IDENTIFIER_TAKEN, **drive.identity, **values)


def _own(drive: Drive) -> _Identifier:
    commanding = drive.codec.command(drive.device.can_id, NEUTRAL)
    return (drive.model.protocol, drive.device.can_id) if commanding.extended else (None, commanding.arbitration_id)


def _obeyed(drive: Drive) -> set[_Identifier]:
    shared = {(None, damiao.REGISTER_ID)} if drive.model.protocol is WireProtocol.DAMIAO else set()
    return {_own(drive)} | shared


def _replied(drive: Drive) -> set[_Identifier]:
    return {(None, drive.device.reply_id)} if drive.codec.traits.standard_replies else set()
