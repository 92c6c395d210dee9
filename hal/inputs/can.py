"""A contact that a CAN module (I/O module, drive) reports in a bit of a frame which it sends at least every 10 ms."""

from __future__ import annotations

import time
from collections.abc import Callable

import can

from hal.errors import HardwareError, StopInputFault
from hal.inputs.device import Contact, ContactReading, InputDevice
from hal.joints.can.bus import open_bus
from hal.joints.can.port import BusPort
from hal.joints.codecs.wire import Frame
from hal.joints.device import BusDevice


class CanInput:
    """Listens only. A module that is silent, or whose frame is too short, is an open contact."""

    def __init__(
        self,
        device: InputDevice,
        *,
        opens: Callable[[BusDevice], can.BusABC] = open_bus,
        clock: Callable[[], int] = time.monotonic_ns,
        wall_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self._device = device
        self._opens, self._clock, self._wall_ns = opens, clock, wall_ns
        self._port: BusPort | None = None
        self._answered_ns = 0
        self._closed = False

    def open(self, now_ns: int) -> None:
        """Raises HardwareError with the command that brings the bus up."""
        device = self._device
        bus = self._opens(device.bus)  # without filters: python-can's ends a reading at the first frame that it drops
        self._port = BusPort(bus, device.bus.channel, now_ns, clock=self._clock, wall_ns=self._wall_ns)
        self._answered_ns, self._closed = now_ns, False

    def read(self, now_ns: int) -> ContactReading:
        """By the frames that have arrived; one that says open counts, whatever followed it."""
        if self._port is None:
            return self._silent()
        opened = False
        for frame, at_ns in self._port.drain(now_ns):
            if (frame.arbitration_id, frame.extended) == (self._device.can_id, self._device.extended):
                self._answered_ns, self._closed = at_ns, self._is_closed(frame)
                opened |= not self._closed
        _, detail = self._port.take_faults()
        if opened:
            return ContactReading(Contact.OPEN)
        if now_ns - self._answered_ns > self._device.timeout_ms * 1e6:
            return self._silent() if detail is None else ContactReading(Contact.SILENT, detail)
        return ContactReading(Contact.CLOSED if self._closed else Contact.OPEN)

    def close(self) -> None:
        """Release the bus."""
        if self._port is not None:
            self._port.close()
            self._port = None

    def _is_closed(self, frame: Frame) -> bool:
        device = self._device
        return len(frame.data) > device.byte and frame.data[device.byte] >> device.bit & 1 == device.closed_level

    def _silent(self) -> ContactReading:
        values = {"bus": self._device.bus.channel, "identifier": f"{self._device.can_id:03X}"}
        return ContactReading(Contact.SILENT, HardwareError(StopInputFault.NO_FRAME, **values))
