"""Contacts that a test presses: what a test does to a button, its module, its line, and the libraries' stand-ins."""

from __future__ import annotations

import sys
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar, NamedTuple, Protocol

import can

from hal.errors import HardwareError
from hal.inputs.can import CanInput
from hal.inputs.device import Contact, ContactReading, InputDevice, InputRole, StopInput
from hal.inputs.linux import EvdevInput, GpioInput
from hal.inputs.simulated import SimulatedInput, set_simulated

MS = 1_000_000
CAN_DEVICE = InputDevice(name="pendant", role=InputRole.WEARER, kind="can", can_id=0x181, byte=1, bit=2)


class FakeContact(Protocol):
    """What a test does to an input's device."""

    input: StopInput

    def put(self, contact: Contact) -> None: ...

    def read(self, after_ms: int = 5) -> ContactReading: ...


class SimulatedContact:
    def __init__(self, tmp_path: Path) -> None:
        device = InputDevice(name="pendant", role=InputRole.WEARER, kind="simulated")
        self.input: StopInput = SimulatedInput(device, tmp_path)
        self.folder = tmp_path
        self.now_ns = 1_000 * MS

    def put(self, contact: Contact) -> None:
        set_simulated(self.folder, "pendant", contact)

    def read(self, after_ms: int = 5) -> ContactReading:
        self.now_ns += after_ms * MS
        return self.input.read(self.now_ns)


class ScriptedBus(can.BusABC):
    """A bus whose frames the test sends, with its own time."""

    def __init__(self) -> None:
        super().__init__("scripted")
        self.channel_info = "scripted"
        self.arrived: deque[can.Message] = deque()
        self.broken = False

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        raise AssertionError("an input only listens")

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if self.broken:
            raise can.CanOperationError("the network is down")
        return (self.arrived.popleft(), False) if self.arrived else (None, False)


class FakeModule:
    """A module that sends every 5 ms while it lives."""

    def __init__(self, tmp_path: Path) -> None:
        self.now_ns = 1_000 * MS
        self.bus = ScriptedBus()
        self.contact = Contact.CLOSED
        clock: dict[str, Callable[[], int]] = {"clock": lambda: self.now_ns, "wall_ns": lambda: self.now_ns}
        self.input: StopInput = CanInput(CAN_DEVICE, opens=lambda _: self.bus, **clock)

    def put(self, contact: Contact) -> None:
        self.contact = contact

    def send(self, data: bytes, identifier: int = 0x181, **fields: Any) -> None:
        fields = {"is_extended_id": False, "timestamp": self.now_ns / 1e9} | fields
        self.bus.arrived.append(can.Message(arbitration_id=identifier, data=data, **fields))

    def read(self, after_ms: int = 5) -> ContactReading:
        for _ in range(after_ms // 5):
            self.now_ns += 5 * MS
            if self.contact is not Contact.SILENT:
                self.send(b"\x00\x04" if self.contact is Contact.CLOSED else b"\x00\xfb")
        return self.input.read(self.now_ns)


class Ecodes:
    """Of linux/input-event-codes.h, what is used."""

    EV_KEY = 1
    ecodes: ClassVar = {"KEY_A": 30, "KEY_B": 48, "KEY_SPACE": 57}


class Key(NamedTuple):
    type: int
    code: int
    value: int


class FakeEvdev:
    """An input device as the library gives it: its keys, pressed and let go, until it is unplugged."""

    ecodes = Ecodes
    name = "Pedal"

    def __init__(self) -> None:
        self.keys = [48]
        self.waiting: deque[Key] = deque()
        self.down: set[int] = set()
        self.plugged, self.taken, self.files = True, False, 0

    def InputDevice(self, path: str, *, readonly: bool) -> FakeEvdev:  # noqa: N802 - the library's
        if path != "/dev/input/event7" or not self.plugged:
            raise FileNotFoundError(2, "No such file or directory")
        self.files += 1
        return self

    def capabilities(self) -> dict[int, list[int]]:
        return {0: [0, 1], 1: self.keys}

    def grab(self) -> None:
        self.taken = True

    def read_one(self) -> Key | None:
        if not self.plugged:
            raise OSError(19, "No such device")
        return self.waiting.popleft() if self.waiting else None

    def active_keys(self) -> list[int]:
        return sorted(self.down)

    def close(self) -> None:
        self.taken, self.files = False, self.files - 1


class FakeLinuxContact:
    """Reads as the reader does: what was silent is opened again."""

    input: StopInput
    now_ns = 1_000 * MS

    def read(self, after_ms: int = 5) -> ContactReading:
        self.now_ns += after_ms * MS
        reading = self.input.read(self.now_ns)
        if reading.contact is not Contact.SILENT:
            return reading
        self.input.close()
        with suppress(HardwareError):
            self.input.open(self.now_ns)
        return self.input.read(self.now_ns)


class FakePedal(FakeLinuxContact):
    def __init__(self, tmp_path: Path, **fields: Any) -> None:
        self.kernel = FakeEvdev()
        sys.modules["evdev"] = self.kernel  # type: ignore[assignment]
        described: dict[str, Any] = {"device": "/dev/input/event7", "key": "KEY_B"} | fields
        self.input = EvdevInput(InputDevice(name="pedal", role=InputRole.THERAPIST, kind="evdev", **described))

    def put(self, contact: Contact) -> None:
        self.kernel.plugged = contact is not Contact.SILENT
        if contact is Contact.OPEN:
            self.kernel.down = {48}
            self.kernel.waiting.append(Key(1, 48, 1))
        elif contact is Contact.CLOSED and self.kernel.down:
            self.kernel.down = set()
            self.kernel.waiting.append(Key(1, 48, 0))


class Edge(NamedTuple):
    event_type: str


class FakeGpiod:
    """A line as the library gives it: its level follows contact and bias."""

    class EdgeEvent:
        class Type:
            RISING_EDGE = "rising"
            FALLING_EDGE = "falling"

    def __init__(self) -> None:
        self.plugged, self.wired = True, True
        self.waiting: list[Edge] = []
        self.settings: dict[str, Any] = {}

    def LineSettings(self, **settings: Any) -> dict[str, Any]:  # noqa: N802 - the library's
        return settings

    def request_lines(self, path: str, *, consumer: str, config: dict[int, dict[str, Any]]) -> FakeGpiod:
        if path != "/dev/gpiochip0" or not self.plugged:
            raise FileNotFoundError(2, "No such file or directory")
        (self.settings,) = config.values()
        return self

    def wait_edge_events(self, timeout: float) -> bool:
        if not self.plugged:
            raise OSError(19, "No such device")
        return bool(self.waiting)

    def read_edge_events(self) -> list[Edge]:
        edges, self.waiting = self.waiting, []
        return edges

    def get_value(self, line: int) -> bool:
        """Active or not: a closed contact drives the line against the bias."""
        biased_high = self.settings["bias"] == "up"
        high = biased_high is not self.wired
        return high is not self.settings["active_low"]

    def release(self) -> None:
        self.waiting = []


class FakeLine(FakeLinuxContact):
    def __init__(self, tmp_path: Path, **fields: Any) -> None:
        self.kernel = FakeGpiod()
        sys.modules["gpiod"] = self.kernel  # type: ignore[assignment]
        sys.modules["gpiod.line"] = SimpleNamespace(  # type: ignore[assignment]
            Direction=SimpleNamespace(INPUT="in"),
            Edge=SimpleNamespace(BOTH="both"),
            Bias=SimpleNamespace(PULL_UP="up", PULL_DOWN="down"),
        )
        described: dict[str, Any] = {"device": "/dev/gpiochip0", "line": 4} | fields
        self.input = GpioInput(InputDevice(name="stop", role=InputRole.WEARER, kind="gpiod", **described))

    def put(self, contact: Contact) -> None:
        self.kernel.plugged = contact is not Contact.SILENT
        if contact is not Contact.SILENT and self.kernel.wired is not (contact is Contact.CLOSED):
            self.kernel.wired = contact is Contact.CLOSED
            self.kernel.waiting.append(Edge("rising" if self.kernel.wired else "falling"))
