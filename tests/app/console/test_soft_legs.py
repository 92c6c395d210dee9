"""Legs that are damped or have no power while a stop is in force, or after its acknowledgement: nothing says held."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import pytest

from app.console.guidance import next_step
from app.console.state import SessionState
from app.console.widgets.large import large_lines
from app.console.widgets.letters import large
from app.console.widgets.status import status_line
from app.ipc.states import Effect, Event, GaitState
from app.text.catalogue import tr, use_language
from testing.fake_host import screen_text
from testing.messages import event
from tests.app.console.conftest import Opener
from tests.app.console.test_sizes import KEYS, READY, text_of

DAMPED = {"enabled": True, "damped": True, "state": GaitState.BETWEEN}
JUST_POWERED = {"enabled": True, "damped": False, "state": GaitState.UNPOWERED}
OFF = {"enabled": False, "damped": False, "state": GaitState.UNPOWERED}


def changed(**more: object) -> SessionState:
    """A ready session whose control reports this."""
    assert READY.snapshot is not None
    return replace(READY, snapshot=msgspec.structs.replace(READY.snapshot, **more))


@pytest.mark.parametrize(
    ("legs", "words"), [(DAMPED, "LEGS DAMPED"), (JUST_POWERED, "LEGS DAMPED"), (OFF, "JOINTS OFF")]
)
async def test_a_stop_on_legs_that_bear_nothing_does_not_say_that_they_are_held(
    console: Opener, legs: dict[str, object], words: str
) -> None:
    async with console(size=(120, 36)) as opened:
        opened.host.events = (event(Event.STOP, Effect.HOLD),)
        opened.host.walked = {"effect": Effect.HOLD, **legs}
        await opened.shows("Support the patient")
        await opened.until(lambda: screen_text(opened.app).splitlines()[0].count(words))
        assert f"■ {words} ■" in screen_text(opened.app)
        assert "held" not in screen_text(opened.app).lower()
        await opened.press("b")
        await opened.shows(large(words, 118, 28)[0])


@pytest.mark.parametrize("code", ["en", "zh"])
@pytest.mark.parametrize(
    ("legs", "name"), [(DAMPED, "damped"), (JUST_POWERED, "damped"), (OFF, "off"), ({"enabled": True}, "held")]
)
def test_status_line_and_large_letters_say_what_the_legs_do(code: str, legs: dict[str, object], name: str) -> None:
    use_language(code)
    state = changed(effect=Effect.HOLD, **legs)
    assert tr(f"legs.{name}").upper() in text_of(status_line(state, 200, "i"))
    drawn = large(tr(f"legs.{name}"), 118, 24) or large("STOP", 118, 24)  # the font has no Chinese
    assert drawn[0] in text_of(large_lines(state, KEYS, 118, 28, watching=False))


def test_damped_legs_are_told_after_their_acknowledgement_until_a_movement_grips_them() -> None:
    soft = changed(effect=Effect.NOTE, **DAMPED)
    assert next_step(soft)[0] == "slack"
    assert tr("legs.damped").upper() in text_of(status_line(soft, 80, "i"))
    unconfirmed = changed(effect=Effect.NOTE, patient_confirmed=False, armed=False, **DAMPED)
    assert next_step(unconfirmed)[0] == "slack"
    for firm in (changed(enabled=True, damped=False), changed(effect=Effect.NOTE, **(DAMPED | {"enabled": False}))):
        assert next_step(firm)[0] != "slack"
        assert tr("legs.damped").upper() not in text_of(status_line(firm, 200, "i"))


@pytest.mark.parametrize("code", ["en", "zh"])
async def test_the_screen_says_after_the_acknowledgement_that_the_legs_are_soft(console: Opener, code: str) -> None:
    async with console(size=(80, 24)) as opened:
        use_language(code)
        opened.host.confirmed = opened.host.armed = True
        opened.host.walked = {"effect": Effect.NOTE, **DAMPED}
        await opened.shows(tr("guide.slack", act="t", torque_off="o"))
        await opened.until(lambda: tr("legs.damped").upper() in screen_text(opened.app).splitlines()[0])
