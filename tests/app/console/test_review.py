"""The review screen in the real console: opens, moves, jumps, comments, and shows what was tampered with."""

from __future__ import annotations

import threading
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import msgspec
import pytest
from textual.pilot import Pilot

from app.console.app import ConsoleApp
from app.console.review_data import ReviewedSession, comments_on, open_session, write_comment
from app.console.screens import review
from app.console.screens.patients import PatientsScreen
from app.console.screens.review import ReviewScreen
from app.console.screens.review_dialogs import ChooseSession, WriteComment, sessions_of
from app.console.screens.signin import LockScreen
from app.console.widgets.timeline import LANES, Timeline, about
from app.ipc.states import Event, GaitState
from app.system.config import Config
from app.system.paths import Home
from app.text.catalogue import render, use_language
from logs.comments import comments_path
from logs.disk import Disk
from logs.errors import AuditError, AuditFault
from logs.keys import by_fingerprint, known_keys, load_or_make_key
from logs.read import NOT_A_RECORD, outline, records, session_paths
from logs.reason import reason
from logs.records import Body, Button, Comment, EventRaised, GestureOnset, Note, Press, ProcessStart, Record
from logs.verify import Evidence, exit_status, verify
from testing.authors import signed_in
from testing.fake_host import screen_text
from testing.trails import write_sample
from tests.app.console.conftest import wait_until
from tests.support.audit_trails import LAPTOP, write_session
from tests.support.live_session import written


@pytest.fixture
def home(tmp_path: Path) -> Home:
    """A home with one session of ten minutes."""
    write_sample(tmp_path, minutes=10)
    return Home(tmp_path)


@pytest.fixture
def session(home: Home) -> ReviewedSession:
    """That session, read."""
    return open_session(next(path for path in home.logs.glob("2*.jsonl")))


def on_file(path: Path) -> dict[int, list[Comment]]:
    """The comments on a session, whoever signed them."""
    return comments_on(open_session(path), Evidence())[0]


async def opened(app: ConsoleApp, pilot: Pilot[None], screen: ReviewScreen) -> None:
    """The screen on top of the console's first one."""
    await wait_until(pilot, lambda: isinstance(app.screen, PatientsScreen))
    await app.push_screen(screen)


def test_the_bands_agree_with_the_records(session: ReviewedSession) -> None:
    assert len(session) > 800
    for lane in (session.lanes.state, session.lanes.gesture, session.lanes.press):
        assert lane
        for before, after in pairwise(lane):
            assert before.begin_s <= before.end_s <= after.begin_s
    states = [span.label for span in session.lanes.state]
    assert {"standing", "sitting"} <= set(states)


@pytest.mark.parametrize(
    "begins", [ProcessStart(pid=2), Button(mode="robust", x_px=1, y_px=1, radius_px=1, threshold_m=0.2)]
)
def test_a_press_that_a_killed_perception_left_ends_where_the_next_begins(tmp_path: Path, begins: Body) -> None:
    bodies: list[tuple[str, Body]] = [
        ("perception", GestureOnset(gesture="5", confidence=1.0)),
        ("perception", Press(gesture="5")),
        ("control", ProcessStart(pid=1)),
        ("perception", begins),
        ("perception", Note(text="later")),
    ]
    written(tmp_path, [(process, (number + 1) * 1_000_000_000, body) for number, (process, body) in enumerate(bodies)])
    lanes = open_session(tmp_path / "logs" / "s.jsonl").lanes
    for lane, begin_s in ((lanes.gesture, 1.0), (lanes.press, 2.0)):
        (span,) = lane
        assert span.label == "5"
        assert (span.begin_s, span.end_s) == pytest.approx((begin_s, 4.0))


def test_every_moment_is_reported_by_the_records_before_it(session: ReviewedSession) -> None:
    for index in range(0, len(session), 37):
        instant = session.instant(index)
        assert session.time(session.index_at(instant.at_s)) == instant.at_s
        assert isinstance(instant.record, Record)
    assert session.instant(len(session) - 1).joints is not None


def test_jumps_stop_at_landmarks_and_come_back(session: ReviewedSession) -> None:
    index = session.landmark_after(0)
    observed = []
    while index is not None:
        observed.append(index)
        index = session.landmark_after(index)
    back = session.landmark_before(len(session))
    for expected in reversed(observed):
        assert back == expected
        back = session.landmark_before(back)
    assert back is None
    raised = [i for i in range(len(session)) if isinstance(getattr(session.record(i), "body", None), EventRaised)]
    assert set(raised) <= set(observed)


def test_lines_that_are_no_records_are_shown_as_such(tmp_path: Path) -> None:
    path = tmp_path / "odd.jsonl"
    path.write_bytes(b'\x00\xff\x1b[2J\n{"body":{"kind":"from-the-future"},"monotonic_ns":5,"wall":"x"}\n[]\n')
    session = open_session(path)
    assert [getattr(session.record(i), "kind", "") for i in range(3)] == [
        NOT_A_RECORD,
        "from-the-future",
        NOT_A_RECORD,
    ]
    (tmp_path / "empty.jsonl").touch()
    with pytest.raises(AuditError) as raised:
        open_session(tmp_path / "empty.jsonl")
    assert raised.value.code is AuditFault.TRAIL_EMPTY


@pytest.mark.parametrize("size", [(80, 24), (200, 50)])
async def test_a_reviewer_finds_the_events_and_comments_on_one(home: Home, size: tuple[int, int]) -> None:
    app = ConsoleApp(home, Config())
    async with app.run_test(size=size) as pilot:
        screen = ReviewScreen(home, "last")
        await opened(app, pilot, screen)
        await wait_until(pilot, lambda: "SOUND" in screen_text(app))
        await pilot.press("n")
        first = screen.index
        assert first > 0
        await pilot.press("n", "p")
        assert screen.index == first
        await pilot.press("plus", "plus", "right", "end", "home", "minus")
        assert screen.index == 0
        await pilot.press("n", "c")
        assert isinstance(app.screen, WriteComment)
        await pilot.press(*"seen", "enter")
        path = next(home.logs.glob("2*[0-9a-f].jsonl"))
        await wait_until(pilot, lambda: comments_path(path).exists() and first in on_file(path))
        await wait_until(pilot, lambda: "✎" in screen_text(app))
    (comment,) = on_file(path)[first]
    assert comment.text == "seen"
    evidence = Evidence(keys=by_fingerprint(known_keys(home.keys)))
    assert exit_status(verify([home.logs], evidence)) == 0


async def test_without_a_name_it_asks_which(home: Home) -> None:
    app = ConsoleApp(home, Config())
    async with app.run_test(size=(100, 30)) as pilot:
        screen = ReviewScreen(home)
        await opened(app, pilot, screen)
        await wait_until(pilot, lambda: isinstance(app.screen, ChooseSession))
        (path,) = session_paths(home.logs)
        await wait_until(pilot, lambda: f"{path.stem}  {outline(path).patient}" in screen_text(app))
        await pilot.press("enter")
        await wait_until(pilot, lambda: screen.session is not None)


async def test_what_is_found_while_locked_opens_after_the_lock(home: Home, monkeypatch: pytest.MonkeyPatch) -> None:
    begun, may_end, usual = threading.Event(), threading.Event(), sessions_of

    def waits(folder: Path) -> list[tuple[Path, str]]:
        begun.set()
        assert may_end.wait(20)
        return usual(folder)

    monkeypatch.setattr(review, "sessions_of", waits)
    app = ConsoleApp(home, Config())
    async with app.run_test(size=(100, 30)) as pilot:
        screen = ReviewScreen(home)
        await opened(app, pilot, screen)
        await wait_until(pilot, begun.is_set)
        await pilot.press("ctrl+l")
        await wait_until(pilot, lambda: isinstance(app.screen, LockScreen))
        may_end.set()
        await wait_until(pilot, lambda: not screen._resumed.is_set())
        await pilot.press("escape")
        assert isinstance(app.screen, LockScreen)
        await pilot.press("enter")
        await wait_until(pilot, lambda: isinstance(app.screen, ChooseSession))
        await wait_until(pilot, lambda: "P-017" in screen_text(app))
        await pilot.press("enter")
        await wait_until(pilot, lambda: screen.session is not None)


async def test_a_changed_record_is_reported_on_top(home: Home) -> None:
    path = next(home.logs.glob("2*.jsonl"))
    path.write_bytes(path.read_bytes().replace(b"Tired after the stairs", b"Rested after the climb"))
    app = ConsoleApp(home, Config())
    async with app.run_test(size=(100, 30)) as pilot:
        await opened(app, pilot, ReviewScreen(home, "last"))
        await wait_until(pilot, lambda: "TAMPERED" in screen_text(app))


async def test_the_trail_of_the_laptop_says_where_controls_records_are(tmp_path: Path) -> None:
    home = Home(tmp_path)
    home.logs.mkdir()
    write_session(home.logs, "20260921T141320Z-abcd", load_or_make_key(home.keys), Disk(), start=LAPTOP)
    app = ConsoleApp(home, Config())
    async with app.run_test(size=(100, 30)) as pilot:
        await opened(app, pilot, ReviewScreen(home, "last"))
        await wait_until(pilot, lambda: "of the computer exo" in screen_text(app))


async def test_forged_comments_are_not_shown_and_that_is_told(home: Home) -> None:
    path = next(home.logs.glob("2*[0-9a-f].jsonl"))
    write_comment(signed_in(home), path, records(path)[0], "was tired")
    journal = comments_path(path)
    journal.write_bytes(journal.read_bytes().replace(b"was tired", b"was drunk"))
    app = ConsoleApp(home, Config())
    async with app.run_test(size=(100, 30)) as pilot:
        screen = ReviewScreen(home, "last")
        await opened(app, pilot, screen)
        await wait_until(pilot, lambda: "not shown: TAMPERED" in " ".join(screen_text(app).split()))
        assert "SOUND" in screen_text(app)
        assert not {"✎", "drunk"} & set(screen_text(app).split())


@pytest.mark.parametrize("slow", ["open_session", "verify"])
async def test_asking_for_the_recording_stops_neither_opening_nor_verifying(
    home: Home, monkeypatch: pytest.MonkeyPatch, slow: str
) -> None:
    begun, may_end = threading.Event(), threading.Event()
    usual = getattr(review, slow)

    def waits(*arguments: object) -> object:
        begun.set()
        assert may_end.wait(20)
        return usual(*arguments)

    monkeypatch.setattr(review, slow, waits)
    app = ConsoleApp(home, Config())
    async with app.run_test(size=(100, 30)) as pilot:
        await opened(app, pilot, ReviewScreen(home, "last"))
        await wait_until(pilot, begun.is_set)
        await pilot.press("r")
        await wait_until(pilot, lambda: not any(worker.name == "action_replay" for worker in app.workers))
        may_end.set()
        await wait_until(pilot, lambda: "SOUND" in screen_text(app))


async def test_no_session_is_reported_and_left(tmp_path: Path) -> None:
    app = ConsoleApp(Home(tmp_path), Config())
    async with app.run_test(size=(100, 30)) as pilot:
        await opened(app, pilot, ReviewScreen(Home(tmp_path)))
        await wait_until(pilot, lambda: isinstance(app.screen, PatientsScreen))


def test_a_note_of_the_sample_is_among_the_records(session: ReviewedSession) -> None:
    notes = [session.record(i) for i in range(len(session) - 5, len(session))]
    assert any(isinstance(record, Record) and isinstance(record.body, Note) for record in notes)


async def test_recorded_states_are_told_in_the_language_in_use(home: Home, session: ReviewedSession) -> None:
    app = ConsoleApp(home, Config(language="zh"))
    async with app.run_test(size=(120, 36)) as pilot:
        await opened(app, pilot, ReviewScreen(home, "last"))
        await wait_until(pilot, lambda: "SOUND" in screen_text(app) or "完好" in screen_text(app))
        timeline = app.screen.query_one(Timeline)
        states = timeline.render_line(LANES.index("state")).text
        assert "站立" in states
        assert GaitState.STANDING.value not in states
        standing = next(span for span in session.lanes.state if span.label == GaitState.STANDING.value)
        assert "状态: 站立" in about(session.instant(session.index_at(standing.begin_s)), []).plain
        widths = {timeline.render_line(lane).cell_length for lane in range(len(LANES))}
        assert widths == {timeline.size.width}


def test_the_events_of_a_moment_are_told_in_the_language_in_use(tmp_path: Path) -> None:
    bodies: list[Body] = [
        EventRaised(event="following-limit", effect="hold", text=reason(Event.FOLLOWING_LIMIT, angle_rad=0.2)),
        EventRaised(event="from-the-future", effect="note", text=None),
    ]
    written(tmp_path, [("control", (number + 1) * 1_000_000_000, body) for number, body in enumerate(bodies)])
    session = open_session(tmp_path / "logs" / "s.jsonl")
    for language in ("en", "zh"):
        use_language(language)
        shown = about(session.instant(len(session) - 1), []).plain
        assert render(reason(Event.FOLLOWING_LIMIT, angle_rad=0.2)) in shown
        assert "from-the-future" in shown
        assert "following-limit" not in shown


def test_a_records_reason_is_told_in_words(session: ReviewedSession) -> None:
    instant = session.instant(0)
    assert isinstance(instant.record, Record)
    why = reason(Event.NOT_ARMED)
    raised = msgspec.structs.replace(instant.record, body=EventRaised(event="not-armed", effect="refuse", text=why))
    shown = about(replace(instant, record=raised), []).plain
    assert f"text: {render(why)}" in shown
