"""The scene of the coming action, sent to the emulated wearer beside the bus: stairs and chairs are not on CAN."""

from __future__ import annotations

import socket
from contextlib import suppress

import msgspec

from hal.errors import DrivesFault, HardwareError
from hal.joints.can.driver import SocketCanJoints
from hal.joints.device import EMULATED_INTERFACES, BusDevice, Exoskeleton
from hal.joints.scene import Scene


def is_virtual(bus: BusDevice) -> bool:
    """Whether no real drive can hang on this bus."""
    return bus.interface in EMULATED_INTERFACES or bus.channel.startswith("vcan")


def may_be_emulated(device: Exoskeleton) -> bool:
    """Whether no real drive can hang on these buses."""
    return all(is_virtual(bus) for bus in device.buses)


def _address(device: Exoskeleton) -> str:
    """An abstract socket of this host, named by the first bus."""
    bus = device.buses[0]
    return f"\0rleex-scene-{bus.interface}-{bus.channel}"


class EmulatedCanJoints(SocketCanJoints):
    """The driver on a bus without real drives: it also sends an emulated wearer what stands around the feet."""

    def stage(self, scene: Scene) -> None:
        """Send the scene; without an emulator nothing happens."""
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as link, suppress(OSError):
            link.setblocking(False)
            link.sendto(msgspec.msgpack.encode(scene), _address(self.device))


class SceneReceiver:
    """The emulator's end."""

    def __init__(self, device: Exoskeleton) -> None:
        """Raises HardwareError when another emulator serves this bus."""
        self._link = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._link.setblocking(False)
        try:
            self._link.bind(_address(device))
        except OSError as error:
            self._link.close()
            raise HardwareError(DrivesFault.ALREADY_EMULATED, bus=device.buses[0].channel) from error

    def receive(self) -> Scene | None:
        """The scene sent since the last call."""
        try:
            return msgspec.msgpack.decode(self._link.recv(65_536), type=Scene)
        except (BlockingIOError, msgspec.MsgspecError):
            return None

    def close(self) -> None:
        self._link.close()
