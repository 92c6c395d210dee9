"""What is pasted, typed or broken by hand must lose nothing and end in a sentence that helps."""

from __future__ import annotations

from datetime import UTC, datetime

import msgspec
import pytest
from textual.events import Paste
from textual.widgets import Input, Label, Static

from app.console.patient_fields import FIELDS, Kind, parse, to_texts
from app.console.screens.patient_form import labelled
from app.console.screens.patients import PatientsScreen
from app.console.session_index import Records, SessionRecord
from app.system.errors import AppError
from app.system.paths import Home
from app.text.catalogue import render, tr
from logs.reason import reason
from logs.records import Body, Note
from logs.trail import DiskFault
from profiles.schema import DEMO_PATIENT
from profiles.store import ProfileStore
from testing.authors import Named
from tests.app.console.conftest import Opener
from tests.support.disks import full_disk


async def test_a_megabyte_pasted_breaks_nothing(console: Opener) -> None:
    async with console(profile=None) as open_console:
        await open_console.press("n")
        await open_console.shows("New patient")
        for text in ("x" * 1_000_000, "line\n" * 200_000, "\x1b[2J😀" * 1000):
            open_console.app.screen.query_one("#identifier").post_message(Paste(text))
            await open_console.pilot.pause()
        await open_console.press("ctrl+s")
        await open_console.tells("Not saved")
        assert open_console.app.store.list(archived=True).profiles == (DEMO_PATIENT,)


async def test_a_note_of_several_lines_is_pasted_whole_or_refused_with_a_sentence(console: Opener) -> None:
    async with console() as open_console:
        app = open_console.app
        await open_console.press("e")
        await open_console.shows("After the session")
        note = app.screen.query_one("#note", Input).focus()
        app.post_message(Paste("left heel sore\nno stairs\r\nnext time shorter\n"))
        await open_console.until(lambda: note.value)
        assert note.value == "left heel sore no stairs next time shorter"
        app.post_message(Paste("x" * 1960))
        await open_console.tells("the field would have 2002 characters, at most 2000 fit")
        assert note.value == "left heel sore no stairs next time shorter"


async def test_whatever_is_typed_the_form_reports_what_is_wrong(console: Opener) -> None:
    numbers = [field for field in FIELDS if field.kind in (Kind.NUMBER, Kind.WHOLE)]
    async with console(profile=None) as open_console:
        await open_console.press("n")
        await open_console.shows("New patient")
        open_console.type("identifier", "P-1")
        form = open_console.app.screen

        def reported(typed: str) -> bool:
            """Each number's fault stands below its field, in words for just what is typed there."""
            errors = parse(to_texts(DEMO_PATIENT) | {field.path: typed for field in numbers}, DEMO_PATIENT).errors
            wanted = {path: f"✗ {render(labelled(error))}" for path, error in errors.items()}
            labels = {field.path: form.query_one(f"#{field.id}-error", Label) for field in numbers}
            return wanted == {path: label.content for path, label in labels.items() if label.display}

        for typed in ("abc", "", "-1", "9" * 10_000, "😀", "170 kg", "\x07\x1b]0;x\x07"):
            for field in numbers:
                open_console.type(field.id, typed)
            await open_console.until(lambda typed=typed: reported(typed))  # type: ignore[misc]
            await open_console.press("ctrl+s")
            await open_console.tells("Not saved")
            open_console.app.clear_notifications()
            await open_console.shows("to correct")
            assert len(open_console.app.store.list().profiles) == 1


async def test_a_broken_profile_is_named_in_the_list(console: Opener, home: Home) -> None:
    home.profiles.mkdir(parents=True)
    (home.profiles / "P-7.toml").write_text("stature_cm = 'tall'")
    async with console(profile=None) as open_console:
        await open_console.shows("Correct that field")
        await open_console.shows("demo")


async def test_a_patient_whose_history_can_t_be_read_is_not_shown_as_the_one_before(
    console: Opener, home: Home
) -> None:
    store = ProfileStore(home.profiles)
    for name, note in (("A-1", "left hip"), ("B-2", "right knee")):
        patient = msgspec.structs.replace(DEMO_PATIENT, identifier=name, note=note)
        store.create(patient, by=Named(""), at=datetime.now(UTC))
    (home.profiles / "history" / "B-2.jsonl").write_text('{"at": "tor')
    async with console(profile=None, size=(100, 24)) as open_console:
        about = open_console.app.screen.query_one("#about", Static)
        await open_console.until(lambda: "left hip" in str(about.content))
        await open_console.press("down")
        await open_console.tells("B-2.jsonl")
        assert "right knee" in str(about.content)
        assert "left hip" not in str(about.content)


async def test_a_note_may_be_changed_while_the_targets_are_refused(console: Opener) -> None:
    async with console() as open_console:
        await open_console.press("e")
        await open_console.shows("After the session")
        open_console.type("note", "tired")
        open_console.type("steps", "999999")
        await open_console.press("ctrl+s")
        await open_console.tells("999999")
        open_console.type("note", "tired; left hip hurts")
        open_console.type("steps", "100")
        await open_console.press("ctrl+s")
        await open_console.until(lambda: open_console.host.closed)
        assert [one.note for one in open_console.app.sessions.of("demo")] == ["tired; left hip hurts"]


@pytest.mark.parametrize("leaves", [("escape",), ("ctrl+q",)])
async def test_a_session_whose_targets_are_refused_is_listed_when_it_is_left(
    console: Opener, trail: list[Body], leaves: tuple[str, ...]
) -> None:
    async with console() as open_console:
        await open_console.press("e")
        await open_console.shows("After the session")
        open_console.type("note", "tired")
        open_console.type("steps", "999999")
        await open_console.press(*leaves)
        await open_console.shows("Leave without saving?")
        await open_console.press("y")
        await open_console.until(lambda: open_console.host.closed)
        assert [one.note for one in open_console.app.sessions.of("demo")] == ["tired"]
    assert trail.count(Note(text="tired")) == 1


async def test_a_note_that_cant_be_kept_stays_until_it_can(console: Opener, home: Home) -> None:
    home.root.mkdir(parents=True, exist_ok=True)
    in_the_way = home.root / "sessions"
    in_the_way.write_text("a file where the folder should be")
    async with console() as open_console:
        await open_console.press("e")
        await open_console.shows("After the session")
        open_console.type("note", "walked well")
        await open_console.press("ctrl+s")
        await open_console.tells("can't be written")
        assert open_console.app.screen.query_one("#note", Input).value == "walked well"
        await open_console.press("escape")
        await open_console.shows("Leave without saving?")
        await open_console.press("n")
        in_the_way.unlink()
        await open_console.press("ctrl+s")
        await open_console.until(lambda: open_console.host.closed)
        (record,) = open_console.app.sessions.of("demo")
        assert record.note == "walked well"


def test_a_disk_that_takes_half_a_line_keeps_none_of_it(home: Home) -> None:
    made = Records(home.root, SessionRecord)
    record = SessionRecord(
        session="S", patient="P-1", at="", operator="", steps=1, distance_m=0.1, duration_s=1.0, refusals=0
    )
    made.add(record)
    with full_disk((home.root / "P-1.jsonl").stat().st_size + 10), pytest.raises(AppError, match="NOT_WRITTEN"):
        made.add(record)
    made.add(record)
    assert made.of("P-1") == (record, record)


@pytest.mark.parametrize(("cut", "kept"), [(1, ["a", "b", "c"]), (20, ["a", "c"]), (115, ["a", "c"])])
def test_a_line_that_a_loss_of_power_cut_off_hides_no_other(home: Home, cut: int, kept: list[str]) -> None:
    made = Records(home.root, SessionRecord)
    for session in ("a", "b"):
        made.add(SessionRecord(session=session, patient="P-1", at=""))
    path = home.root / "P-1.jsonl"
    path.write_bytes(path.read_bytes()[:-cut])
    assert "a" in [record.session for record in made.of("P-1")]
    made.add(SessionRecord(session="c", patient="P-1", at=""))
    assert [record.session for record in made.of("P-1")] == kept


@pytest.mark.parametrize(
    "tail",
    [b'{"session":"b","patient":"P-1"', bytes(80), bytes(40) + b'"P-1","at":"","steps":3}\n'],
    ids=["cut off", "NULs", "NULs before its end"],
)
def test_what_a_loss_of_power_left_hides_no_record(home: Home, tail: bytes) -> None:
    made = Records(home.root, SessionRecord)
    made.add(SessionRecord(session="a", patient="P-1", at=""))
    with (home.root / "P-1.jsonl").open("ab") as file:
        file.write(tail)
    assert [record.session for record in made.of("P-1")] == ["a"]
    made.add(SessionRecord(session="c", patient="P-1", at=""))
    assert [record.session for record in made.of("P-1")] == ["a", "c"]


@pytest.mark.parametrize(
    "line",
    [
        b'{"session":"b","patient":"P-1","at":"","steps":"x"}',
        b'{"session":"b","patient":"P-1","at":"","distance_m":1e400}',
        b"[1]",
    ],
)
def test_a_whole_line_with_a_wrong_value_is_reported(home: Home, line: bytes) -> None:
    made = Records(home.root, SessionRecord)
    made.add(SessionRecord(session="a", patient="P-1", at=""))
    with (home.root / "P-1.jsonl").open("ab") as file:
        file.write(line + b"\n")
    with pytest.raises(AppError, match="UNREADABLE"):
        made.of("P-1")


async def test_a_full_disk_loses_nothing_that_was_typed(console: Opener, home: Home) -> None:
    home.root.mkdir(parents=True)
    home.profiles.write_text("a file where the folder should be")
    async with console(profile=None) as open_console:
        await open_console.press("n")
        await open_console.shows("New patient")
        open_console.type("identifier", "P-9")
        await open_console.press("ctrl+s")
        await open_console.tells("permissions")
        assert open_console.app.screen.query_one("#identifier", Input).value == "P-9"


async def test_a_field_is_named_as_its_label_says(console: Opener) -> None:
    async with console(profile=None, size=(120, 36)) as open_console:
        await open_console.press("n")
        await open_console.shows("New patient")
        open_console.type("stature_m", "-5")
        await open_console.shows("Stature (cm) is -5 cm: it must lie in 120 to 220 cm.")
        await open_console.app.speak("zh")
        await open_console.shows("✗ 身高 (cm)")


async def test_leaving_the_program_with_an_unsaved_form_asks_first(console: Opener) -> None:
    async with console(profile=None) as open_console:
        await open_console.press("n")
        await open_console.shows("New patient")
        open_console.type("identifier", "P-1")
        await open_console.shows("All values are in range")
        await open_console.press("ctrl+c")
        await open_console.shows("Leave without saving?")
        await open_console.press("n")
        await open_console.shows("New patient")
        assert open_console.app.screen.query_one("#identifier", Input).value == "P-1"
        await open_console.press("ctrl+q")
        await open_console.shows("Leave without saving?")
        await open_console.press("ctrl+q")
        await open_console.until(lambda: open_console.app._exit)


async def test_leaving_the_program_after_a_session_keeps_the_note(console: Opener) -> None:
    async with console() as open_console:
        await open_console.press("e")
        await open_console.shows("After the session with demo")
        open_console.type("note", "tired")
        await open_console.press("ctrl+c")
        await open_console.until(lambda: open_console.app._exit)
        assert [record.note for record in open_console.app.sessions.of("demo")] == ["tired"]


@pytest.mark.parametrize("leaves", ["ctrl+c", "ctrl+q", "y"])
async def test_a_note_that_can_be_kept_after_all_is_kept_on_leaving(console: Opener, home: Home, leaves: str) -> None:
    home.root.mkdir(parents=True, exist_ok=True)
    in_the_way = home.root / "sessions"
    in_the_way.write_text("a file where the folder should be")
    async with console() as open_console:
        await open_console.press("e")
        await open_console.shows("After the session with demo")
        open_console.type("note", "tired")
        await open_console.press("ctrl+c")
        await open_console.shows("Leave without saving?")
        in_the_way.unlink()
        await open_console.press(leaves)
        await open_console.until(lambda: open_console.app._exit)
        assert [record.note for record in open_console.app.sessions.of("demo")] == ["tired"]


async def test_a_terminal_that_is_closed_after_a_session_keeps_the_note(console: Opener) -> None:
    async with console() as open_console:
        await open_console.press("e")
        await open_console.shows("After the session with demo")
        open_console.type("note", "tired")
        await open_console.app._leave_now()
        assert [record.note for record in open_console.app.sessions.of("demo")] == ["tired"]


async def test_a_trail_that_can_not_be_written_is_told_before_its_session_is_left(console: Opener) -> None:
    fault = reason(DiskFault.NOT_WRITTEN, path="/logs/s.jsonl", detail="No space left on device", waiting=7)
    async with console() as open_console:
        open_console.host.audit_fault = fault
        await open_console.press("e")
        await open_console.shows("After the session with demo")
        line = open_console.app.screen.query_one("#unwritten", Static)
        await open_console.until(lambda: line.content == tr("after.unwritten", why=fault))
        assert line.display
        open_console.host.audit_fault = None
        await open_console.until(lambda: not line.display)


async def test_the_yes_of_a_question_that_did_not_come_is_no_note(console: Opener) -> None:
    """Without powered joints the end asks nothing; hands know `e`, `y`."""
    async with console() as open_console:
        await open_console.press("e")
        await open_console.shows("After the session with demo")
        await open_console.press("y", "ctrl+s")
        await open_console.until(lambda: isinstance(open_console.app.screen, PatientsScreen))
        (record,) = open_console.app.sessions.of("demo")
        assert (record.note, record.discomfort) == ("", None)


async def test_a_note_is_saved_by_its_button_too(console: Opener) -> None:
    async with console(size=(100, 60)) as open_console:
        await open_console.press("e")
        await open_console.shows("After the session with demo")
        open_console.type("note", "tired")
        await open_console.pilot.click("#save")
        await open_console.until(lambda: isinstance(open_console.app.screen, PatientsScreen))
        assert [record.note for record in open_console.app.sessions.of("demo")] == ["tired"]
        await open_console.press("n")
        await open_console.shows("New patient")


async def test_the_next_steps_take_digits_only(console: Opener) -> None:
    async with console() as open_console:
        await open_console.press("e")
        await open_console.shows("After the session with demo")
        open_console.app.screen.query_one("#steps", Input).focus()
        await open_console.press("home", "minus", "plus", "a", "7")
        assert open_console.app.screen.query_one("#steps", Input).value == "7100"
