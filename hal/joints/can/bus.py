"""Opening CAN buses through python-can, what its errors mean, and how full a bus will be."""

from __future__ import annotations

import errno
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import can
import msgspec

from hal.errors import HardwareError
from hal.joints.can.local_bus import LocalBus
from hal.joints.codecs.wire import Frame
from hal.joints.device import BusDevice, Exoskeleton
from hal.joints.protocol import TICK_HZ, BusFault

LOAD_LIMIT = 0.80

# linux/can/error.h: bits of an error frame's identifier
CAN_ERR_LOSTARB = 0x002
CAN_ERR_CRTL = 0x004
CAN_ERR_PROT = 0x008
CAN_ERR_ACK = 0x020
CAN_ERR_BUSOFF = 0x040
CAN_ERR_BUSERROR = 0x080
CAN_ERR_RESTARTED = 0x100

IFF_UP = 1  # linux/if.h
_GONE = frozenset({errno.ENETDOWN, errno.ENODEV, errno.ENXIO, errno.EBADF, errno.ENETUNREACH})


@dataclass(frozen=True, slots=True)
class ErrorFrame:
    """What a row of the error frame's bits means."""

    bit: int
    fault: BusFault
    text: str


# The first row that matches names the frame.
ERROR_FRAMES = (
    ErrorFrame(CAN_ERR_BUSOFF, BusFault.BUS_OFF, "the controller is off the bus: check wiring and termination"),
    ErrorFrame(CAN_ERR_LOSTARB, BusFault.ARBITRATION_LOST, "the controller lost arbitration"),
    ErrorFrame(CAN_ERR_ACK, BusFault.ERROR_FRAME, "nobody acknowledges: power, bit rate or wiring"),
    ErrorFrame(CAN_ERR_RESTARTED, BusFault.ERROR_FRAME, "the controller was restarted"),
    ErrorFrame(CAN_ERR_PROT, BusFault.ERROR_FRAME, "protocol violation on the bus: bit rate or termination"),
    ErrorFrame(CAN_ERR_CRTL, BusFault.ERROR_FRAME, "the controller counts errors"),
    ErrorFrame(CAN_ERR_BUSERROR, BusFault.ERROR_FRAME, "error on the bus"),
)
_OTHER_ERROR = ErrorFrame(0, BusFault.ERROR_FRAME, "error frame")


def meaning_of(message: can.Message) -> ErrorFrame:
    """What a received error frame says."""
    return next((row for row in ERROR_FRAMES if message.arbitration_id & row.bit), _OTHER_ERROR)


def fault_of(error: Exception) -> BusFault:
    """What a failed send or receive means: the interface is gone, or this one time did not work."""
    number = getattr(error, "error_code", None) or getattr(error, "errno", None)
    if number is None and isinstance(error.__cause__, OSError):
        number = error.__cause__.errno
    return BusFault.INTERFACE_GONE if number in _GONE else BusFault.SEND_FAILED


def message_of(frame: Frame) -> can.Message:
    """A frame as python-can sends it."""
    return can.Message(arbitration_id=frame.arbitration_id, is_extended_id=frame.extended, data=frame.data)


def frame_of(message: can.Message) -> Frame:
    """A received data frame."""
    return Frame(message.arbitration_id, bytes(message.data), message.is_extended_id)


def with_bus(device: Exoskeleton, interface: str, channel: str) -> Exoskeleton:
    """The device on another interface or channel; empty strings change nothing."""
    if not interface and not channel:
        return device
    buses = tuple(
        msgspec.structs.replace(
            bus,
            interface=interface or bus.interface,
            channel=_numbered(channel, number) or bus.channel,
        )
        for number, bus in enumerate(device.buses)
    )
    return msgspec.structs.replace(device, buses=buses)


def _numbered(channel: str, number: int) -> str:
    """`a,b` names the first and the second bus's channel."""
    parts = channel.split(",")
    return parts[min(number, len(parts) - 1)].strip()


def open_bus(bus: BusDevice) -> can.BusABC:
    """The bus, opened; a `udp_multicast` channel may carry its port: "239.74.163.2:43113"; `local` is our own.

    Raises HardwareError with the command that mends it.
    """
    if bus.interface == "socketcan":
        _check_link(bus)
    channel = bus.channel
    options: dict[str, Any] = dict(bus.options)
    if bus.interface == "udp_multicast" and channel.count(":") == 1:
        channel, port = channel.split(":")
        options["port"] = int(port) if port.isdecimal() else port
    try:
        if bus.interface == "local":
            return LocalBus(channel)
        return can.Bus(interface=bus.interface, channel=channel, bitrate=bus.bitrate, **options)
    except (can.CanError, OSError, ValueError, TypeError, ImportError) as error:
        raise HardwareError(
            f"The bus {bus.channel} ({bus.interface}) can't be opened: {error}; {remedy(bus)}."
        ) from error


def _check_link(bus: BusDevice) -> None:
    """Raises HardwareError when the kernel has no such interface, or has it down."""
    flags = Path("/sys/class/net", bus.channel, "flags")
    if bus.channel in ("", ".", "..") or "/" in bus.channel or not flags.exists():
        raise HardwareError(f"There is no CAN interface {bus.channel}: {remedy(bus)}.")
    if not int(flags.read_text(), 16) & IFF_UP:
        raise HardwareError(f"The CAN interface {bus.channel} is down: {remedy(bus)}.")


def remedy(bus: BusDevice) -> str:
    """The sentence on what most likely mends a bus that does not open."""
    return f"try `{command}`" if (command := remedy_command(bus)) else "check interface and channel"


def remedy_command(bus: BusDevice) -> str:
    """The command that brings an interface up; empty where no command does."""
    if bus.interface != "socketcan":
        return ""
    if bus.channel.startswith("vcan"):
        return f"sudo modprobe vcan && sudo ip link add {bus.channel} type vcan && sudo ip link set {bus.channel} up"
    return f"sudo ip link set {bus.channel} up type can bitrate {bus.bitrate} restart-ms 0"


def frame_bits(payload: int, *, extended: bool) -> int:
    """Bits of a classic frame with the worst stuffing and the space after it (ISO 11898-1)."""
    stuffed = (54 if extended else 34) + 8 * payload
    fixed = 13  # CRC delimiter, acknowledge, end of frame, interframe space
    return stuffed + (stuffed - 1) // 4 + fixed


def bus_load(bits_a_tick: Iterable[int], *, bitrate: int, tick_hz: float = TICK_HZ) -> float:
    """The share of a bus that these frames fill at the tick rate."""
    return sum(bits_a_tick) * tick_hz / bitrate
