"""Another language by its key: what was shown, typed, chosen and focused is still there."""

from __future__ import annotations

from datetime import UTC, datetime

import pytest
from msgspec.structs import replace
from textual.containers import VerticalScroll
from textual.widgets import DataTable, Input, Select, Static

from app.console.app import ConsoleApp
from app.console.screens.calibration import FARTHEST_CM, NEAREST_CM
from app.console.screens.dialogs import TherapistAct
from app.console.screens.patients import PatientsScreen
from app.console.screens.review import ReviewScreen
from app.console.screens.review_dialogs import ChooseSession, WriteComment
from app.ipc.messages import OperatorKind
from app.system.config import Config
from app.system.paths import Home
from app.text.catalogue import ask_language, tr
from profiles.schema import DEMO_PATIENT
from testing.authors import Named
from testing.fake_host import screen_text
from testing.trails import write_sample
from tests.app.console.conftest import Opener, wait_until


async def test_the_list_keeps_its_patients_and_cursor(console: Opener) -> None:
    async with console(profile=None) as opened:
        now = datetime.now(UTC)
        opened.app.store.create(replace(DEMO_PATIENT, identifier="P-2"), by=Named("Ada"), at=now)
        screen = opened.app.screen
        assert isinstance(screen, PatientsScreen)
        screen.reload()
        table = screen.query_one(DataTable)
        other = table.get_row_index("P-2")
        await opened.press(*["down" if other else "up"])
        await opened.until(lambda: table.cursor_row == other)
        await opened.press("f3")
        await opened.shows("新建")
        table = screen.query_one(DataTable)
        await opened.until(lambda: (table.row_count, table.cursor_row, table.has_focus) == (2, other, True))
        assert "P-2" in opened.text()


async def test_the_language_asked_for_goes_before_the_configurations_and_its_key_changes_it(console: Opener) -> None:
    ask_language("zh")
    async with console(profile=None) as opened:
        await opened.shows("新建")
        await opened.press("f3")
        await opened.shows("New")


async def test_what_is_typed_in_the_form_stays(console: Opener) -> None:
    async with console(profile=None) as opened:
        await opened.press("n")
        await opened.shows("New patient")
        opened.type("identifier", "P-7")
        opened.type("stature_m", "abc")
        opened.app.screen.query_one("#sex", Select).value = "male"
        await opened.shows("to correct")
        await opened.press("f3")
        await opened.shows("新患者")
        form = opened.app.screen
        assert form.query_one("#identifier", Input).value == "P-7"
        assert form.query_one("#stature_m", Input).value == "abc"
        assert form.query_one("#sex", Select).value == "male"
        await opened.until(lambda: "✗" in opened.text())


async def test_a_note_after_the_session_stays(console: Opener) -> None:
    async with console() as opened:
        await opened.press("e")
        await opened.shows("After the session")
        opened.type("note", "walked well")
        await opened.press("f3")
        await opened.shows(tr("after.note"))
        assert opened.app.screen.query_one("#note", Input).value == "walked well"


async def test_the_next_letter_goes_where_the_last_one_went(console: Opener) -> None:
    async with console() as opened:
        await opened.press("e")
        await opened.shows("After the session")
        opened.app.screen.query_one("#note", Input).focus()
        await opened.press(*"tied", "left", "left", "f3")
        await opened.shows(tr("after.note"))
        await opened.press("r")
        assert opened.app.screen.query_one("#note", Input).value == "tired"


async def test_a_list_goes_on_at_its_option(console: Opener) -> None:
    async with console() as opened:
        await opened.press("t", "down", "down")
        await opened.shows(tr("act.title"))
        await opened.press("f3")
        await opened.shows(tr("act.title"))
        await opened.press("down", "enter")
        await opened.until(lambda: opened.host.sent)
        assert opened.host.sent == [(OperatorKind.ACT, list(TherapistAct.BY_KEY.values())[2])]


async def test_the_list_of_sessions_goes_on_too(console: Opener, home: Home) -> None:
    write_sample(home.root, minutes=1)
    async with console(profile=None) as opened:
        app = opened.app
        await opened.shows("demo")
        await opened.press("r")
        await opened.until(lambda: isinstance(app.screen, ChooseSession) and app.screen.composed)
        await opened.press("f3")
        await opened.shows(tr("reviewing.choose"))
        await opened.press("down", "enter")
        await opened.until(lambda: isinstance(app.screen, ReviewScreen))


@pytest.mark.parametrize(("key", "title"), [("s", "checks.title"), ("i", "health.title"), ("f1", "help.title")])
async def test_what_is_scrolled_by_keys_still_is(console: Opener, key: str, title: str) -> None:
    async with console() as opened:
        await opened.press(key)
        await opened.shows(tr(title))
        await opened.press("f3")
        await opened.until(lambda: tr(title).split()[0] in opened.text())
        assert isinstance(opened.app.screen.focused, VerticalScroll)


async def test_a_choice_that_was_open_is_closed_and_can_be_opened_again(console: Opener) -> None:
    async with console(profile=None) as opened:
        await opened.shows("demo")
        await opened.press("enter")
        await opened.shows("Begin (Enter)")
        opened.app.screen.query_one("#joints-kind", Select).focus()
        await opened.press("enter")
        await opened.until(lambda: opened.app.screen.query_one("#joints-kind", Select).expanded)
        await opened.press("f3")
        await opened.shows(tr("start.begin"))
        again = opened.app.screen.query_one("#joints-kind", Select)
        assert again.has_focus
        await opened.press("enter")
        await opened.until(lambda: again.expanded)
        await opened.shows(tr("bind.cancel"))  # in Textual's words it would stay English


async def test_a_reviewed_session_stays_at_its_record(home: Home) -> None:
    write_sample(home.root, minutes=1)
    app = ConsoleApp(home, Config())
    async with app.run_test(size=(120, 36)) as pilot:
        await wait_until(pilot, lambda: isinstance(app.screen, PatientsScreen))
        screen = ReviewScreen(home, "last")
        await app.push_screen(screen)
        await wait_until(pilot, lambda: "checked signature" in screen_text(app))
        await pilot.press("n", "n")
        index = screen.index
        await pilot.press("f3")
        await wait_until(pilot, lambda: "关闭" in screen_text(app))
        assert screen.index == index > 0
        await wait_until(pilot, lambda: str(screen.query_one("#records", Static).content).count("\n") > 5)
        assert "已验证的签名" in str(screen.query_one("#verdict", Static).content)
        assert "0:" in screen_text(app)  # the timeline's own scale


async def test_a_comment_that_is_being_written_stays(home: Home) -> None:
    write_sample(home.root, minutes=1)
    app = ConsoleApp(home, Config())
    async with app.run_test(size=(120, 36)) as pilot:
        await wait_until(pilot, lambda: isinstance(app.screen, PatientsScreen))
        await app.push_screen(ReviewScreen(home, "last"))
        await wait_until(pilot, lambda: "checked signature" in screen_text(app))
        await pilot.press("c", *"seen")
        dialog = app.screen
        assert isinstance(dialog, WriteComment)
        await pilot.press("f3")
        await wait_until(pilot, lambda: tr("reviewing.comment", number=0) in screen_text(app))
        assert (dialog.query_one(Input).value, dialog.query_one(Input).has_focus) == ("seen", True)


async def test_why_a_calibration_does_not_begin_stays(console: Opener) -> None:
    async with console(profile=None) as opened:
        await opened.shows("demo")
        await opened.press("c")
        await opened.shows("Enter begins")
        opened.type("measured", "far")
        await opened.press("enter")
        await opened.shows("from 15 to 80")
        await opened.press("f3")
        await opened.shows(tr("calibration.distance", least_cm=NEAREST_CM, most_cm=FARTHEST_CM))
