"""From the patients' list to the note afterwards, over the host we own."""

from __future__ import annotations

import asyncio
import os
import threading
from datetime import UTC, datetime
from pathlib import Path

import msgspec
import pytest
from textual import events
from textual.widgets import Button, Input, Select

from app.console import keys
from app.console.operator import ConsoleTrail
from app.console.screens.after import AfterScreen
from app.console.screens.dialogs import AskText, TherapistAct
from app.console.screens.patients import PatientsScreen
from app.console.screens.session import SessionScreen
from app.console.session_index import Records, SessionRecord
from app.console.widgets.status import EFFECT_MARKS
from app.ipc.messages import OperatorKind
from app.ipc.states import Action, Effect, Event, GaitState
from app.session.host import SessionFault
from app.system.config import CameraConfig, CameraKind, Config
from app.system.errors import AppError
from app.system.paths import Home
from app.text.catalogue import tr
from hal.errors import CameraFault
from logs.reason import reason
from logs.records import Body, Note
from profiles.schema import (
    DEMO_PATIENT,
    DistanceUsed,
    GestureEvidence,
    GestureUsed,
    VocabularyEvidence,
)
from profiles.store import ChangeCause, ProfileStore
from testing.authors import Named
from testing.fake_host import FakeHost, walk_steps
from testing.messages import event
from tests.app.console.conftest import Console, Opener
from tests.support.calibrations import calibrated_with


async def test_a_first_patient_is_made_and_walks(console: Opener, home: Home) -> None:
    async with console(profile=None) as open_console:
        await open_console.press("n")
        await open_console.shows("New patient")
        open_console.type("identifier", "P-0042")
        open_console.type("stature_m", "1.62 m")
        await open_console.shows("values are in range")
        await open_console.press("ctrl+s")
        await open_console.shows("P-0042")
        assert ProfileStore(home.profiles).load("P-0042").stature_m == pytest.approx(1.62)
        await open_console.press("enter")
        await open_console.shows("Session with P-0042")
        await open_console.press("enter")
        await open_console.shows("NOT ARMED")
        await _confirm_and_arm(open_console)
        await open_console.press("t", "0")
        await open_console.shows("standing")
        assert (OperatorKind.ACT, Action.INITIALISE) in open_console.host.sent


async def test_what_others_change_while_the_form_is_open_is_kept(console: Opener, home: Home) -> None:
    store = ProfileStore(home.profiles)
    palm = calibrated_with()
    changed = msgspec.structs.replace(DEMO_PATIENT, calibrations=(palm,), note="left side weak")
    async with console(profile=None) as open_console:
        await open_console.shows("demo")
        await open_console.press("e")
        await open_console.shows("values are in range")
        store.save(changed, by=Named("Bea"), at=datetime.now(UTC))
        open_console.type("mass_kg", "71.5")
        await open_console.press("ctrl+s")
        await open_console.until(lambda: isinstance(open_console.app.screen, PatientsScreen))
    assert store.load("demo") == msgspec.structs.replace(changed, mass_kg=71.5)


async def test_the_distance_chosen_at_the_start_is_used_and_kept(console: Opener, home: Home) -> None:
    async with console(profile=None) as open_console:
        await open_console.press("enter")
        await open_console.shows("Session with demo")
        open_console.app.screen.query_one("#distance-source", Select).value = DistanceUsed.BOTH
        await open_console.press("enter")
        await open_console.shows("NOT ARMED")
        assert open_console.host.setup.profile.distance_source is DistanceUsed.BOTH
    assert ProfileStore(home.profiles).load("demo").distance_source is DistanceUsed.BOTH
    assert ProfileStore(home.profiles).history("demo")[-1].why == ChangeCause.DISTANCE.key


async def test_a_distance_that_can_not_be_kept_begins_no_session(console: Opener, home: Home) -> None:
    async with console(profile=None) as open_console:
        await open_console.press("enter")
        await open_console.shows("Session with demo")
        home.root.mkdir(exist_ok=True)
        home.profiles.touch()  # where a folder is to be made
        start = open_console.app.screen
        start.query_one("#distance-source", Select).value = DistanceUsed.BOTH
        await open_console.press("enter")
        await open_console.tells("profiles")
        assert open_console.app.screen is start
        home.profiles.unlink()
        await open_console.press("ctrl+s")  # the choice stands, and is kept now
        await open_console.shows("NOT ARMED")
        assert open_console.host.setup.profile.distance_source is DistanceUsed.BOTH
    assert ProfileStore(home.profiles).load("demo").distance_source is DistanceUsed.BOTH


async def test_another_camera_chosen_at_the_start_has_no_device_of_the_configured_one(console: Opener) -> None:
    film = CameraConfig(kind="recording", device="f.mp4", focal_px=600.0, mirrored=True)
    async with console(profile=None, config=Config(camera=film)) as open_console:
        await open_console.press("enter")
        await open_console.shows("f.mp4")
        start = open_console.app.screen
        start.query_one("#camera", Select).value = "webcam"
        await open_console.until(lambda: not start.query_one("#device", Input).value)
        await open_console.press("enter")
        await open_console.shows("NOT ARMED")
        assert open_console.host.setup.config.camera == CameraConfig(kind="webcam")


async def test_another_recording_named_at_the_start_has_not_the_lens_of_the_configured_one(console: Opener) -> None:
    film = CameraConfig(kind="recording", device="f.mp4", focal_px=600.0, mirrored=True)
    async with console(profile=None, config=Config(camera=film)) as open_console:
        await open_console.press("enter")
        await open_console.shows("f.mp4")
        open_console.app.screen.query_one("#device", Input).value = "g.mp4"
        await open_console.press("enter")
        await open_console.shows("NOT ARMED")
        assert open_console.host.setup.config.camera == CameraConfig(kind="recording", device="g.mp4")


@pytest.mark.parametrize("configured", ["digital-hand", "webcam"])
async def test_a_typed_camera_stays_in_another_language(console: Opener, configured: CameraKind) -> None:
    config = Config(camera=CameraConfig(kind=configured, device="0"))
    async with console(profile=None, config=config) as open_console:
        await open_console.press("enter")
        await open_console.shows("Session with demo")
        start = open_console.app.screen
        start.query_one("#camera", Select).value = "webcam"
        wanted = "0" if configured == "webcam" else ""
        await open_console.until(lambda: start.query_one("#device", Input).value == wanted)
        open_console.type("device", "2")
        await open_console.press("f3")
        await open_console.until(lambda: tr("start.begin") in open_console.text())
        await open_console.press("ctrl+s")
        await open_console.until(lambda: open_console.app.live is not None)
        camera = open_console.host.setup.config.camera
        assert (camera.kind, camera.device) == ("webcam", "2")


async def test_a_session_that_could_not_start_is_none(
    console: Opener, monkeypatch: pytest.MonkeyPatch, home: Home
) -> None:
    def refuse(host: FakeHost) -> None:
        raise AppError(SessionFault.NOT_STARTED, folder="diagnostics")

    monkeypatch.setattr(FakeHost, "start", refuse)
    async with console(profile=None) as open_console:
        app = open_console.app
        await open_console.press("enter")
        await open_console.shows("Begin (Enter)")
        await open_console.press("enter")
        await open_console.until(lambda: (state := app.live_state()) and state.fault)
        await open_console.press("e")
        await open_console.until(lambda: isinstance(app.screen, PatientsScreen))
        assert open_console.host.closed
        assert app.sessions.of("demo") == ()


async def test_a_session_ends_with_a_note_that_the_list_then_shows(console: Opener, home: Home) -> None:
    async with console() as open_console:
        app, host = open_console.app, open_console.host
        await open_console.press("t", "0")
        await open_console.shows("standing")
        await open_console.press("e")
        await open_console.shows("End the session?")
        assert OperatorKind.SHUT_DOWN not in host.kinds()
        await open_console.press("y")
        await open_console.shows("After the session")
        assert not host.closed, "the trail must still be open for the note"
        app.screen.query_one("#note", Input).value = "walked well"
        app.screen.query_one("#discomfort", Select).value = 3
        app.screen.query_one("#exertion", Select).value = 15
        await open_console.press("ctrl+s")
        await open_console.shows("walked well")
        await open_console.until(lambda: host.closed)
        (record,) = Records(home.root / "sessions", SessionRecord).of("demo")
        assert (record.note, record.discomfort, record.pain, record.exertion) == ("walked well", 3, None, 15)


async def test_while_the_legs_come_to_rest_stop_still_works(console: Opener) -> None:
    async with console() as open_console:
        host = open_console.host
        host.rests_at_once = False
        await open_console.press("e")
        await open_console.press("space")
        await open_console.until(lambda: OperatorKind.STOP in host.kinds())
        host.control_ended = True
        await open_console.shows("After the session")
        await open_console.press("space")
        assert host.kinds().count(OperatorKind.STOP) == 1


@pytest.mark.parametrize("saves_first", [False, True], ids=["leave twice", "save and leave"])
async def test_a_note_is_in_the_trail_once_however_the_console_is_left(
    console: Opener, monkeypatch: pytest.MonkeyPatch, saves_first: bool
) -> None:
    noted, closing, may_end = list[Body](), threading.Event(), threading.Event()

    def slow(_: FakeHost) -> None:
        closing.set()
        assert may_end.wait(20)

    monkeypatch.setattr(FakeHost, "close", slow)
    monkeypatch.setattr(ConsoleTrail, "emit", lambda _, body: noted.append(body))
    async with console() as open_console:
        app = open_console.app
        await open_console.press("e")
        await open_console.shows("After the session")
        open_console.type("note", "tired")
        if saves_first:
            app.screen.query_one("#save", Button).press()
        else:
            app.post_message(events.Key("ctrl+c", None))
        assert await asyncio.to_thread(closing.wait, 20)
        app.post_message(events.Key("ctrl+c", None))
        async with asyncio.timeout(20):
            while saves_first and not app._exit:
                await asyncio.sleep(0.01)
        may_end.set()
        await open_console.until(lambda: app._exit)
    assert [body for body in noted if isinstance(body, Note)] == [Note(text="tired")]


async def test_a_session_that_ends_with_the_program_is_in_the_list(console: Opener) -> None:
    async with console() as open_console:
        app = open_console.app
        walk_steps(open_console.host, 120)
        await open_console.until(lambda: (state := app.live_state()) and state.snapshot and state.snapshot.steps)
        await open_console.press("ctrl+q")
        await open_console.until(lambda: app._exit)
    (record,) = app.sessions.of("demo")
    assert (record.session, record.steps, record.distance_m) == (open_console.host.setup.session, 120, 36.0)


@pytest.mark.parametrize("key", ["ctrl+p", "v"], ids=["palette", "compare"])
async def test_what_is_open_when_the_legs_have_come_to_rest_puts_no_session_in_the_list_twice(
    console: Opener, key: str
) -> None:
    async with console(size=(120, 36)) as open_console:
        app, host = open_console.app, open_console.host
        walk_steps(host, 12)
        await open_console.until(lambda: (state := app.live_state()) and state.snapshot and state.snapshot.steps)
        host.rests_at_once = False
        await open_console.press("e")
        await open_console.until(lambda: app.live is not None and app.live.ending)
        await open_console.press(key)
        await open_console.until(lambda: not isinstance(app.screen, SessionScreen))
        host.control_ended = True
        await open_console.until(lambda: isinstance(app.screen, AfterScreen))
        await open_console.shows("After the session")
        open_console.type("note", "fell asleep")
        await open_console.press("ctrl+c")
        await open_console.until(lambda: app._exit)
    (record,) = app.sessions.of("demo")
    assert (record.note, record.steps) == ("fell asleep", 12)


@pytest.mark.parametrize("case", ["watched", "left held", "not taken over"])
async def test_a_session_that_goes_on_is_not_in_the_list_yet(console: Opener, case: str) -> None:
    async with console(read_only=case == "watched") as open_console:
        app = open_console.app
        if case == "not taken over":
            setup = open_console.host.setup
            open_console.host.setup = msgspec.structs.replace(setup, host_pid=os.getpid())
            open_console.host.started = False
        if case == "left held":
            app._ending._lose_console()
            await app._leave_now()
        else:
            await open_console.press("ctrl+q")
        await open_console.until(lambda: app._exit)
    assert app.sessions.of("demo") == ()


@pytest.mark.parametrize("key", ["ctrl+c", "ctrl+q"])
async def test_leaving_a_simulation_takes_one_key(console: Opener, key: str) -> None:
    async with console() as open_console:
        await open_console.press("t", "0")
        await open_console.press(key)
        await open_console.until(lambda: open_console.host.closed)


@pytest.mark.parametrize(("present", "mark"), [(True, EFFECT_MARKS[Effect.REFUSE]), (False, "✓")])
async def test_what_is_still_there_is_not_ticked_off(console: Opener, present: bool, mark: str) -> None:
    async with console(size=(130, 40)) as open_console:
        stale = event(Event.CAMERA_STALE, Effect.REFUSE, detail="")
        open_console.host.events = (msgspec.structs.replace(stale, present=present, acknowledged=True),)
        await open_console.shows(f"{mark} {tr(Effect.REFUSE)} The camera")


async def test_an_event_is_on_top_until_it_is_acknowledged(console: Opener) -> None:
    async with console(size=(130, 40)) as open_console:
        host = open_console.host
        host.events = (event(Event.OVER_TEMPERATURE, Effect.HOLD, temperature_c=81.0),)
        host.effect = Effect.HOLD
        await open_console.shows("A joint is too hot: 81 °C")
        await open_console.press("k")
        await open_console.shows("Acknowledging never starts motion")
        await open_console.press("n")
        assert OperatorKind.ACKNOWLEDGE not in host.kinds()
        await open_console.pilot.click("#hold")
        await open_console.press("y")
        await open_console.until(lambda: "81 °C" not in open_console.text())


async def test_a_lost_camera_is_reported_and_its_return_too(console: Opener) -> None:
    async with console() as open_console:
        open_console.host.camera_fault = reason(CameraFault.UNPLUGGED, camera="webcam")
        await open_console.shows("was unplugged")
        await open_console.press("s")
        await open_console.shows("✗ Camera delivers images")
        open_console.host.camera_fault = None
        await open_console.shows("✓ Camera delivers images")


async def test_an_unresponsive_control_is_reported(console: Opener) -> None:
    async with console() as open_console:
        open_console.host.silent = True
        await open_console.shows("CONTROL TIMEOUT")
        await open_console.shows("the guardian may damp the legs")
        await open_console.shows("Last state received")
        await open_console.shows("No data from control")
        assert "power on and stand" not in open_console.text()
        open_console.host.unanswered = ("left_knee",)
        await open_console.shows("Drives do not answer: support the patient, press the emergency stop")
        open_console.host.unanswered = ()
        await open_console.shows("the guardian may damp the legs")
        open_console.host.guardian_gone = True
        await open_console.shows("press the emergency stop")


async def test_while_the_legs_move_the_way_to_stop_them_comes_before_what_is_missing(console: Opener) -> None:
    async with console() as open_console:
        open_console.host.confirmed = True
        open_console.host.guardian_gone = True
        await open_console.shows("Not ready")
        open_console.host.walked = {"action": Action.WALK, "progress": 0.2}
        await open_console.shows("Legs moving. Press SPACE to STOP")


async def test_an_observer_may_watch_but_not_act(console: Opener) -> None:
    async with console(read_only=True) as open_console:
        await open_console.press("a", "c", "k", "t", "5", "enter")
        assert open_console.host.sent == []
        assert open_console.host.hands == []


async def test_the_palette_finds_the_twelve_actions(console: Opener) -> None:
    async with console() as open_console:
        await open_console.press("ctrl+p", *"sitdown")
        await open_console.shows("sit down")
        await open_console.press("enter")
        await open_console.until(lambda: (OperatorKind.ACT, Action.SIT_DOWN) in open_console.host.sent)


async def test_a_dialog_opened_again_shows_what_is_now(console: Opener) -> None:
    async with console() as open_console:
        await open_console.press("s")
        await open_console.shows("✓ Camera delivers images")
        await open_console.press("escape")
        open_console.host.camera_fault = reason(CameraFault.UNPLUGGED, camera="webcam")
        await open_console.shows("was unplugged")
        await open_console.press("s")
        await open_console.shows("✗ Camera delivers images")


async def test_enter_alone_never_repeats_the_last_action(console: Opener) -> None:
    async with console() as open_console:
        acts = [(OperatorKind.ACT, Action.INITIALISE)]
        for _ in range(2):
            await open_console.press("t")
            await open_console.shows("Therapist action")
            await open_console.press("enter")
            await open_console.shows("Therapist action")
            await open_console.press("down", "enter")
            await open_console.until(lambda: "Therapist action" not in open_console.text())
            assert open_console.host.sent == acts
            open_console.host.sent.clear()


async def test_a_key_that_comes_twice_chooses_once(console: Opener) -> None:
    async with console() as open_console:
        app, host = open_console.app, open_console.host
        await open_console.press("t")
        await open_console.until(lambda: isinstance(app.screen, TherapistAct) and app.screen.composed)
        _press_twice(open_console, "0")
        await open_console.until(lambda: host.sent)
        await open_console.press("c")
        await open_console.shows("Is this the patient?")
        assert isinstance(app.screen_stack[-2], SessionScreen)
        assert host.sent == [(OperatorKind.ACT, Action.INITIALISE)]


async def test_a_line_that_is_given_twice_leaves_the_list(console: Opener, home: Home) -> None:
    async with console(profile=None) as open_console:
        app = open_console.app
        await open_console.press("x")
        await open_console.until(lambda: isinstance(app.screen, AskText) and app.screen.composed)
        open_console.type("answer", str(home.root / "demo.toml"))
        _press_twice(open_console, "enter")
        await open_console.tells("demo.toml")
        await open_console.press("h")
        await open_console.shows("No changes recorded.")
        assert isinstance(app.screen_stack[-2], PatientsScreen)


def _press_twice(open_console: Console, key: str) -> None:
    """As a terminal sends a key that is held: both are there before the first is handled."""
    for _ in range(2):
        open_console.app.post_message(events.Key(key, key if len(key) == 1 else None))


async def test_a_dialog_kept_from_before_shows_the_new_language(console: Opener) -> None:
    async with console() as open_console:
        await open_console.press("s")
        await open_console.shows("Before arming")
        await open_console.press("escape")
        await open_console.app.speak("zh")
        await open_console.press("s")
        await open_console.shows(tr("checks.title"))
        assert "Before arming" not in open_console.text()


@pytest.mark.parametrize(
    ("key", "text"),
    [("f1", "help.title"), ("c", "confirm.title"), ("t", "act.title"), ("e", "end.title"), ("i", "health.title")],
)
async def test_an_open_dialog_changes_its_language(console: Opener, key: str, text: str) -> None:
    async with console() as open_console:
        await open_console.press(*(("t", "0") if key == "e" else ()), key)
        english = tr(text)
        await open_console.shows(english)
        await open_console.press("f3")
        await open_console.until(lambda: tr(text) != english and tr(text).split()[0] in open_console.text())
        await open_console.until(lambda: english not in open_console.text())


async def test_the_image_pauses_but_the_chain_does_not(console: Opener) -> None:
    async with console() as open_console:
        await open_console.press("z")
        await open_console.shows("Picture paused: z resumes")
        await open_console.press("5")
        await open_console.shows(" walk")


async def test_a_paused_image_is_drawn_anew_where_it_gets_other_room(console: Opener) -> None:
    async with console() as open_console:
        await open_console.until(lambda: "▀" in open_console.text())
        await open_console.press("z")
        await open_console.shows("Picture paused: z resumes")
        await open_console.press("b")
        await open_console.until(lambda: "Picture paused" not in open_console.text())
        await open_console.press("b")
        await open_console.shows("Picture paused: z resumes")
        await open_console.until(lambda: "▀" in open_console.text())


async def test_the_last_picture_of_a_lost_camera_says_that_none_follows(console: Opener) -> None:
    async with console() as open_console:
        await open_console.until(lambda: (state := open_console.app.live_state()) and state.preview)
        assert tr("picture.stale") not in open_console.text()
        open_console.host.camera_fault = reason(CameraFault.NO_FRAMES, camera="webcam", silent_s=2.0)
        await open_console.shows(tr("picture.stale"))
        open_console.host.camera_fault = None
        await open_console.until(lambda: tr("picture.stale") not in open_console.text())


@pytest.mark.parametrize(("key", "title"), [("t", "act.title"), ("g", "guided.title")])
async def test_a_list_of_choices_lives_in_a_terminal_of_any_width(console: Opener, key: str, title: str) -> None:
    async with console() as open_console:
        await open_console.press(key)
        for columns, rows in ((8, 24), (7, 24), (4, 24), (1, 24), (1, 1), (80, 24)):
            await open_console.pilot.resize_terminal(columns, rows)
            await open_console.pilot.pause()
        await open_console.shows(tr(title))


async def test_a_terminal_made_tiny_and_large_again_shows_all(console: Opener) -> None:
    async with console() as open_console:
        for size in ((20, 5), (250, 70), (1, 1), (80, 24)):
            await open_console.pilot.resize_terminal(*size)
            await open_console.pilot.pause()
        await open_console.shows("Press c to confirm the patient")
        await open_console.shows("STOP")


async def test_a_copy_of_a_patient_has_no_proof_of_the_others_hand(console: Opener, home: Home) -> None:
    """Neither of gestures nor of a palm; what was chosen for the patient is copied."""
    chosen = (GestureUsed.ZERO,)
    zero = GestureEvidence(
        gesture=GestureUsed.ZERO,
        frames=90,
        recognised=90,
        mistaken=0,
        recognised_at_least=0.96,
        mistaken_at_most=0.04,
    )
    evidence = VocabularyEvidence(
        proven_at=datetime.now(UTC).replace(microsecond=0),
        model="",
        vocabulary=chosen,
        idle_frames=300,
        idle_taken=0,
        idle_at_most=0.01,
        gestures=(zero,),
    )
    palm = calibrated_with()
    proven = msgspec.structs.replace(
        DEMO_PATIENT, identifier="A-1", vocabulary=chosen, evidence=evidence, calibrations=(palm,)
    )
    store = ProfileStore(home.profiles)
    store.create(proven, by=Named(""), at=datetime.now(UTC))
    async with console(profile=None) as open_console:
        await open_console.press("slash", *"a-1", "enter")
        await open_console.until(lambda: "demo" not in open_console.text())
        await open_console.press("d")
        await open_console.shows("Identifier of the copy of A-1")
        open_console.type("answer", "B-2")
        await open_console.press("enter")
        await open_console.until(lambda: "B-2" in [one.identifier for one in store.list().profiles])
    without = {"identifier": "B-2", "evidence": None, "calibrations": ()}
    assert store.load("B-2") == msgspec.structs.replace(proven, **without)


async def test_archived_patients_leave_the_list_and_are_found_by_search(console: Opener, home: Home) -> None:
    store = ProfileStore(home.profiles)
    store.create(msgspec.structs.replace(DEMO_PATIENT, identifier="P-3"), by=Named(""), at=datetime.now(UTC))
    async with console(profile=None) as open_console:
        await open_console.press("a")
        await open_console.shows("Archive?")
        await open_console.press("y")
        await open_console.until(lambda: "P-3" not in open_console.text())
        await open_console.press("slash", *"p-3")
        await open_console.shows("P-3 (archived)")
        assert store.load("P-3").archived
        await open_console.press("escape", "enter")
        await open_console.shows("Session with P-3")


async def test_the_cursor_stays_on_its_patient_when_the_list_changes(console: Opener, home: Home) -> None:
    """Enter begins a session with whom the cursor was on, whatever came before it in the list meanwhile."""
    store = ProfileStore(home.profiles)
    async with console(profile=None) as open_console:
        await open_console.shows("demo")
        for name in ("A-1", "A-2"):  # from another terminal
            store.create(msgspec.structs.replace(DEMO_PATIENT, identifier=name), by=Named(""), at=datetime.now(UTC))
        await open_console.press("n")
        await open_console.shows("New patient")
        await open_console.press("escape")
        await open_console.shows("A-2")
        await open_console.press("enter")
        await open_console.shows("Session with demo")


@pytest.mark.parametrize("archived", [False, True])
async def test_the_cursor_goes_to_a_new_patient_whom_the_search_did_not_find(
    console: Opener, home: Home, tmp_path: Path, archived: bool
) -> None:
    """The keys that follow are meant for the one who was made; the search was for somebody else."""
    store, other = ProfileStore(home.profiles), ProfileStore(tmp_path / "other")
    for name in ("P-1", "P-2"):
        store.create(msgspec.structs.replace(DEMO_PATIENT, identifier=name), by=Named(""), at=datetime.now(UTC))
    made = msgspec.structs.replace(DEMO_PATIENT, identifier="Q-9", archived=archived)
    other.create(made, by=Named(""), at=datetime.now(UTC))
    other.export("Q-9", tmp_path / "q.toml")
    async with console(profile=None, size=(120, 36)) as open_console:
        await open_console.shows("P-2")
        await open_console.press("slash", *("P", "minus"), "enter", "down", "i")
        await open_console.shows("Path of an exported profile")
        open_console.type("answer", str(tmp_path / "q.toml"))
        await open_console.press("enter")
        await open_console.tells("Q-9")
        await open_console.press("enter")
        await open_console.shows("Session with Q-9")


async def test_states_the_machine_can_be_in_are_all_drawn(console: Opener) -> None:
    async with console(size=(200, 50)) as open_console:
        for state in GaitState:
            open_console.host.state = state

            await open_console.shows(f"● {tr(state)}")


async def _confirm_and_arm(open_console: Console) -> None:
    await open_console.until(lambda: (state := open_console.app.live_state()) and state.snapshot)
    await open_console.press("c")
    await open_console.shows("Is this the patient?")
    await open_console.press("y")
    await open_console.press("a")
    await open_console.until(lambda: open_console.host.armed and open_console.host.confirmed)


@pytest.mark.parametrize("opening", [(), ("v",)], ids=["session", "compare"])
async def test_keys_and_sizes_that_come_after_the_session_has_ended_do_nothing(
    console: Opener, opening: tuple[str, ...]
) -> None:
    """Its processes take seconds to end, and its screen is there until then."""
    async with console() as open_console:
        await open_console.press(*opening)
        sent = list(open_console.host.sent)
        open_console.app.close_live()
        await open_console.pilot.resize_terminal(200, 50)
        await open_console.press(*(binding.key.partition(",")[0] for binding in (*keys.SESSION, *keys.HAND)))
        await open_console.pilot.resize_terminal(80, 24)
        assert open_console.app.is_running
        assert open_console.host.sent == sent


async def test_a_size_that_comes_after_training_has_ended_does_nothing(console: Opener) -> None:
    async with console(profile=None) as open_console:
        await open_console.press("t")
        await open_console.until(lambda: open_console.app.live_state() is not None)
        open_console.app.close_live()
        for size in ((120, 36), (200, 50), (80, 24)):
            await open_console.pilot.resize_terminal(*size)
        assert open_console.app.is_running


async def test_a_patients_history_follows_the_language(console: Opener) -> None:
    async with console(profile=None) as open_console:
        await open_console.press("h")
        await open_console.shows("No changes recorded.")
        await open_console.press("f3")
        await open_console.shows("没有更改记录。")
        await open_console.press("f3")
        await open_console.shows("No changes recorded.")


async def test_help_opens_over_a_dialog_and_its_key_closes_it(console: Opener) -> None:
    async with console() as open_console:
        await open_console.press("i")
        await open_console.shows("Health of machine and links")
        await open_console.press("f1")
        await open_console.shows("The figures behind the dot")
        await open_console.press("f1")
        await open_console.until(lambda: "The figures behind the dot" not in open_console.text())
        await open_console.shows("Health of machine and links")


@pytest.mark.parametrize("opens", ["e", "s", "f1", "ctrl+p"])
async def test_the_console_locks_over_whatever_is_open(console: Opener, opens: str) -> None:
    async with console() as open_console:
        await open_console.press(*(("t", "0") if opens == "e" else ()), opens)
        before = open_console.app.screen
        await open_console.until(lambda: open_console.app.screen is not open_console.app.screen_stack[0])
        await open_console.press("ctrl+l")
        await open_console.shows("Press Enter to go on. STOP still works.")
        await open_console.press("ctrl+l", "enter")
        await open_console.until(lambda: open_console.app.screen is before)


@pytest.mark.parametrize("size", [(60, 20), (80, 24), (130, 40)])
async def test_a_message_leaves_the_next_step_in_sight(console: Opener, size: tuple[int, int]) -> None:
    async with console(size=size) as open_console:
        await open_console.press("o")
        await open_console.shows("Only while the legs are damped")
        await open_console.shows("Press c to confirm the patient.")
