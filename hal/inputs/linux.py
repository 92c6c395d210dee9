"""Contacts that Linux reads: a key of an input device (USB pedal, presenter) and a GPIO line. Extra: rleex[inputs]."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from hal.errors import HardwareError, StopInputFault
from hal.inputs.device import Contact, ContactReading, InputDevice


class LinuxInput:
    """What both have in common: a device file that is opened, read until it is gone, and closed."""

    def __init__(self, device: InputDevice) -> None:
        self._device = device
        self._library: Any = None
        self._opened: Any = None

    def open(self, now_ns: int) -> None:  # noqa: ARG002
        """Raises HardwareError naming what is missing."""
        try:
            self._library = import_module(self._device.kind)
        except ImportError as error:
            raise HardwareError(StopInputFault.EXTRA_MISSING, kind=self._device.kind, detail=str(error)) from error
        try:
            self._opened = self._open()
        except (OSError, ValueError) as error:
            values = {"device": self._device.device, "detail": getattr(error, "strerror", None) or str(error)}
            raise HardwareError(StopInputFault.NOT_OPENED, **values) from error

    def read(self, now_ns: int) -> ContactReading:  # noqa: ARG002
        """What it is now, or OPEN if one of the events since the last call says that it was."""
        if self._opened is None:
            return self._gone()
        try:
            closed = self._is_closed()
        except (OSError, ValueError):  # the device is gone
            return self._gone()
        return ContactReading(Contact.CLOSED if closed else Contact.OPEN)

    def close(self) -> None:
        """Release the device."""
        if self._opened is not None:
            opened, self._opened = self._opened, None
            self._release(opened)

    def _gone(self) -> ContactReading:
        return ContactReading(Contact.SILENT, HardwareError(StopInputFault.UNPLUGGED, name=self._device.name))

    def _open(self) -> Any:
        raise NotImplementedError

    def _is_closed(self) -> bool:
        raise NotImplementedError

    def _release(self, opened: Any) -> None:
        raise NotImplementedError


class EvdevInput(LinuxInput):
    """A key. The device is grabbed, so that pressing it types nothing."""

    def _open(self) -> Any:
        opened = self._library.InputDevice(self._device.device, readonly=True)
        try:
            self._check(opened)
            opened.grab()
        except BaseException:
            opened.close()
            raise
        return opened

    def _check(self, opened: Any) -> None:
        device, ecodes = self._device, self._library.ecodes
        self._code = ecodes.ecodes.get(device.key, -1)
        keys = set(opened.capabilities().get(ecodes.EV_KEY, ()))
        if self._code not in keys:
            raise HardwareError(StopInputFault.NO_SUCH_KEY, device=device.device, key=device.key)
        if {ecodes.ecodes["KEY_A"], ecodes.ecodes["KEY_SPACE"]} <= keys and not device.keyboard:
            raise HardwareError(StopInputFault.KEYBOARD, device=device.device, name=opened.name)

    def _is_closed(self) -> bool:
        closed, key = True, self._library.ecodes.EV_KEY
        while (event := self._opened.read_one()) is not None:
            if (event.type, event.code) == (key, self._code):
                closed = closed and (event.value > 0) == self._device.closed_level
        return closed and (self._code in self._opened.active_keys()) == self._device.closed_level

    def _release(self, opened: Any) -> None:
        opened.close()


class GpioInput(LinuxInput):
    """A line against its own bias: without the contact the bias pulls it to open, as a broken wire does."""

    def _open(self) -> Any:
        line, high = import_module("gpiod.line"), self._device.closed_level
        settings = self._library.LineSettings(
            direction=line.Direction.INPUT,
            edge_detection=line.Edge.BOTH,
            bias=line.Bias.PULL_DOWN if high else line.Bias.PULL_UP,
            active_low=not high,  # active: the contact is closed
        )
        config = {self._device.line: settings}
        return self._library.request_lines(self._device.device, consumer="rleex", config=config)

    def _is_closed(self) -> bool:
        closed, rising = True, self._library.EdgeEvent.Type.RISING_EDGE
        while self._opened.wait_edge_events(0):
            closed = all(event.event_type == rising for event in self._opened.read_edge_events()) and closed
        return closed and bool(self._opened.get_value(self._device.line))

    def _release(self, opened: Any) -> None:
        opened.release()
