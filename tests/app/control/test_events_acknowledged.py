"""Events that stay, acknowledgements, and which event of several counts."""

from __future__ import annotations

from app.control.events.table import ROW
from app.ipc.messages import OperatorKind
from app.ipc.states import Effect
from tests.app.control.causes import CAUSES, E, rig_with


def test_an_acknowledgement_covers_only_what_was_raised_before_it_was_sent() -> None:
    rig = rig_with(E.STOP)
    rig.send(OperatorKind.ACKNOWLEDGE, age_ms=50)
    rig.tick()
    assert E.STOP.value in rig.events()
    rig.send(OperatorKind.ACKNOWLEDGE)
    rig.tick()
    assert rig.events() == set()


def test_an_acknowledged_condition_that_still_holds_keeps_its_effect_until_it_goes() -> None:
    rig = rig_with(E.OVER_TEMPERATURE)
    rig.send(OperatorKind.ACKNOWLEDGE)
    rig.tick(10)
    assert rig.state is not None
    assert rig.state.effect is Effect.HOLD
    CAUSES[E.OVER_TEMPERATURE].cure(rig)
    rig.tick()
    assert rig.events() == set()


def test_an_event_that_comes_back_has_to_be_acknowledged_again() -> None:
    rig = rig_with(E.DRIVE_FAULT)
    CAUSES[E.DRIVE_FAULT].cure(rig)
    rig.tick()
    rig.send(OperatorKind.ACKNOWLEDGE)
    rig.tick()
    assert rig.events() == set()
    CAUSES[E.DRIVE_FAULT].make(rig)
    rig.tick()
    CAUSES[E.DRIVE_FAULT].cure(rig)
    rig.tick(5)
    assert E.DRIVE_FAULT.value in rig.events()


def test_the_strongest_event_stands_first() -> None:
    rig = rig_with(E.TICK_LATE)
    rig.send(OperatorKind.STOP)
    CAUSES[E.DRIVE_UNTRUSTED].make(rig)
    rig.tick()
    assert rig.state is not None
    effects = [ROW[one.event].effect for one in rig.state.events]
    assert effects == sorted(effects, reverse=True)
    assert effects[0] is Effect.DAMP
    assert rig.state.effect is Effect.DAMP
