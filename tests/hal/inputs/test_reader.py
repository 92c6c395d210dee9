"""The reader of all stop inputs, and what describes them."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any, get_args

import msgspec
import pytest

from hal.errors import HardwareError, StopInputFault
from hal.inputs.can import CanInput
from hal.inputs.device import Contact, ContactReading, InputDevice, InputKind, InputRole
from hal.inputs.linux import EvdevInput, GpioInput
from hal.inputs.reader import RETRY_NS, InputReader, make_input
from hal.inputs.simulated import SimulatedInput, set_simulated
from hal.joints.device import BusDevice
from tests.hal.inputs.fakes import MS


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


DRIVER_OF = {"simulated": SimulatedInput, "can": CanInput, "evdev": EvdevInput, "gpiod": GpioInput}


def described(kind: InputKind) -> InputDevice:
    """With whatever any kind needs."""
    return InputDevice(
        name="pendant", role=InputRole.WEARER, kind=kind, can_id=1, device="/dev/none", key="KEY_B", line=1
    )


@pytest.mark.parametrize("kind", get_args(InputKind))
def test_each_kind_gets_its_own_driver(kind: InputKind, tmp_path: Path) -> None:
    assert type(make_input(described(kind), tmp_path)) is DRIVER_OF[kind]


def test_a_kind_without_a_driver_is_none_and_least_of_all_a_button_that_reads_closed(tmp_path: Path) -> None:
    device = described("can")
    msgspec.structs.force_setattr(device, "kind", "new")
    with pytest.raises(KeyError, match="new"):
        make_input(device, tmp_path)


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


@pytest.mark.parametrize(("can_id", "extended"), [(0x7FF, False), (0x800, True), (0x1FFF_FFFF, True)])
def test_every_identifier_that_a_frame_can_have_is_taken(can_id: int, extended: bool) -> None:
    device = InputDevice(name="pendant", role=InputRole.WEARER, kind="can", can_id=can_id, extended=extended)
    assert (device.can_id, device.extended) == (can_id, extended)


class Late(SimulatedInput):
    """Answers at its third reading."""

    readings, files = 0, 0

    def open(self, now_ns: int) -> None:
        self.files = 1

    def read(self, now_ns: int) -> ContactReading:
        self.readings += 1
        return ContactReading(Contact.CLOSED if self.readings >= 3 else Contact.OPEN)

    def close(self) -> None:
        self.files = 0


def test_the_first_reading_waits_for_an_answer_and_the_end_releases_the_input(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("hal.inputs.reader.FIRST_ANSWER_S", 60.0)
    device = InputDevice(name="pendant", role=InputRole.WEARER, kind="simulated")
    late = Late(device, tmp_path)
    reader = InputReader((device,), (late,))
    reader.start()
    assert reader.newest.inputs[0].contact is Contact.CLOSED
    assert late.files == 1
    reader.close()
    assert late.files == 0


def test_a_reader_without_inputs_starts_no_thread_and_can_be_closed() -> None:
    reader = InputReader((), ())
    reader.start()
    assert not reader._thread.is_alive()
    reader.close()
