"""The CAN buses of a device: which they are, opening them or naming the command that does, and their load."""

from __future__ import annotations

import errno
import os
import time
from collections.abc import Iterable
from itertools import combinations
from pathlib import Path
from typing import Any

import can
import msgspec

from hal.errors import CanFault, DeviceFault, HardwareError
from hal.joints.can.local_bus import LocalBus
from hal.joints.can.port import RECEIVE_ERRORS
from hal.joints.device import BusDevice, Exoskeleton
from hal.joints.protocol import TICK_HZ

LOAD_LIMIT = 0.80
# For a channel of another interface's kind (pcan: KeyError, gs_usb: AttributeError), and where an interface's driver is
# missing (kvaser: NameError).
_OPEN_ERRORS = (*RECEIVE_ERRORS, ImportError, NameError, AttributeError)
IFF_UP = 1  # linux/if.h


def with_bus(device: Exoskeleton, interface: str, channel: str) -> Exoskeleton:
    """The device on another interface or channel; empty strings change nothing.

    Raises HardwareError where two of its buses would be one: drives of one leg may have the IDs of the other's.
    """
    buses = tuple(
        msgspec.structs.replace(
            bus,
            interface=interface or bus.interface,
            channel=_numbered(channel, number) or bus.channel,
        )
        for number, bus in enumerate(device.buses)
    )
    for bus, other in combinations(buses, 2):
        # Adapters of one channel name may differ by the options of their interface.
        if (bus.interface, bus.channel, bus.options) == (other.interface, other.channel, other.options):
            raise HardwareError(DeviceFault.CHANNEL_SHARED, device=device.name, count=len(buses), bus=bus.channel)
    return msgspec.structs.replace(device, buses=buses)


def _numbered(channel: str, number: int) -> str:
    """`a,b` names the first and the second bus's channel."""
    parts = channel.split(",")
    return parts[min(number, len(parts) - 1)].strip()


def open_bus(bus: BusDevice) -> can.BusABC:
    """The bus, opened; a `udp_multicast` channel may carry its port: "239.74.163.2:43113"; `local` is our own.

    Raises HardwareError with the command that brings it up.
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
    except _OPEN_ERRORS as error:
        values = {"bus": bus.channel, "interface": bus.interface, "detail": str(error)}
        if command := remedy_command(bus, exists=True):
            raise HardwareError(CanFault.NOT_OPENED_COMMAND, **values, command=command) from error
        raise HardwareError(CanFault.NOT_OPENED, **values) from error


def _check_link(bus: BusDevice) -> None:
    """Raises HardwareError when the kernel has no such interface, or has it down."""
    flags = Path("/sys/class/net", bus.channel, "flags")
    if bus.channel in ("", ".", "..") or "/" in bus.channel or not flags.exists():
        raise HardwareError(CanFault.NO_INTERFACE, bus=bus.channel, command=remedy_command(bus))
    try:
        up = int(flags.read_text(), 16) & IFF_UP
    except OSError as error:  # it has gone since
        raise HardwareError(CanFault.NO_INTERFACE, bus=bus.channel, command=remedy_command(bus)) from error
    if not up:
        raise HardwareError(CanFault.INTERFACE_DOWN, bus=bus.channel, command=remedy_command(bus, exists=True))


def remedy_command(bus: BusDevice, *, exists: bool = False) -> str:
    """The command that brings an interface up; empty where no command does. exists: the kernel has it already."""
    if bus.interface != "socketcan":
        return ""
    if bus.channel.startswith("vcan"):
        up = f"sudo ip link set {bus.channel} up"
        return up if exists else f"sudo modprobe vcan && sudo ip link add {bus.channel} type vcan && {up}"
    return f"sudo ip link set {bus.channel} up type can bitrate {bus.bitrate} restart-ms 0"


def frame_bits(payload: int, *, extended: bool) -> int:
    """Bits of a classic frame with the worst stuffing and the space after it (ISO 11898-1)."""
    stuffed = (54 if extended else 34) + 8 * payload
    fixed = 13  # CRC delimiter, acknowledge, end of frame, interframe space
    return stuffed + (stuffed - 1) // 4 + fixed


def bus_load(bits_a_tick: Iterable[int], *, bitrate: int) -> float:
    """The share of a bus that these frames fill at the tick rate."""
    return sum(bits_a_tick) * TICK_HZ / bitrate


class AbsentBus(can.BusABC):
    """In place of a bus that can't be opened: takes nothing, and nothing comes."""

    def __init__(self, channel: str) -> None:
        super().__init__(channel)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:  # noqa: ARG002 - python-can's
        """Raises CanOperationError."""
        raise can.CanOperationError(os.strerror(errno.ENODEV), errno.ENODEV)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        time.sleep(timeout or 0.0)
        return None, True
