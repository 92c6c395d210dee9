"""All stop inputs, read in a thread of their own, so that none of them can make a tick late."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path

from hal.errors import HardwareError
from hal.inputs.device import Contact, InputDevice, InputKind, InputReading, InputReadings, StopInput

READ_S = 0.005
FIRST_ANSWER_S = 0.2
RETRY_NS = 1_000_000_000  # an input that is silent is opened again so often


def make_input(device: InputDevice, folder: Path) -> StopInput:
    """The driver of its kind, not open yet; folder: the session's own, where simulated buttons are."""
    return _DRIVERS[device.kind](device, folder)


def _simulated(device: InputDevice, folder: Path) -> StopInput:
    from hal.inputs.simulated import SimulatedInput

    return SimulatedInput(device, folder)


def _can(device: InputDevice, _folder: Path) -> StopInput:
    from hal.inputs.can import CanInput

    return CanInput(device)


def _evdev(device: InputDevice, _folder: Path) -> StopInput:
    from hal.inputs.linux import EvdevInput

    return EvdevInput(device)


def _gpiod(device: InputDevice, _folder: Path) -> StopInput:
    from hal.inputs.linux import GpioInput

    return GpioInput(device)


_DRIVERS: dict[InputKind, Callable[[InputDevice, Path], StopInput]] = {
    "simulated": _simulated,
    "can": _can,
    "evdev": _evdev,
    "gpiod": _gpiod,
}


class InputReader:
    """`newest` is replaced as a whole at each reading; any thread may look at it."""

    def __init__(self, devices: tuple[InputDevice, ...], inputs: tuple[StopInput, ...]) -> None:
        self._devices = devices
        self._inputs = inputs
        self._opened_ns = [0] * len(devices)  # when each was tried to be opened; 0: not yet
        self._faults: list[HardwareError | None] = [None] * len(devices)  # why it could not be
        self.newest = InputReadings()
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="stop-inputs", daemon=True)

    def start(self) -> None:
        """Read until all have answered, or a moment is over; then in the thread. Without inputs there is none."""
        limit_s = time.monotonic() + FIRST_ANSWER_S
        self.poll(time.monotonic_ns())
        while not all(one.contact is Contact.CLOSED for one in self.newest.inputs) and time.monotonic() < limit_s:
            time.sleep(READ_S)
            self.poll(time.monotonic_ns())
        if self._devices:
            self._thread.start()

    def poll(self, now_ns: int) -> None:
        """Read every input."""
        before = self.newest.inputs or [None] * len(self._devices)
        readings = tuple(self._read(number, now_ns, last) for number, last in enumerate(before))
        self.newest = InputReadings(now_ns, readings)

    def close(self) -> None:
        """End the thread and release every input."""
        self._ending.set()
        if self._thread.is_alive():
            self._thread.join()
        for one in self._inputs:
            one.close()

    def _run(self) -> None:
        while not self._ending.wait(READ_S):
            self.poll(time.monotonic_ns())

    def _read(self, number: int, now_ns: int, before: InputReading | None) -> InputReading:
        device = self._devices[number]
        silent = before is None or before.contact is Contact.SILENT
        if silent and (before is None or now_ns - self._opened_ns[number] >= RETRY_NS):
            self._open(number, now_ns)
        contact, fault = Contact.SILENT, self._faults[number]
        if fault is None:
            contact, fault = self._inputs[number].read(now_ns)
        opened_ns = now_ns
        if contact is Contact.CLOSED:
            opened_ns = before.opened_ns if before else 0
        return InputReading(device.name, device.role, contact, opened_ns, fault)

    def _open(self, number: int, now_ns: int) -> None:
        self._opened_ns[number], self._faults[number] = now_ns, None
        self._inputs[number].close()
        try:
            self._inputs[number].open(now_ns)
        except HardwareError as error:
            self._faults[number] = error
