"""The gait as a map: what it shows is what control's table allows."""

from __future__ import annotations

import dataclasses

import msgspec
import pytest
from textual.app import App, ComposeResult

from app.console.widgets.gait import DARK, LEADS_TO, LIT, RUNNING, GaitPanel, gait_lines, gait_map, signpost
from app.console.widgets.panel import cells
from app.control.gait.table import TABLE
from app.ipc.snapshot import ControlSnapshot
from app.ipc.states import GESTURE_OF, Action, Effect, Event, GaitState
from app.link.clock import ClockEstimate, localized
from app.text.catalogue import tr, use_language
from testing.messages import STANDING, event
from tests.app.console.test_link_shown import MS, folded
from tests.app.console.test_sizes import text_of


def in_state(state: GaitState) -> ControlSnapshot:
    """Nothing runs; every action that the table has from here is allowed."""
    allowed = tuple(dict.fromkeys(row.action for row in TABLE if row.source is state and not row.chained))
    return msgspec.structs.replace(STANDING, state=state, allowed=allowed)


@pytest.mark.parametrize("row", [row for row in TABLE if not row.chained], ids=lambda row: f"{row.action}-{row.source}")
def test_each_way_leads_where_control_leads(row: object) -> None:
    assert row in TABLE
    found = next(each for each in TABLE if each is row)
    assert LEADS_TO.get(found.action) is (found.through or found.to), "LEADS_TO in app/console/widgets/gait.py"


@pytest.mark.parametrize("language", ["en", "zh"])
@pytest.mark.parametrize("state", GaitState)
def test_the_map_has_every_place_once_and_lights_what_is_allowed(language: str, state: GaitState) -> None:
    use_language(language)
    lines = gait_map(in_state(state), 110)
    assert lines, "there is room for it"
    text = text_of(lines)
    for place in GaitState:
        assert sum(text.count(f"{mark} {tr(place)}") for mark in "●○") == 1
    assert text.count("●") == 1
    assert f"● {tr(state)}" in text
    lit = " ".join(text for line in lines for text, style in line if style == LIT)
    for action in in_state(state).allowed:
        assert f" {tr(GESTURE_OF[action])}" in lit, "_LEFT and _RIGHT in app/console/widgets/gait.py"
    assert all(cells(text_of((line,))) <= 110 for line in lines)


def test_why_a_session_did_not_start_is_shown_whole() -> None:
    """A path may be longer than the panel is wide."""
    fault = f"The session's process did not start. See its log in /{'long/' * 20}diagnostics, then start again."
    lines = gait_lines(dataclasses.replace(folded(), snapshot=None, fault=fault), 40, 20)
    assert all(cells(text_of((line,))) <= 40 for line in lines)
    assert "".join(text_of(lines).split()) == "".join(fault.split())


def test_closed_ways_are_thin_and_open_ones_heavy() -> None:
    lines = gait_map(STANDING, 110)
    dark = "".join(text for line in lines for text, style in line if style == DARK)
    lit = "".join(text for line in lines for text, style in line if style == LIT)
    assert not set("━▶◀") & set(dark)
    assert not set("─▷◁") & set(lit)


def test_the_running_action_and_where_it_leads_stand_out() -> None:
    climbing = msgspec.structs.replace(STANDING, allowed=(), action=Action.STAIR_UP, progress=0.3)
    for lines in (gait_map(climbing, 110), signpost(climbing, 40, 6)):
        running = "".join(text for line in lines for text, style in line if style == RUNNING)
        assert f"◎ {tr(GaitState.RIGHT_HIGH_STEP)}" in running


def test_the_signpost_of_the_small_terminal_says_standing_nowhere_again() -> None:
    lines = signpost(STANDING, 40, 6)
    assert len(lines) == len(STANDING.allowed)
    for action, line in zip(STANDING.allowed, lines, strict=True):
        assert tr(action) in text_of((line,))
    assert tr(GaitState.STANDING) not in text_of(lines)


@pytest.mark.parametrize("language", ["en", "zh"])
@pytest.mark.parametrize("width", [40, 110])
def test_an_action_outside_the_vocabulary_is_shown_with_its_key_only(language: str, width: int) -> None:
    use_language(language)
    without = msgspec.structs.replace(STANDING, by_key_only=(Action.STAIR_UP, Action.STEP_LEFT))
    drawn = text_of(gait_map(without, width) or signpost(without, width, 12))
    usual = text_of(gait_map(STANDING, width) or signpost(STANDING, width, 12))
    assert tr("machine.by_key") in drawn
    assert f" {tr(GESTURE_OF[Action.STAIR_UP])} " in usual
    assert f" {tr(GESTURE_OF[Action.STAIR_UP])} " not in drawn
    assert f" {tr(GESTURE_OF[Action.WALK])} " in drawn


class ShownGait(App[None]):
    """The panel alone, without a session's screen that updates it."""

    CSS = "GaitPanel { height: 12; }"

    def compose(self) -> ComposeResult:
        yield GaitPanel()


async def test_an_event_of_a_second_computer_is_drawn_at_once_and_then_no_oftener_than_here() -> None:
    """Its moment is told anew with every snapshot."""
    state = folded()
    refused = event(Event.CONSOLE_TIMEOUT, Effect.REFUSE, 9_000)
    walking = msgspec.structs.replace(
        STANDING, at_ns=state.now_ns, action=Action.WALK, allowed=(), progress=0.1, events=(refused,)
    )
    again = localized(msgspec.structs.replace(walking, progress=0.7), ClockEstimate(0, 0, 1))
    over = msgspec.structs.replace(again, events=())
    async with ShownGait().run_test(size=(60, 12)) as pilot:
        panel = pilot.app.query_one(GaitPanel)
        shown = []
        for at_ms, snapshot in ((0, walking), (50, walking), (100, again), (150, over)):
            panel.show(dataclasses.replace(state, snapshot=snapshot, now_ns=state.now_ns + at_ms * MS))
            shown.append([percent for percent in ("10%", "70%") if percent in panel.text])
    assert shown == [["10%"], ["10%"], ["10%"], ["70%"]]
