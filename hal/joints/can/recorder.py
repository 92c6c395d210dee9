"""Everything on the buses into one candump log, by a socket of its own, so that control pays nothing for it."""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Callable
from pathlib import Path

import can

from hal.errors import HardwareError
from hal.joints.can.bus import open_bus
from hal.joints.device import Exoskeleton

FLUSH_S = 0.5
_BUFFER_BYTES = 8 << 20  # a second of a full bus, for a recorder that has to wait for its turn or its disk
_SO_RCVBUFFORCE = 33  # linux/socket.h; beyond the system's limit, for the privileged
_BATCH = 256
_PAUSE_S = 0.02  # frames are fetched by the batch: waking for each would take a core's time from perception


class BusRecorder:
    """Writes candump's `-L` format through python-can's own writer: can-utils read it, `rleex can decode` too."""

    def __init__(self, device: Exoskeleton, path: Path) -> None:
        """Raises HardwareError when the file or a bus can't be opened."""
        self.frames = 0
        self._flushed_s = 0.0
        try:
            self._file = path.open("a", encoding="ascii", buffering=1 << 20)
        except OSError as error:
            raise HardwareError(f"The bus log {path} can't be written: {error}; choose another place.") from error
        self._buses: list[can.BusABC] = []
        try:
            self._buses = [open_bus(bus) for bus in device.buses]
        except HardwareError:
            self._file.close()
            raise
        for bus in self._buses:
            _widen(bus)
        self._writers = [can.CanutilsLogWriter(self._file, channel=_plain(bus.channel)) for bus in device.buses]

    def run(self, stopped: Callable[[], bool]) -> None:
        """Record until stopped."""
        while not stopped():
            time.sleep(_PAUSE_S)
            for bus, writer in zip(self._buses, self._writers, strict=True):
                self._take(bus, writer)
            if time.monotonic() - self._flushed_s >= FLUSH_S:
                self._file.flush()
                self._flushed_s = time.monotonic()

    def close(self) -> None:
        """Write what is left, release file and buses."""
        for bus in self._buses:
            bus.shutdown()
        self._file.close()

    def _take(self, bus: can.BusABC, writer: can.CanutilsLogWriter) -> None:
        for _ in range(_BATCH):
            try:
                message = bus.recv(0)
            except (can.CanError, OSError, ValueError, TypeError):
                return  # an interface that is gone may come back; control reports it meanwhile
            if message is None:
                return
            message.channel = None  # the writer's own name: a multicast address is no word for can-utils
            writer.on_message_received(message)
            self.frames += 1


def _plain(channel: str) -> str:
    """A channel's name without what can-utils can't read in one."""
    return "".join(letter if letter.isalnum() else "_" for letter in channel)[:15] or "can"


def _widen(bus: can.BusABC) -> None:
    try:
        number = bus.fileno()
    except NotImplementedError:  # a bus without a socket has a queue without an end
        return
    if number < 0:
        return
    with socket.socket(fileno=os.dup(number)) as same:
        try:
            same.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, _BUFFER_BYTES)
        except OSError:
            same.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
