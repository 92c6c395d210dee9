"""g opens the guided tests: a line while one runs, its result in the trail and after the session; nothing is moved."""

from __future__ import annotations

from dataclasses import replace
from math import inf

import pytest
from textual.css.query import NoMatches

from app.console.screens.after import AfterScreen
from app.console.screens.dialogs import GuidedTestChoice
from app.console.widgets.panel import Panel, cells
from app.console.widgets.status import guided_line
from app.ipc.messages import OperatorKind
from app.ipc.snapshot import ActionReport
from app.ipc.states import Action, GaitState, Outcome, Source
from app.outcomes.guided import PROCEDURES, GuidedRefusal, GuidedRun, GuidedStop, GuidedTest
from app.text.catalogue import tr, use_language
from logs.reason import key_of
from logs.records import Body, GuidedTestResult
from testing.fake_host import FakeHost, walk_steps
from tests.app.console.conftest import Console, Opener

MINUTE_NS = 60_000_000_000


@pytest.fixture(autouse=True)
def slow_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    """The machine of the tests may stand still between two snapshots; tests/app/outcomes has what comes of it."""
    monkeypatch.setattr("app.outcomes.guided.UNOBSERVED_S", inf)


def results(trail: list[Body]) -> list[GuidedTestResult]:
    return [one for one in trail if isinstance(one, GuidedTestResult)]


def line(opened: Console) -> str:
    """The test's line; empty without one."""
    try:
        panel = opened.app.screen.query_one("#guided", Panel)
    except NoMatches:
        return ""
    return panel.text if panel.display else ""


def moves(host: FakeHost) -> list[OperatorKind]:
    return [kind for kind in host.kinds() if kind is not OperatorKind.HEARTBEAT]


def reported_state(opened: Console) -> GaitState | None:
    state = opened.app.live_state()
    return state.snapshot.state if state is not None and state.snapshot is not None else None


async def begun(opened: Console, test: GuidedTest) -> None:
    """Chosen by its digit, from the state that it begins in."""
    opened.host.state = PROCEDURES[test].begins_in
    await opened.until(lambda: reported_state(opened) is opened.host.state)
    await opened.press("g")
    await opened.until(lambda: isinstance(opened.app.screen, GuidedTestChoice))
    await opened.press(str([*GuidedTest].index(test) + 1))
    await opened.until(lambda: tr(test) in line(opened))


async def test_ten_metres_from_the_key_to_the_screen_after_the_session(console: Opener, trail: list[Body]) -> None:
    async with console(size=(120, 36)) as opened:
        await begun(opened, GuidedTest.TEN_METRE_WALK)
        assert tr("guided.waits") in line(opened)
        walk_steps(opened.host, 10)
        await opened.until(lambda: "7.0 m left" in line(opened) and "steps 10" in line(opened))
        assert "0:0" in line(opened)
        assert results(trail) == []
        walk_steps(opened.host, 34)
        await opened.until(lambda: results(trail))
        (result,) = results(trail)
        assert (result.test, result.outcome, result.steps) == ("ten metre walk", "completed", 34)
        assert result.distance_m == pytest.approx(10.2)
        assert result.speed_m_s == pytest.approx(10.2 / result.duration_s)
        await opened.tells("10-metre walk test: done")
        await opened.until(lambda: not line(opened))
        assert moves(opened.host) == []
        await opened.app.end_session()
        await opened.until(lambda: isinstance(opened.app.screen, AfterScreen))
        await opened.shows("10-metre walk test: done")
        assert results(trail) == [result]


async def test_six_minutes_end_by_themselves(console: Opener, trail: list[Body]) -> None:
    async with console(size=(80, 24)) as opened:
        await begun(opened, GuidedTest.SIX_MINUTE_WALK)
        walk_steps(opened.host, 5)
        await opened.until(lambda: "5:5" in line(opened) and "left" in line(opened))
        run = opened.app.guided.run
        assert run is not None
        opened.app.guided.run = replace(run, began_ns=run.began_ns - 6 * MINUTE_NS)  # as if begun then
        await opened.until(lambda: results(trail))
        (result,) = results(trail)
        assert (result.outcome, result.duration_s, result.steps) == ("completed", 360.0, 5)


async def test_up_and_go_is_over_with_the_patient_seated(console: Opener, trail: list[Body]) -> None:
    async with console(size=(80, 24)) as opened:
        await begun(opened, GuidedTest.TIMED_UP_AND_GO)
        opened.host.state = GaitState.STANDING
        walk_steps(opened.host, 20)
        await opened.until(lambda: tr("guided.sit") in line(opened))
        sat = ActionReport(
            number=2,
            action=Action.SIT_DOWN,
            source=Source.THERAPIST,
            from_state=GaitState.STANDING,
            outcome=Outcome.COMPLETED,
            ended_ns=opened.host.clock(),
        )
        opened.host.walked["reports"] += (sat,)
        await opened.until(lambda: results(trail))
        (result,) = results(trail)
        assert (result.outcome, result.ended_ns, result.speed_m_s) == ("completed", sat.ended_ns, None)


async def test_the_key_stops_it_after_asking(console: Opener, trail: list[Body]) -> None:
    async with console(size=(80, 24)) as opened:
        await begun(opened, GuidedTest.SIX_MINUTE_WALK)
        walk_steps(opened.host, 4)
        await opened.until(lambda: "1.2 m" in line(opened))
        await opened.press("g")
        await opened.shows(tr("guided.stop.title"))
        await opened.press("n")
        await opened.until(lambda: "1.2 m" in line(opened))
        assert results(trail) == []
        await opened.press("g", "y")
        await opened.until(lambda: results(trail))
        (result,) = results(trail)
        assert (result.outcome, result.steps) == ("stopped", 4)
        assert result.reason is not None
        assert not isinstance(result.reason, str)
        assert result.reason.code == key_of(GuidedStop.BY_KEY)
        assert moves(opened.host) == []


async def test_stop_ends_it_and_stays_stop(console: Opener, trail: list[Body]) -> None:
    async with console(size=(80, 24)) as opened:
        await begun(opened, GuidedTest.TEN_METRE_WALK)
        walk_steps(opened.host, 4)
        await opened.until(lambda: "1.2 m" in line(opened))
        await opened.press("space")
        await opened.until(lambda: results(trail))
        assert moves(opened.host) == [OperatorKind.STOP]
        (result,) = results(trail)
        assert (result.outcome, result.steps) == ("stopped", 4)
        assert getattr(result.reason, "code", "") == "Event.STOP"
        await opened.press("g", "1")
        await opened.tells(tr(GuidedRefusal.HELD))
        assert not line(opened)


@pytest.mark.parametrize("leave", ["end", "quit"])
async def test_the_sessions_end_keeps_what_was_walked(console: Opener, trail: list[Body], leave: str) -> None:
    async with console(size=(80, 24)) as opened:
        await begun(opened, GuidedTest.TEN_METRE_WALK)
        walk_steps(opened.host, 4)
        await opened.until(lambda: "1.2 m" in line(opened))
        if leave == "end":
            await opened.app.end_session()
            await opened.until(lambda: isinstance(opened.app.screen, AfterScreen))
            await opened.shows("stopped (the session ended)")
        else:
            await opened.app.action_leave()
            await opened.until(lambda: opened.host.closed)
        (result,) = results(trail)
        assert (result.steps, getattr(result.reason, "code", "")) == (4, key_of(GuidedStop.SESSION_ENDED))


async def test_a_test_that_can_not_begin_says_why(console: Opener, trail: list[Body]) -> None:
    async with console(size=(80, 24)) as opened:
        for digit, refused in (("1", GuidedRefusal.NOT_STANDING), ("3", GuidedRefusal.NOT_SITTING)):
            await opened.press("g", digit)
            await opened.tells(tr(refused))
        await opened.press("g", "escape")
        assert opened.app.guided.run is None
        assert results(trail) == []


async def test_who_only_watches_begins_none(console: Opener, trail: list[Body]) -> None:
    async with console(size=(80, 24), read_only=True) as opened:
        opened.host.state = GaitState.STANDING
        await opened.press("g", "1")
        assert opened.app.guided.run is None


async def test_the_palette_offers_them(console: Opener) -> None:
    async with console(size=(120, 36)) as opened:
        await opened.press("ctrl+p")
        await opened.press(*"guided")
        await opened.shows(tr("bind.guided"))
        await opened.press("enter")
        await opened.until(lambda: isinstance(opened.app.screen, GuidedTestChoice))


@pytest.mark.parametrize("test", GuidedTest)
@pytest.mark.parametrize("language", ["en", "zh"])
def test_the_line_cuts_no_part(test: GuidedTest, language: str) -> None:
    use_language(language)
    run = GuidedRun(
        test=test,
        incarnation=1,
        started_ns=1,
        steps_before=0,
        distance_before_m=0.0,
        began_ns=1,
        at_ns=2 * MINUTE_NS,
        steps=12,
        distance_m=3.6,
    )
    widths = range(121)
    texts = ["".join(text for text, _ in guided_line(run, "G", width)[0]) for width in widths]
    assert all(cells(text) <= width for text, width in zip(texts, widths, strict=True))
    assert tr("guided.key", key="G") in texts[-1]
    assert "1:59" in texts[60]
