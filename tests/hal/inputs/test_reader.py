"""The reader of all stop inputs, and what describes them."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import pytest

from hal.errors import HardwareError, StopInputFault
from hal.inputs.device import Contact, InputDevice, InputRole
from hal.inputs.reader import RETRY_NS, InputReader
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
