"""What every driver of a stop input keeps: closed only while that is proven, whatever else happens means stop."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import get_args

import pytest

from hal.errors import HardwareError
from hal.inputs.device import Contact, InputKind
from tests.hal.inputs.fakes import MS, FakeContact, FakeLine, FakeModule, FakePedal, SimulatedContact

FAKES: dict[str, Callable[[Path], FakeContact]] = {
    "simulated": SimulatedContact,
    "can": FakeModule,
    "evdev": FakePedal,
    "gpiod": FakeLine,
    "gpiod, closed at 0": lambda path: FakeLine(path, closed=0),
}


def test_every_kind_is_held_to_it() -> None:
    missing = set(get_args(InputKind)) - set(FAKES)
    assert not missing, f"nothing here runs over {missing}: add its fake to FAKES in {__file__}"


@pytest.fixture(params=FAKES)
def fake(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[FakeContact]:
    made = FAKES[request.param](tmp_path)
    made.input.open(1_000 * MS)
    yield made
    made.input.close()


def test_closed_lets_the_legs_move_and_nothing_else_does(fake: FakeContact) -> None:
    assert fake.read() == (Contact.CLOSED, None)
    fake.put(Contact.OPEN)
    assert fake.read() == (Contact.OPEN, None)
    fake.put(Contact.CLOSED)
    assert fake.read().contact is Contact.CLOSED
    fake.put(Contact.SILENT)
    contact, fault = fake.read(after_ms=20)
    assert contact is Contact.SILENT
    assert isinstance(fault, HardwareError)
    fake.put(Contact.CLOSED)
    assert fake.read().contact is Contact.CLOSED, "plugged in again"


def test_held_closed_it_stays_closed(fake: FakeContact) -> None:
    assert {fake.read().contact for _ in range(100)} == {Contact.CLOSED}


def test_it_can_be_closed_twice_and_opened_again(fake: FakeContact) -> None:
    fake.input.close()
    fake.input.close()
    fake.input.open(1_000 * MS)
    assert fake.read().contact is Contact.CLOSED


def test_opening_it_again_presses_nothing_and_releases_nothing(fake: FakeContact) -> None:
    fake.put(Contact.OPEN)
    fake.read()
    fake.input.close()
    fake.input.open(1_000 * MS)
    assert fake.read().contact is not Contact.CLOSED
