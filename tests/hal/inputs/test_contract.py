"""What every driver of a stop input keeps: closed only while that is proven, whatever else happens means stop."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

import can
import pytest

from hal.errors import CanFault, HardwareError, StopInputFault
from hal.inputs.can import CanInput
from hal.inputs.device import InputDevice, InputRole
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


@pytest.fixture(params=[SimulatedHand, CanHand])
def hand(request: pytest.FixtureRequest, tmp_path: Path) -> Hand:
    made: Hand = request.param(tmp_path)
    made.input.open(1_000 * MS)
    return made


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


@pytest.fixture
def module(tmp_path: Path) -> CanHand:
    hand = CanHand(tmp_path)
    hand.input.open(hand.now_ns)
    return hand


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
        ({"kind": "can", "can_id": 0x800}, "extended = true"),
    ],
)
def test_a_description_that_can_not_be_read_is_refused(fields: dict[str, Any], why: str) -> None:
    with pytest.raises(ValueError, match=why):
        InputDevice(name="pendant", role=InputRole.WEARER, bus=BusDevice(), **fields)
