"""The guided enrolment on the screen: reached by a key, kept with its evidence, refused with a reason."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import msgspec
import pytest

from app.console.app import ConsoleApp
from app.console.guidance import Light, results
from app.console.screens.patients import PatientsScreen
from app.console.screens.vocabulary import VocabularyScreen, frame_of, guide_lines
from app.ipc.messages import OperatorKind, TriggerReport
from app.system.config import Config
from app.system.operators import Role
from app.system.paths import Home
from app.system.vocabulary import VALID_FOR, recognition_hash, with_evidence
from kgdfa.continuity import Jump
from kgdfa.gesture import Explanation, Gesture, HandRefusal
from kgdfa.vocabulary import MOST_FRAMES, OTHER_HAND_FRAMES, PARTS, Frame, VocabularyEnrolment, VocabularyProof
from logs.reason import Reason, reason, reason_of
from logs.records import Body, Note, VocabularyEnrolled
from profiles.files import encode
from profiles.schema import DEMO_PATIENT, GestureUsed, HandUsed
from profiles.store import ChangeCause
from testing.authors import Named, signed_in
from tests.app.console.conftest import Console, Opener
from tests.app.system.test_vocabulary_status import PROOF

Show = Callable[[Gesture | None, int], dict[str, object]]
G = Gesture


def perfect(part: Gesture | None, _: int) -> dict[str, object]:
    return {"hand": True, "raw_gesture": part}


def enrolling(app: ConsoleApp) -> VocabularyScreen:
    screen = app.screen
    assert isinstance(screen, VocabularyScreen)
    return screen


def show_frames(app: ConsoleApp, show: Show, frames: int = MOST_FRAMES * len(PARTS)) -> None:
    """So many reports, one after the other as the console gives them to the screen, or until there is a result."""
    screen, state = enrolling(app), app.live_state()
    assert state is not None
    for number in range(frames):
        if screen._result is not None:
            return
        enrolment = screen._enrolment
        later_ns = state.now_ns + 3_600_000_000_000  # than all that the host sends meanwhile
        captured_ns = max(later_ns, screen._captured_ns) + 1
        seen = {"hand": False, "gesture": None} | show(enrolment.sample.gesture, enrolment.frames)
        report = TriggerReport(
            incarnation=1,
            sequence=number,
            captured_ns=captured_ns,
            sent_ns=state.now_ns,
            **seen,  # type: ignore[arg-type]
        )
        screen.show_session(replace(state, report=report))


async def opened(console: Console, kept: list[Body], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(console.app.trail, "emit", kept.append)
    await console.press("g")
    await console.until(lambda: isinstance(console.app.screen, VocabularyScreen) and console.app.live_state())
    await console.shows("Enrol the gestures of demo: 1/25")
    await console.shows("Show gesture 0 and hold it")


async def test_who_may_not_change_patients_begins_no_enrolment(console: Opener, home: Home) -> None:
    async with console(profile=None) as open_console:
        await open_console.shows("demo")
        open_console.app.signed_in = signed_in(home, Role.ENGINEER)
        await open_console.press("g")
        await open_console.tells("may not create or change patients")
        assert open_console.app.live is None


async def test_what_the_patient_can_make_becomes_the_vocabulary(
    console: Opener, monkeypatch: pytest.MonkeyPatch
) -> None:
    def weak(part: Gesture | None, _: int) -> dict[str, object]:
        return {"hand": True, "raw_gesture": None if part in {G.SIX, G.NINE} else part}

    async with console(profile=None, size=(130, 40)) as open_console:
        app, kept = open_console.app, list[Body]()
        await opened(open_console, kept, monkeypatch)
        while enrolling(app)._enrolment.sample.gesture is not G.LOVE:
            show_frames(app, weak, 1)
        await open_console.press("tab")
        assert enrolling(app)._enrolment.sample.gesture is G.ROCK
        show_frames(app, weak)
        await open_console.shows("120/120 ≥98%")
        await open_console.shows("idle 0/200 ≤1%")
        text = open_console.text()
        assert [line for line in text.splitlines() if "✗    6" in line and "0/120 ≥0%" in line]
        assert "✗    5" in text, "who can't end a walk may not begin one"
        assert not kept
        await open_console.press("ctrl+s")
        await open_console.until(lambda: isinstance(app.screen, PatientsScreen))
        profile = app.store.load("demo")
        assert [one.value for one in profile.vocabulary] == ["0", "1", "2", "3", "4", "7", "8", "rock"]
        assert profile.evidence is not None
        assert profile.evidence.model == recognition_hash(app.config)
        assert datetime.now(UTC) - profile.evidence.proven_at < timedelta(minutes=5)
        assert app.store.history("demo")[-1].why == ChangeCause.ENROLLED.key
        assert {OperatorKind.ARM, OperatorKind.ACT} & set(open_console.host.kinds()) == set()
        assert open_console.host.setup.config.joints.kind == "simulated"
        assert open_console.host.closed
    (record,) = (body for body in kept if isinstance(body, VocabularyEnrolled))
    assert record.reason is None
    assert record.vocabulary == ("0", "1", "2", "3", "4", "7", "8", "rock")
    assert record.gestures == ("0", "1", "2", "3", "4", "5", "6", "7", "8", "9", "rock")
    assert (record.frames[6], record.recognised[6], record.recognised_at_least[6]) == (120, 0, 0.0)
    assert (record.idle_frames, record.idle_at_most) == (200, 0.0149)


def unlike(*parts: int) -> Show:
    """Perfect but in these parts, where nothing is recognised."""
    places = [PARTS[place] for place in parts]
    shown: list[Gesture | None] = []

    def show(part: Gesture | None, at: int) -> dict[str, object]:
        if at == 0:
            shown.append(part)
        second = shown.count(part) == 2
        return {"hand": True, "raw_gesture": None if part in places and second else part}

    return show


OTHER: dict[str, object] = {"hand": False, "hand_refusal": reason(HandRefusal.TWO_HANDS, share=0.9, limit=0.75)}
REFUSED: dict[str, tuple[Show, str]] = {
    "OTHER_HAND": (lambda part, at: OTHER if at < OTHER_HAND_FRAMES else perfect(part, at), "Another hand"),
    "NO_HAND": (lambda *_: {"hand": False}, "hand did not come into view"),
    "TOO_FEW_FRAMES": (lambda part, at: {"hand": at < 60, "raw_gesture": part}, "of 60 frames showed the hand"),
    "CONTRADICTORY": (unlike(3), "100% of one showing and 0% of the other"),
    "IDLE_TAKEN": (lambda part, _: {"hand": True, "raw_gesture": part or G.FIVE}, "most for 5"),
    "NONE_RELIABLE": (lambda *_: {"hand": True, "raw_gesture": None}, "No gesture was recognised often enough"),
}


@pytest.mark.parametrize("name", REFUSED)
async def test_every_refusal_is_told_and_recorded_once_and_the_old_vocabulary_stays(
    console: Opener, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    show, text = REFUSED[name]
    async with console(profile=None, size=(130, 40)) as open_console:
        app, kept = open_console.app, list[Body]()
        await opened(open_console, kept, monkeypatch)
        show_frames(app, show)
        await open_console.shows(text)
        await open_console.shows("Nothing was changed")
        await open_console.press("ctrl+s")
        await open_console.tells("There is nothing to keep yet")
        await open_console.press("escape")
        await open_console.until(lambda: isinstance(app.screen, PatientsScreen))
        assert app.store.load("demo") == DEMO_PATIENT
    (record,) = (body for body in kept if isinstance(body, VocabularyEnrolled))
    assert isinstance(record.reason, Reason)
    assert record.reason.code == f"VocabularyFault.{name}"
    assert record.vocabulary == tuple(one.value for one in GestureUsed)


async def test_frames_from_before_the_hand_model_is_there_do_not_count(
    console: Opener, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with console(profile=None) as open_console:
        app, kept = open_console.app, list[Body]()
        await opened(open_console, kept, monkeypatch)
        before = enrolling(app)._enrolment.frames
        show_frames(app, lambda *_: {"hand": False, "detector_ready": False})
        assert enrolling(app)._enrolment.frames == before
        show_frames(app, perfect, 50)
        assert enrolling(app)._enrolment.frames == before + 50


async def test_the_hand_that_was_shown_is_kept_even_if_another_commands_by_now(
    console: Opener, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with console(profile=None) as open_console:
        app = open_console.app
        await opened(open_console, [], monkeypatch)
        show_frames(app, perfect)
        changed = msgspec.structs.replace(DEMO_PATIENT, hand=HandUsed.LEFT)
        app.store.save(changed, by=Named(""), at=datetime.now(UTC))  # from another terminal
        await open_console.press("ctrl+s")
        await open_console.until(lambda: isinstance(app.screen, PatientsScreen))
        profile = app.store.load("demo")
    assert profile.evidence is not None
    assert (profile.hand, profile.evidence.hand) == (HandUsed.LEFT, HandUsed.RIGHT)


@pytest.mark.parametrize("whole", [False, True])
async def test_who_leaves_keeps_nothing_and_that_is_recorded(
    console: Opener, monkeypatch: pytest.MonkeyPatch, whole: bool
) -> None:
    async with console(profile=None) as open_console:
        app, kept = open_console.app, list[Body]()
        await opened(open_console, kept, monkeypatch)
        show_frames(app, perfect, MOST_FRAMES * len(PARTS) if whole else 50)
        assert isinstance(enrolling(app)._result, VocabularyProof) is whole
        await open_console.press("escape")
        await open_console.until(lambda: isinstance(app.screen, PatientsScreen))
        assert app.store.load("demo") == DEMO_PATIENT
    (record,) = (body for body in kept if isinstance(body, VocabularyEnrolled))
    assert isinstance(record.reason, Reason)
    assert record.reason.code == "VocabularyFault.ABANDONED"


@pytest.mark.parametrize("whole", [False, True])
async def test_who_leaves_the_program_keeps_nothing_and_that_is_recorded(
    console: Opener, monkeypatch: pytest.MonkeyPatch, whole: bool
) -> None:
    """A result that is not kept is asked about; the record comes while the trail is open."""
    async with console(profile=None) as open_console:
        app, kept = open_console.app, list[Body]()
        await opened(open_console, kept, monkeypatch)
        show_frames(app, perfect, MOST_FRAMES * len(PARTS) if whole else 50)
        close = app.trail.close

        def closed() -> None:
            kept.append(Note(text="closed"))
            close()

        monkeypatch.setattr(app.trail, "close", closed)
        await open_console.press("ctrl+q")
        if whole:
            await open_console.shows("Leave without saving?")
            assert not kept
            await open_console.press("y")
        await open_console.until(lambda: app._exit)
    record, end = kept
    assert isinstance(record, VocabularyEnrolled)
    assert isinstance(record.reason, Reason)
    assert record.reason.code == "VocabularyFault.ABANDONED"
    assert isinstance(end, Note)


@pytest.mark.parametrize("refusal", HandRefusal)
def test_only_another_hand_is_another_hand(refusal: HandRefusal) -> None:
    report = TriggerReport(incarnation=1, sequence=1, captured_ns=0, sent_ns=0, hand=False, gesture=None)
    other = {HandRefusal.TWO_HANDS, HandRefusal.OTHER_SIDE, HandRefusal.OTHER_ARM, HandRefusal.OVERLAP}
    shown = frame_of(msgspec.structs.replace(report, hand_refusal=reason(refusal)))
    assert shown.other_hand is (refusal in other)


@pytest.mark.parametrize(
    ("refusal", "counts", "guide"),
    [
        (None, True, "Take your time to form it"),
        (HandRefusal.SIDE_UNCLEAR, False, "left or right? Turn the palm to the camera"),
        (HandRefusal.JUMPED, False, "judging the hand anew"),
        (HandRefusal.ALTERNATING, True, "Take your time to form it"),
    ],
)
def test_a_hand_that_may_be_another_one_proves_no_gesture_and_is_told_why(
    refusal: HandRefusal | None, counts: bool, guide: str
) -> None:
    """In a session it gives none; one whose gestures alternate is the enrolled one."""
    values: dict[HandRefusal, dict[str, object]] = {
        HandRefusal.ALTERNATING: {"gesture": G.TWO, "other": G.THREE},
        HandRefusal.JUMPED: {"jump": Jump.PLACE},
    }
    told = None if refusal is None else reason_of(Explanation(refusal, values.get(refusal, {})))
    report = TriggerReport(
        incarnation=1, sequence=1, captured_ns=0, sent_ns=0, hand=True, gesture=None, raw_gesture=G.FIVE,
        hand_refusal=told,
    )  # fmt: skip
    assert frame_of(report) == Frame(hand=counts, gesture=G.FIVE)
    assert guide in str(guide_lines(VocabularyEnrolment(), report))


@pytest.mark.parametrize(
    ("age", "hand", "text"),
    [
        (timedelta(), HandUsed.RIGHT, "✓ proven on"),
        (VALID_FOR * 2, HandUsed.RIGHT, "more than 3 months ago"),
        (timedelta(), HandUsed.LEFT, "not proven for the hand that commands"),
    ],
)
async def test_the_start_screen_and_the_checks_tell_whether_it_is_proven(
    console: Opener, home: Home, age: timedelta, hand: HandUsed, text: str
) -> None:
    enrolled = with_evidence(DEMO_PATIENT, PROOF, recognition_hash(Config()), datetime.now(UTC) - age, hand)
    home.profiles.mkdir(parents=True)
    (home.profiles / "demo.toml").write_text(encode(enrolled))
    async with console(profile=None, size=(130, 40)) as open_console:
        app = open_console.app
        await open_console.press("enter")
        await open_console.shows("Commands with: 0")
        await open_console.shows(text)
        await open_console.press("ctrl+s")
        await open_console.until(lambda: (state := app.live_state()) and state.snapshot)
        state = app.live_state()
        assert state is not None
        lights = results(state)
        assert lights["vocabulary"] is (Light.GREEN if text.startswith("✓") else Light.AMBER)
