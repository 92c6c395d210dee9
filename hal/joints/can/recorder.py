"""Records buses as candump logs, by a socket of its own on each."""

from __future__ import annotations

import os
import shutil
import socket
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import can

from hal.errors import CanFault, HardwareError
from hal.joints.can.bus import open_bus
from hal.joints.can.candump import ERROR_FLAG, file_channel
from hal.joints.can.port import RECEIVE_ERRORS
from hal.joints.device import Exoskeleton
from logs.reading.errors import cause_of

FLUSH_S = 0.5
_BUFFER_BYTES = 8 << 20  # a second of a full bus, for a recorder that waits for the scheduler or its disk
_SO_RCVBUFFORCE = 33  # linux/socket.h; beyond the system's limit, for the privileged
_BATCH = 256
_PAUSE_S = 0.02  # frames are fetched by the batch: waking for each would cost perception a core


class BusRecorder:
    """Writes candump's `-L` format through python-can's own writer: can-utils read it, `rleex can decode` too."""

    def __init__(self, device: Exoskeleton, path: Path, *, floor_bytes: int = 0) -> None:
        """floor_bytes: of the disk stay free. Raises HardwareError when the file or a bus can't be opened."""
        self.frames = 0
        self._path = path
        self._floor_bytes = floor_bytes
        self._flushed_s = 0.0
        try:
            self._file = path.open("a", encoding="ascii", buffering=1 << 20)
        except OSError as error:
            raise HardwareError(CanFault.LOG_UNWRITABLE, path=path, detail=str(error)) from error
        self._buses: list[can.BusABC] = []
        try:
            self._buses = [open_bus(bus) for bus in device.buses]
        except HardwareError:
            self._file.close()
            raise
        for bus in self._buses:
            _widen(bus)
        self._writers = [can.CanutilsLogWriter(self._file, channel=file_channel(bus.channel)) for bus in device.buses]

    def run(self, stopped: Callable[[], bool]) -> None:
        """Record until stopped. Raises HardwareError when the file can't be written, or its disk is low."""
        try:
            self._record(stopped)
        except OSError as error:
            raise HardwareError(CanFault.LOG_UNWRITABLE, path=self._path, detail=cause_of(error)) from error

    def close(self) -> None:
        """Release file and buses; an adapter may be gone, and what can't be written has been reported."""
        for bus in self._buses:
            with suppress(can.CanError, OSError):
                bus.shutdown()
        with suppress(OSError):
            self._file.close()

    def _record(self, stopped: Callable[[], bool]) -> None:
        try:
            while not stopped():
                time.sleep(_PAUSE_S)
                for bus, writer in zip(self._buses, self._writers, strict=True):
                    self._take(bus, writer)
                if time.monotonic() - self._flushed_s >= FLUSH_S:
                    self._file.flush()
                    self._flushed_s = time.monotonic()
                    self._check_disk()
        finally:  # also when interrupted
            self._file.flush()

    def _check_disk(self) -> None:
        free_bytes = shutil.disk_usage(self._path.parent).free
        if free_bytes < self._floor_bytes:
            raise HardwareError(CanFault.LOG_DISK_LOW, path=self._path, free_bytes=free_bytes)

    def _take(self, bus: can.BusABC, writer: can.CanutilsLogWriter) -> None:
        for _ in range(_BATCH):
            try:
                message = bus.recv(0)
            except RECEIVE_ERRORS:
                return  # an interface that is gone may come back; control reports it meanwhile
            if message is None:
                return
            message.channel = None  # the writer's own name: can-utils can't read a multicast address
            if message.is_error_frame:
                self._file.write(_error_line(message, writer.channel))
            else:
                writer.on_message_received(message)
            self.frames += 1


def _error_line(message: can.Message, channel: str) -> str:
    """As candump writes an error frame; python-can's writer loses what it means."""
    return f"({message.timestamp:f}) {channel} {ERROR_FLAG | message.arbitration_id:08X}#{message.data.hex().upper()}\n"


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
