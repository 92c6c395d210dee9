"""What is each driver's own: keys and lines of Linux, frames of a CAN module."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from hal.errors import CanFault, HardwareError, StopInputFault
from hal.inputs.device import Contact
from tests.hal.inputs.fakes import MS, FakeLine, FakeModule, FakePedal


@pytest.mark.parametrize("kind", [FakePedal, FakeLine])
def test_a_press_that_is_over_at_the_next_reading_counts_once(kind: type[FakePedal | FakeLine], tmp_path: Path) -> None:
    fake = kind(tmp_path)
    fake.input.open(fake.now_ns)
    fake.read()
    fake.put(Contact.OPEN)
    fake.put(Contact.CLOSED)
    assert [fake.read().contact for _ in range(2)] == [Contact.OPEN, Contact.CLOSED]


def fault_of(made: Any) -> StopInputFault:
    """Why it can't be opened."""
    with pytest.raises(HardwareError) as refused:
        made.input.open(1_000 * MS)
    assert isinstance(refused.value.code, StopInputFault)
    return refused.value.code


def test_a_device_that_can_not_be_read_is_named(tmp_path: Path) -> None:
    assert fault_of(FakePedal(tmp_path, device="/dev/input/event9")) is StopInputFault.NOT_OPENED
    assert fault_of(FakeLine(tmp_path, device="/dev/gpiochip9")) is StopInputFault.NOT_OPENED
    for key in ("KEY_C", "KEY_SPACE"):
        assert fault_of(FakePedal(tmp_path, key=key)) is StopInputFault.NO_SUCH_KEY
    pedal = FakePedal(tmp_path)
    sys.modules["evdev"] = None  # type: ignore[assignment]
    assert fault_of(pedal) is StopInputFault.EXTRA_MISSING


def test_a_keyboard_is_no_pedal_unless_it_is_named_one(tmp_path: Path) -> None:
    keyboard = FakePedal(tmp_path)
    keyboard.kernel.keys = [30, 48, 57]
    assert fault_of(keyboard) is StopInputFault.KEYBOARD
    assert (keyboard.kernel.taken, keyboard.kernel.files) == (False, 0), "the console keeps its keys"
    pedal = FakePedal(tmp_path, keyboard=True)
    pedal.kernel.keys = [30, 48, 57]
    pedal.input.open(pedal.now_ns)
    assert pedal.kernel.taken, "what it types reaches nobody"
    assert pedal.read().contact is Contact.CLOSED


def test_a_switch_that_holds_its_key_down_while_closed(tmp_path: Path) -> None:
    fake = FakePedal(tmp_path, closed=1)
    fake.input.open(fake.now_ns)
    assert fake.read().contact is Contact.OPEN
    fake.kernel.down = {48}
    assert fake.read().contact is Contact.CLOSED


@pytest.fixture
def module(tmp_path: Path) -> Iterator[FakeModule]:
    fake = FakeModule(tmp_path)
    fake.input.open(fake.now_ns)
    yield fake
    fake.input.close()


def test_a_module_that_has_not_sent_yet_stops(module: FakeModule) -> None:
    assert module.input.read(module.now_ns).contact is Contact.OPEN
    assert module.input.read(module.now_ns + 16 * MS).contact is Contact.SILENT


def test_a_press_between_two_readings_counts_once(module: FakeModule) -> None:
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
def test_frames_of_others_do_not_keep_it_closed(module: FakeModule, data: bytes, fields: dict[str, Any]) -> None:
    module.read()
    module.put(Contact.SILENT)
    for _ in range(4):
        module.now_ns += 5 * MS
        module.send(data, **fields)
    assert module.input.read(module.now_ns).contact is Contact.SILENT


def test_a_press_counts_at_once_however_many_frames_of_others_arrive(module: FakeModule) -> None:
    """python-can's own filter ends a reading at the first frame that it drops: what followed waited, unbounded."""
    for contact in (*(Contact.CLOSED,) * 100, Contact.OPEN):
        module.put(contact)
        for identifier in (0x201, 0x202, 0x203):
            module.send(bytes(8), identifier)
        assert module.read().contact is contact


def test_a_frame_that_is_too_short_is_an_open_contact(module: FakeModule) -> None:
    module.read()
    module.send(b"\x04")
    assert module.input.read(module.now_ns).contact is Contact.OPEN


def test_frames_that_are_old_when_they_are_read_do_not_keep_it_closed(module: FakeModule) -> None:
    module.read()
    module.put(Contact.SILENT)
    module.input.read(module.now_ns)
    module.send(b"\x00\x04")
    assert module.input.read(module.now_ns + 16 * MS).contact is Contact.SILENT


def test_a_bus_that_breaks_says_so(module: FakeModule) -> None:
    module.read()
    module.bus.broken = True
    contact, fault = module.input.read(module.now_ns + 16 * MS)
    assert contact is Contact.SILENT
    assert fault is not None
    assert fault.code is CanFault.RECEIVE_FAILED


@pytest.mark.parametrize(("silent_us", "contact"), [(14_999, Contact.CLOSED), (15_001, Contact.SILENT)])
def test_a_silent_module_counts_as_closed_for_15_ms(module: FakeModule, silent_us: int, contact: Contact) -> None:
    module.read()
    module.put(Contact.SILENT)
    assert module.input.read(module.now_ns + silent_us * 1_000).contact is contact


def test_a_closed_module_releases_its_bus(module: FakeModule) -> None:
    module.input.close()
    assert module.bus._is_shutdown
    assert module.input.read(module.now_ns).contact is Contact.SILENT
