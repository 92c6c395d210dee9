"""Listening to the drives without a word: what they report, what others command, who else talks."""

from __future__ import annotations

import time
from collections import Counter
from pathlib import Path

from hal.joints.can.bus import open_bus
from hal.joints.can.bus_port import BusPort
from hal.joints.can.candump import Decoded, Decoder
from hal.joints.can.drive import Station
from hal.joints.device import Exoskeleton
from hal.joints.motors import load_motors
from hal.joints.protocol import BusFault, Joint


class BusMonitor:
    """Keeps each drive's newest words by kind; sends nothing."""

    def __init__(self, device: Exoskeleton, motors: Path | None = None) -> None:
        self.stations = stations_of(device, motors)
        self._decoders = [
            Decoder(tuple(station for station in self.stations if station.device.can_bus == number))
            for number in range(len(device.buses))
        ]
        self._ports = [BusPort(open_bus(bus), bus.channel, time.monotonic_ns()) for bus in device.buses]
        self.newest: dict[tuple[str, str], Decoded] = {}
        self.counts: Counter[tuple[str, str]] = Counter()
        self.bus = BusFault.NONE
        self.detail = ""

    def look(self, wait_s: float) -> None:
        """Take in what comes within this time."""
        end_s = time.monotonic() + wait_s
        while time.monotonic() < end_s:
            for port, decoder in zip(self._ports, self._decoders, strict=True):
                message = port.hear(min(0.02, wait_s))
                for _ in range(1000):
                    if message is None:
                        break
                    self._note(decoder.decode(message))
                    message = port.hear(0.0)
                fault, text = port.take_faults()
                if fault is not BusFault.NONE:
                    self.bus, self.detail = self.bus | fault, text

    def close(self) -> None:
        """Release the buses."""
        for port in self._ports:
            port.close()

    def _note(self, decoded: Decoded) -> None:
        self.newest[decoded.drive, decoded.kind] = decoded
        self.counts[decoded.drive, decoded.kind] += 1


def stations_of(device: Exoskeleton, motors: Path | None = None) -> tuple[Station, ...]:
    """The device's four drives. Raises HardwareError for an unknown motor."""
    table = load_motors(motors)
    return tuple(Station(joint, device.joints[joint], table.find(device.joints[joint].motor)) for joint in Joint)
