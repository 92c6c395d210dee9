"""What every driver of a stop input keeps: closed only while that is proven, whatever else happens means stop."""

from __future__ import annotations

import sys
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar, NamedTuple, Protocol

import can
import pytest

from hal.errors import CanFault, HardwareError, StopInputFault
from hal.inputs.can import CanInput
from hal.inputs.device import InputDevice, InputRole
from hal.inputs.linux import EvdevInput, GpioInput
from hal.inputs.protocol import Contact, ContactReading, StopInput
from hal.inputs.reader import RETRY_NS, InputReader
from hal.inputs.simulated import SimulatedInput, set_simulated
from hal.joints.device import BusDevice

MS = 1_000_000
CAN_DEVICE = InputDevice(name="pendant", role=InputRole.WEARER, kind="can", can_id=0x181, byte=1, bit=2)


class Hand(Protocol):
    """What a test does to an input's device."""

    input: StopInput

    def put(self, contact: Contact) -> None: ...

    def read(self, after_ms: int = 5) -> ContactReading: ...


class SimulatedHand:
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


class CanHand:
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


class KernelKeys:
    """An input device as the library gives it: its keys, pressed and let go, until it is unplugged."""

    ecodes = Ecodes
    name = "Pedal"

    def __init__(self) -> None:
        self.keys = [48]
        self.waiting: deque[Key] = deque()
        self.down: set[int] = set()
        self.plugged, self.taken, self.files = True, False, 0

    def InputDevice(self, path: str, *, readonly: bool) -> KernelKeys:  # noqa: N802 - the library's
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


class LinuxHand:
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


class EvdevHand(LinuxHand):
    def __init__(self, tmp_path: Path, **fields: Any) -> None:
        self.kernel = KernelKeys()
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


class KernelLine:
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

    def request_lines(self, path: str, *, consumer: str, config: dict[int, dict[str, Any]]) -> KernelLine:
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


class GpioHand(LinuxHand):
    def __init__(self, tmp_path: Path, **fields: Any) -> None:
        self.kernel = KernelLine()
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


@pytest.fixture(autouse=True)
def libraries(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a test puts in the libraries' place goes with it."""
    for name in ("evdev", "gpiod", "gpiod.line"):
        monkeypatch.setitem(sys.modules, name, None)


@pytest.fixture(params=[SimulatedHand, CanHand, EvdevHand, GpioHand, lambda path: GpioHand(path, closed=0)])
def hand(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Hand]:
    made: Hand = request.param(tmp_path)
    made.input.open(1_000 * MS)
    yield made
    made.input.close()


def test_closed_lets_the_legs_move_and_nothing_else_does(hand: Hand) -> None:
    assert hand.read() == (Contact.CLOSED, None)
    hand.put(Contact.OPEN)
    assert hand.read() == (Contact.OPEN, None)
    hand.put(Contact.CLOSED)
    assert hand.read().contact is Contact.CLOSED
    hand.put(Contact.SILENT)
    contact, fault = hand.read(after_ms=20)
    assert contact is Contact.SILENT
    assert isinstance(fault, HardwareError)
    hand.put(Contact.CLOSED)
    assert hand.read().contact is Contact.CLOSED, "plugged in again"


def test_held_closed_it_stays_closed(hand: Hand) -> None:
    assert {hand.read().contact for _ in range(100)} == {Contact.CLOSED}


def test_it_can_be_closed_twice_and_opened_again(hand: Hand) -> None:
    hand.input.close()
    hand.input.close()
    hand.input.open(1_000 * MS)
    assert hand.read().contact is Contact.CLOSED


def test_opening_it_again_presses_nothing_and_releases_nothing(hand: Hand) -> None:
    hand.put(Contact.OPEN)
    hand.read()
    hand.input.close()
    hand.input.open(1_000 * MS)
    assert hand.read().contact is not Contact.CLOSED


@pytest.mark.parametrize("kind", [EvdevHand, GpioHand])
def test_a_press_that_is_over_at_the_next_reading_counts_once(kind: type[EvdevHand | GpioHand], tmp_path: Path) -> None:
    hand = kind(tmp_path)
    hand.input.open(hand.now_ns)
    hand.read()
    hand.put(Contact.OPEN)
    hand.put(Contact.CLOSED)
    assert [hand.read().contact for _ in range(2)] == [Contact.OPEN, Contact.CLOSED]


def fault_of(made: Any) -> StopInputFault:
    """Why it can't be opened."""
    with pytest.raises(HardwareError) as refused:
        made.input.open(1_000 * MS)
    assert isinstance(refused.value.code, StopInputFault)
    return refused.value.code


def test_a_device_that_can_not_be_read_is_named(tmp_path: Path) -> None:
    assert fault_of(EvdevHand(tmp_path, device="/dev/input/event9")) is StopInputFault.NOT_OPENED
    assert fault_of(GpioHand(tmp_path, device="/dev/gpiochip9")) is StopInputFault.NOT_OPENED
    for key in ("KEY_C", "KEY_SPACE"):
        assert fault_of(EvdevHand(tmp_path, key=key)) is StopInputFault.NO_SUCH_KEY
    pedal = EvdevHand(tmp_path)
    sys.modules["evdev"] = None  # type: ignore[assignment]
    assert fault_of(pedal) is StopInputFault.EXTRA_MISSING


def test_a_keyboard_is_no_pedal_unless_it_is_named_one(tmp_path: Path) -> None:
    keyboard = EvdevHand(tmp_path)
    keyboard.kernel.keys = [30, 48, 57]
    assert fault_of(keyboard) is StopInputFault.KEYBOARD
    assert (keyboard.kernel.taken, keyboard.kernel.files) == (False, 0), "the console keeps its keys"
    pedal = EvdevHand(tmp_path, keyboard=True)
    pedal.kernel.keys = [30, 48, 57]
    pedal.input.open(pedal.now_ns)
    assert pedal.kernel.taken, "what it types reaches nobody"
    assert pedal.read().contact is Contact.CLOSED


def test_a_switch_that_holds_its_key_down_while_closed(tmp_path: Path) -> None:
    hand = EvdevHand(tmp_path, closed=1)
    hand.input.open(hand.now_ns)
    assert hand.read().contact is Contact.OPEN
    hand.kernel.down = {48}
    assert hand.read().contact is Contact.CLOSED


@pytest.fixture
def module(tmp_path: Path) -> Iterator[CanHand]:
    hand = CanHand(tmp_path)
    hand.input.open(hand.now_ns)
    yield hand
    hand.input.close()


def test_a_module_that_has_not_sent_yet_stops(module: CanHand) -> None:
    assert module.input.read(module.now_ns).contact is Contact.OPEN
    assert module.input.read(module.now_ns + 16 * MS).contact is Contact.SILENT


def test_a_press_between_two_readings_counts_once(module: CanHand) -> None:
    module.read()
    module.send(b"\x00\x00")
    module.send(b"\x00\x04")
    assert module.read().contact is Contact.OPEN
    assert module.read().contact is Contact.CLOSED


@pytest.mark.parametrize(
    ("data", "fields"),
    [
        (b"\x00\x04", {"identifier": 0x182}),
        (b"\x00\x04", {"is_extended_id": True}),
        (b"", {"is_remote_frame": True, "dlc": 2}),
        (b"\x00\x04", {"is_error_frame": True}),
    ],
)
def test_frames_of_others_do_not_keep_it_closed(module: CanHand, data: bytes, fields: dict[str, Any]) -> None:
    module.read()
    module.put(Contact.SILENT)
    for _ in range(4):
        module.now_ns += 5 * MS
        module.send(data, **fields)
    assert module.input.read(module.now_ns).contact is Contact.SILENT


def test_a_frame_that_is_too_short_is_an_open_contact(module: CanHand) -> None:
    module.read()
    module.send(b"\x04")
    assert module.input.read(module.now_ns).contact is Contact.OPEN


def test_frames_that_are_old_when_they_are_read_do_not_keep_it_closed(module: CanHand) -> None:
    module.read()
    module.put(Contact.SILENT)
    module.input.read(module.now_ns)
    module.send(b"\x00\x04")
    assert module.input.read(module.now_ns + 16 * MS).contact is Contact.SILENT


def test_a_bus_that_breaks_says_so(module: CanHand) -> None:
    module.read()
    module.bus.broken = True
    contact, fault = module.input.read(module.now_ns + 16 * MS)
    assert contact is Contact.SILENT
    assert fault is not None
    assert fault.code is CanFault.RECEIVE_FAILED


class Sometimes(SimulatedInput):
    """Can't be opened at first."""

    refusals = 1

    def open(self, now_ns: int) -> None:
        if self.refusals:
            self.refusals -= 1
            raise HardwareError(StopInputFault.UNPLUGGED, name="pendant")
        super().open(now_ns)


def test_an_input_that_can_not_be_opened_stops_says_why_and_is_tried_again(tmp_path: Path) -> None:
    device = InputDevice(name="pendant", role=InputRole.WEARER, kind="simulated")
    reader = InputReader((device,), (Sometimes(device, tmp_path),))
    reader.poll(MS)
    (reading,) = reader.newest.inputs
    assert (reading.contact, reading.opened_ns) == (Contact.SILENT, MS)
    assert reading.fault is not None
    contacts = []
    for at_ns in (RETRY_NS, RETRY_NS + MS):
        reader.poll(at_ns)
        contacts.append(reader.newest.inputs[0].contact)
    assert contacts == [Contact.SILENT, Contact.CLOSED]
    assert reader.newest.at_ns == RETRY_NS + MS


def test_the_reader_reads_by_itself_until_it_is_closed(tmp_path: Path) -> None:
    device = InputDevice(name="pendant", role=InputRole.WEARER, kind="simulated")
    reader = InputReader((device,), (SimulatedInput(device, tmp_path),))
    reader.start()
    set_simulated(tmp_path, "pendant", Contact.OPEN)
    limit_s = time.monotonic() + 10
    while reader.newest.inputs[0].contact is not Contact.OPEN:
        assert time.monotonic() < limit_s
        time.sleep(0.001)
    reader.close()
    assert not reader._thread.is_alive()


@pytest.mark.parametrize(
    ("fields", "why"),
    [
        ({"kind": "can"}, "needs its can_id"),
        ({"kind": "evdev", "device": "/dev/input/event7"}, "needs its key"),
        ({"kind": "gpiod", "device": "/dev/gpiochip0"}, "needs its line"),
        ({"kind": "can", "can_id": 0x800}, "extended = true"),
    ],
)
def test_a_description_that_can_not_be_read_is_refused(fields: dict[str, Any], why: str) -> None:
    with pytest.raises(ValueError, match=why):
        InputDevice(name="pendant", role=InputRole.WEARER, bus=BusDevice(), **fields)
