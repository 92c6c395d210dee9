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
from hal.joints.can.bus import AbsentBus, open_bus
from hal.joints.can.candump import ERROR_FLAG, file_channels
from hal.joints.can.port import RECEIVE_ERRORS, is_malformed
from hal.joints.device import BusDevice, Exoskeleton
from logs.reading.errors import cause_of

FLUSH_S = 0.5
_BUFFER_BYTES = 8 << 20  # a second of a full bus, for a recorder that waits for the scheduler or its disk
_SO_RCVBUFFORCE = 33  # linux/socket.h; beyond the system's limit, for the privileged
_BATCH = 256
_PAUSE_S = 0.02  # frames are fetched by the batch: waking for each would cost perception a core


class BusRecorder:
    """Writes candump's `-L` format through python-can's own writer: can-utils read it, `rleex can decode` too."""

    def __init__(
        self,
        device: Exoskeleton,
        path: Path,
        *,
        floor_bytes: int = 0,
        waits: bool = False,
        report: Callable[[HardwareError], object] = lambda _: None,
    ) -> None:
        """floor_bytes: of the disk stay free. waits: a bus that can't be opened is recorded once it can be.

        report: told of each bus that is not recorded any more, or again; a line of the log may be a frame only.
        Raises HardwareError when the file can't be opened, or a bus that is not waited for.
        """
        self.frames = 0
        self._device = device
        self._report = report
        self._absent_since_s: dict[int, float] = {}
        self._path = path
        self._floor_bytes = floor_bytes
        self._flushed_s = 0.0
        try:
            self._file = path.open("a", encoding="ascii", buffering=1 << 20)
        except OSError as error:
            raise HardwareError(CanFault.LOG_UNWRITABLE, path=path, detail=str(error)) from error
        self._buses: list[can.BusABC] = []
        try:
            for number in range(len(device.buses)):
                self._buses.append(self._open(number, waits=waits))
        except HardwareError:
            self.close()
            raise
        self._writers = [can.CanutilsLogWriter(self._file, channel=channel) for channel in file_channels(device)]

    def run(self, stopped: Callable[[], bool]) -> None:
        """Record until stopped. Raises HardwareError when the file can't be written, or its disk is low."""
        try:
            self._record(stopped)
        except OSError as error:
            raise HardwareError(CanFault.LOG_UNWRITABLE, path=self._path, detail=cause_of(error)) from error

    def close(self) -> None:
        """Release file and buses; an adapter may be gone, and what can't be written has been reported."""
        for bus in self._buses:
            _release(bus)
        with suppress(OSError):
            self._file.close()

    def _record(self, stopped: Callable[[], bool]) -> None:
        try:
            while not stopped():
                time.sleep(_PAUSE_S)
                for number in range(len(self._buses)):
                    self._take(number)
                if time.monotonic() - self._flushed_s >= FLUSH_S:
                    self._file.flush()
                    self._flushed_s = time.monotonic()
                    self._check_disk()
                    self._reopen()
        finally:  # also when interrupted
            self._file.flush()

    def _check_disk(self) -> None:
        free_bytes = shutil.disk_usage(self._path.parent).free
        if free_bytes < self._floor_bytes:
            raise HardwareError(CanFault.LOG_DISK_LOW, path=self._path, free_bytes=free_bytes)

    def _open(self, number: int, *, waits: bool) -> can.BusABC:
        bus = self._device.buses[number]
        try:
            return _opened(bus)
        except HardwareError as error:
            if not waits:
                raise
            return self._without(number, error)

    def _without(self, number: int, detail: HardwareError | str) -> can.BusABC:
        """Of the bus nothing is recorded from now on."""
        channel = self._device.buses[number].channel
        self._absent_since_s[number] = time.monotonic()
        self._report(HardwareError(CanFault.LOG_PAUSED, bus=channel, detail=detail))
        return AbsentBus(channel)

    def _reopen(self) -> None:
        """An adapter that is plugged in again is another interface: the socket of before stays without a frame."""
        for number, since_s in tuple(self._absent_since_s.items()):
            bus = self._device.buses[number]
            with suppress(HardwareError):
                opened = _opened(bus)
                _release(self._buses[number])
                self._buses[number] = opened
                del self._absent_since_s[number]
                missing_s = round(time.monotonic() - since_s, 1)
                self._report(HardwareError(CanFault.LOG_RESUMED, bus=bus.channel, missing_s=missing_s))

    def _take(self, number: int) -> None:
        bus, writer = self._buses[number], self._writers[number]
        for _ in range(_BATCH):
            try:
                message = bus.recv(0)
            except RECEIVE_ERRORS as error:
                if not is_malformed(error):
                    _release(bus)
                    self._buses[number] = self._without(number, str(error))
                return
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


def _opened(bus: BusDevice) -> can.BusABC:
    """Raises HardwareError."""
    opened = open_bus(bus)
    _widen(opened)
    return opened


def _release(bus: can.BusABC) -> None:
    """Some adapters are spoken to once more, and may be gone."""
    with suppress(can.CanError, OSError):
        bus.shutdown()


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
