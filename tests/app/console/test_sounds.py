"""What rings the terminal's bell, and the switches."""

from __future__ import annotations

from dataclasses import replace

import pytest

from app.console.app import ConsoleApp
from app.console.spoken import Sound, sounds_of, switched_on
from app.console.state import SessionState
from app.ipc.states import Effect
from app.system.config import Config, SoundsConfig
from tests.app.console.conftest import Opener
from tests.app.console.test_sizes import READY, with_report, with_snapshot


@pytest.mark.parametrize(
    ("now", "wanted"),
    [
        (READY, set()),
        (with_report(pressed=True), {Sound.PRESS}),
        (with_report(release_count=1), {Sound.RELEASE}),
        (with_report(cancel_count=1), {Sound.REFUSAL}),
        (with_report(release_count=1, incarnation=2), set()),
        (with_snapshot(refusal_count=1), {Sound.REFUSAL}),
        (with_snapshot(effect=Effect.PAUSE), set()),
        (with_snapshot(effect=Effect.HOLD), {Sound.STOP}),
        (replace(READY, now_ns=READY.now_ns + 60_000_000_000), {Sound.STOP}),
    ],
)
def test_what_is_heard(now: SessionState, wanted: set[Sound]) -> None:
    assert sounds_of(READY, now) == wanted
    assert sounds_of(None, now) == frozenset()
    assert sounds_of(now, now) == frozenset()


def test_a_second_stop_is_heard_and_its_end_is_not() -> None:
    held, damped = with_snapshot(effect=Effect.HOLD), with_snapshot(effect=Effect.DAMP)
    assert sounds_of(held, damped) == {Sound.STOP}
    assert sounds_of(damped, held) == sounds_of(held, READY) == frozenset()


@pytest.mark.parametrize("sound", Sound)
def test_each_has_its_switch(sound: Sound) -> None:
    off = dict.fromkeys((one.value for one in Sound), False)
    assert switched_on(SoundsConfig(**off)) == frozenset()
    assert switched_on(SoundsConfig(**{**off, sound.value: True})) == {sound}


async def test_the_bell_rings_for_a_stop_and_not_when_switched_off(
    console: Opener, monkeypatch: pytest.MonkeyPatch
) -> None:
    rung: list[Effect | None] = []

    def bell(app: ConsoleApp) -> None:
        state = app.live_state()
        rung.append(None if state is None else state.effect)

    monkeypatch.setattr(ConsoleApp, "bell", bell)
    async with console(config=Config(sounds=SoundsConfig(press=True))) as opened:
        opened.host.pressed = True
        await opened.until(lambda: rung == [Effect.NOTE])
        await opened.press("space")
        await opened.until(lambda: rung == [Effect.NOTE, Effect.HOLD])
        await opened.press("k", "y")
        await opened.until(lambda: (state := opened.app.live_state()) and state.effect is Effect.NOTE)
        await opened.press("ctrl+p", *"Sound:stop")
        await opened.shows("Sound: stop")
        await opened.press("enter")
        await opened.tells("Sound: stop: off.")
        opened.host.effect = Effect.HOLD
        await opened.until(lambda: (state := opened.app.live_state()) and state.effect is Effect.HOLD)
        assert rung == [Effect.NOTE, Effect.HOLD]
