"""What is done once before sessions: the palm calibrated, the actions rehearsed, the threshold adopted."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime
from multiprocessing import active_children
from multiprocessing.context import SpawnProcess

import msgspec
import pytest
from textual.widgets import Input, Select

from app.console.screens.calibration import CalibrationScreen
from app.console.screens.checks import Preflight
from app.console.screens.session import SessionScreen
from app.console.screens.start import StartSession
from app.ipc.states import Action
from app.motion.plan import patient_of
from app.motion.preflight import preflight_passed
from app.system.config import Config, JointsConfig
from app.system.hand_model import find_model
from app.system.operators import Role
from app.system.paths import Home, find_home
from app.text.catalogue import language, tr
from hal.inputs.device import InputDevice, InputRole
from hal.joints.device import load_exoskeleton
from kgdfa.press_zone import PressZone
from logs.journal import CHANGES
from profiles.palm import Calibrated, reference_segment
from profiles.schema import DEMO_PATIENT, Calibration, DistanceUsed, HandUsed, Profile
from profiles.store import ChangeCause, ProfileStore
from testing.authors import Named, signed_in
from tests.app.console.conftest import Console, Opener, wait_until

PROCESS_LIMIT_S = 120.0  # an interpreter, camera, hand model or physics, on a machine that tests other things too


USABLE = PressZone(followed_from_m=0.21, whole_from_m=0.25, visible_to_m=1.4, threshold_m=0.28, rest_beyond_m=0.34)


async def _comes(console: Console, text: str) -> None:
    await wait_until(console.pilot, lambda: text in console.text(), PROCESS_LIMIT_S)


async def _follows_the_language(console: Console, key: str) -> None:
    """What stands there stays when the language changes, in that language, and back."""
    first = language()
    shown = ""
    while shown != first:
        await console.press("f3")
        shown = language()
        await console.shows(tr(key))


async def test_a_palm_is_calibrated_before_the_camera_and_kept_with_its_history(console: Opener, home: Home) -> None:
    config = Config(model=str(find_model(find_home(), Config())))
    async with console(profile=None, config=config, size=(130, 40)) as open_console:
        await open_console.shows("demo")
        await open_console.press("c")
        await open_console.shows("Enter begins")
        await open_console.press("ctrl+s")
        await open_console.shows("Nothing to keep yet")
        await open_console.press("enter")
        await _comes(open_console, "Samples scatter by")
        await _follows_the_language(open_console, "calibration.keep")
        await open_console.press("ctrl+s")
        await open_console.until(lambda: not isinstance(open_console.app.screen, CalibrationScreen))
        if "Keep it anyway?" in open_console.text():
            await open_console.press("y")
        await open_console.until(lambda: ProfileStore(home.profiles).load("demo").calibrations)
        (change,) = ProfileStore(home.profiles).history("demo")
        assert change.why == ChangeCause.CALIBRATED.key


FOUND = Calibration(
    camera="webcam", focal_px=900.0, focal_anchor_px_m=75.0, distance_m=0.30, residual=0.01, calibrated_at="2026-11-27"
)
CALIBRATED = Calibrated(calibration=FOUND, reference_m=0.083, expected=reference_segment(DEMO_PATIENT), doubt=None)


async def _calibrated_at_30_cm(console: Console) -> CalibrationScreen:
    """The result is on the screen."""
    await console.shows("demo")
    await console.press("c")
    await console.shows("Enter begins")
    console.type("measured", "30")
    await console.press("enter")
    await console.shows("Opening the camera")
    screen = console.app.screen
    assert isinstance(screen, CalibrationScreen)
    screen._end_child()
    screen._receive(CALIBRATED)
    await console.shows("Samples scatter by")
    return screen


async def test_a_calibration_is_kept_only_with_the_distance_that_it_was_made_at(console: Opener, home: Home) -> None:
    async with console(profile=None) as open_console:
        screen = await _calibrated_at_30_cm(open_console)
        open_console.type("measured", "40")
        await open_console.until(lambda: "Samples scatter by" not in open_console.text())
        open_console.type("measured", "30")  # what was given up stays so
        await open_console.press("ctrl+s")
        await open_console.shows("Nothing to keep yet")
        assert screen.is_active
    assert ProfileStore(home.profiles).load("demo").calibrations == ()


async def test_another_distance_ends_a_calibration_that_runs(console: Opener) -> None:
    async with console(profile=None) as open_console:
        await open_console.shows("demo")
        await open_console.press("c")
        await open_console.shows("Enter begins")
        await open_console.press("enter")
        await open_console.shows("Opening the camera")
        before = set(active_children())
        assert before
        open_console.type("measured", "40")
        await open_console.until(lambda: not before & set(active_children()))
        assert "Opening the camera" not in open_console.text()


async def test_another_language_leaves_a_calibration_as_it_is(console: Opener, home: Home) -> None:
    async with console(profile=None) as open_console:
        await _calibrated_at_30_cm(open_console)
        await _follows_the_language(open_console, "calibration.keep")
        await open_console.press("ctrl+s")
        await open_console.until(lambda: not isinstance(open_console.app.screen, CalibrationScreen))
    assert ProfileStore(home.profiles).load("demo").calibrations == (FOUND,)


async def test_the_reason_why_a_calibration_failed_stays_in_sight(console: Opener) -> None:
    async with console(profile=None, config=Config(model="/none.task")) as open_console:
        await open_console.shows("demo")
        await open_console.press("c")
        await open_console.shows("Enter begins")
        await open_console.press("enter")
        await open_console.shows("Opening the camera")
        screen = open_console.app.screen
        assert isinstance(screen, CalibrationScreen)
        await open_console.until(lambda: screen._worker is None)
        await open_console.shows("/none.task")


@pytest.mark.parametrize("typed", ["", "abc", "-3", "1e400", "nan", "9" * 500, "😀"])
async def test_a_calibration_distance_that_is_none_is_reported(console: Opener, typed: str) -> None:
    async with console(profile=None) as open_console:
        await open_console.shows("demo")
        await open_console.press("c")
        await open_console.shows("Enter begins")
        assert open_console.app.screen.query_one("#measured").size.height == 1
        open_console.type("measured", typed)
        await open_console.press("enter")
        await open_console.shows("from 15 to 80")


async def test_a_journal_that_can_t_be_written_ends_no_calibration_screen(console: Opener, home: Home) -> None:
    (home.logs / CHANGES).mkdir(parents=True)
    home.config.write_text('language="en"\n')
    async with console(profile=None, config=Config(joints=JointsConfig(kind="can"))) as open_console:
        await open_console.shows("demo")
        open_console.app.signed_in = signed_in(home, Role.THERAPIST)
        await open_console.press("c")
        await open_console.shows("Enter begins")
        await open_console.press("enter")
        await open_console.tells(CHANGES)
        assert isinstance(open_console.app.screen, CalibrationScreen)


@pytest.fixture
def no_process() -> Iterator[pytest.MonkeyPatch]:
    """The computer has no memory for another process."""

    def refuse(_: SpawnProcess) -> None:
        raise BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(SpawnProcess, "start", refuse)
        yield patch


async def test_a_calibration_that_can_not_be_started_is_told_and_tried_again(
    console: Opener, no_process: pytest.MonkeyPatch
) -> None:
    async with console(profile=None) as open_console:
        await open_console.shows("demo")
        await open_console.press("c")
        await open_console.shows("Enter begins")
        for _ in range(2):
            await open_console.press("enter")
            await open_console.shows("The calibration ended unexpectedly. Try again.")
        await open_console.tells(os.strerror(errno.EAGAIN))
        no_process.undo()
        await open_console.press("enter")
        await open_console.shows("Opening the camera")
        await open_console.press("escape")
        await open_console.until(lambda: not isinstance(open_console.app.screen, CalibrationScreen))


@pytest.mark.usefixtures("no_process")
async def test_a_rehearsal_that_can_not_be_started_is_told_and_closed(console: Opener) -> None:
    async with console(profile=None) as open_console:
        passed: list[bool | None] = []
        open_console.app.push_screen(Preflight(DEMO_PATIENT, Config(), (Action.SIT_DOWN,)), passed.append)
        await open_console.shows("The pre-flight stopped unexpectedly. Try again.")
        await open_console.tells(os.strerror(errno.EAGAIN))
        await open_console.press("enter")
        await open_console.until(lambda: passed == [False])


async def test_a_rehearsal_runs_beside_the_console_and_is_kept(console: Opener, home: Home) -> None:
    device = load_exoskeleton()
    patient = patient_of(DEMO_PATIENT, device)
    async with console(profile=None) as open_console:
        assert not preflight_passed(home, patient, device, Action.SIT_DOWN).passed
        config = Config(joints=JointsConfig(kind="can"))
        open_console.app.push_screen(Preflight(DEMO_PATIENT, config, (Action.SIT_DOWN,)))
        await open_console.shows("esc Close")
        assert "⏎ Close" not in open_console.text() or "All actions passed" in open_console.text()
        await _comes(open_console, "All actions passed")
        await open_console.shows("⏎ Close")
        await _follows_the_language(open_console, "preflight.passed")
        await open_console.press("enter")
        await open_console.until(lambda: not isinstance(open_console.app.screen, Preflight))
        assert preflight_passed(home, patient, device, Action.SIT_DOWN).passed


async def test_a_profile_changed_meanwhile_is_shown_before_a_session_begins_with_it(
    console: Opener, home: Home
) -> None:
    store = ProfileStore(home.profiles)

    def change(step_length_m: float, **fields: object) -> Profile:
        now = store.load("demo")
        gait = msgspec.structs.replace(now.gait, step_length_m=step_length_m)
        store.save(msgspec.structs.replace(now, gait=gait, **fields), by=Named("Eve"), at=datetime.now(UTC))
        return store.load("demo")

    async with console(profile=None) as open_console:
        app = open_console.app
        await open_console.shows("demo")
        changed = change(0.15)
        await open_console.press("enter")
        await open_console.shows("Begin (Enter)")
        await open_console.press("f5")
        await open_console.until(lambda: isinstance(app.screen, Preflight))
        assert app.screen._profile == changed  # type: ignore[attr-defined]
        await open_console.press("escape")
        await open_console.until(lambda: isinstance(app.screen, StartSession))
        open_console.type("device", "seed 3")
        changed = change(0.2, note="left side weak", distance_source=DistanceUsed.BOTH)
        await open_console.press("ctrl+s")
        await open_console.tells("changed meanwhile")
        assert app.live is None
        await open_console.shows("left side weak")
        assert app.screen.query_one("#device", Input).value == "seed 3"
        await open_console.press("ctrl+s")
        await open_console.until(lambda: app.live is not None)
        assert app.live_setup().profile == changed
    assert store.load("demo") == changed


@pytest.mark.parametrize("key", ["t", "g"])
async def test_training_and_enrolment_take_the_profile_as_it_is_stored(console: Opener, home: Home, key: str) -> None:
    store = ProfileStore(home.profiles)
    async with console(profile=None) as open_console:
        await open_console.shows("demo")
        left = msgspec.structs.replace(store.load("demo"), hand=HandUsed.LEFT)
        store.save(left, by=Named("Eve"), at=datetime.now(UTC))
        await open_console.press(key)
        await open_console.until(lambda: open_console.app.live is not None)
        assert open_console.app.live_setup().profile.hand is HandUsed.LEFT


async def test_the_checks_rehearse_by_a_key_for_real_joints(console: Opener) -> None:
    async with console(profile=None, config=Config(joints=JointsConfig(kind="can"))) as open_console:
        await open_console.shows("demo")
        open_console.app.signed_in = signed_in(open_console.app.home)
        await open_console.press("enter")
        await open_console.shows("Begin (Enter)")
        await open_console.press("enter")
        await open_console.until(lambda: isinstance(open_console.app.screen, SessionScreen))
        await open_console.press("s")
        await open_console.shows("Before arming")
        await open_console.press("p")
        await open_console.shows("Pre-flight for demo")
        await open_console.press("escape")
        await open_console.shows("Before arming")


async def test_the_checks_of_simulated_joints_have_nothing_to_rehearse(console: Opener) -> None:
    async with console() as open_console:
        await open_console.press("s")
        await open_console.shows("Before arming")
        await open_console.press("p")
        assert not isinstance(open_console.app.screen, Preflight)


THERE = JointsConfig(kind="can", host="exo.local:7447")


async def test_the_start_screen_offers_no_pre_flight_where_another_computer_has_the_joints(console: Opener) -> None:
    async with console(profile=None, config=Config(joints=THERE), size=(130, 40)) as open_console:
        await open_console.shows("demo")
        await open_console.press("enter")
        await open_console.shows("Begin (Enter)")
        assert [text for text in ("F5", "f5", "re-flight") if text in open_console.text()] == []
        open_console.app.signed_in = signed_in(open_console.app.home)
        await open_console.press("f5")
        assert isinstance(open_console.app.screen, StartSession)


async def test_nor_do_the_checks(console: Opener) -> None:
    async with console(size=(130, 40)) as open_console:
        setup = open_console.host.setup
        config = msgspec.structs.replace(setup.config, joints=THERE)
        open_console.host.setup = msgspec.structs.replace(setup, config=config)
        await open_console.press("s")
        await open_console.shows("Before arming")
        assert "re-flight" not in open_console.text()
        await open_console.press("p")
        assert not isinstance(open_console.app.screen, Preflight)


@pytest.mark.parametrize("key", ["ctrl+s", "f5"])
async def test_joints_that_an_input_does_not_suit_are_refused_in_a_sentence(console: Opener, key: str) -> None:
    pedal = InputDevice(name="pedal", role=InputRole.WEARER, kind="simulated")
    async with console(profile=None, config=Config(inputs=(pedal,))) as open_console:
        await open_console.press("enter")
        await open_console.shows("Begin (Enter)")
        joints = open_console.app.screen.query_one("#joints-kind", Select)
        joints.value = "can"
        await open_console.press(key)
        await open_console.tells("choose other joints or remove that input")
        assert isinstance(open_console.app.screen, StartSession)
        joints.value = "simulated"
        await open_console.press("ctrl+s")
        await open_console.until(lambda: isinstance(open_console.app.screen, SessionScreen))


async def test_the_palette_finds_the_palms_calibration(console: Opener) -> None:
    async with console(profile=None) as open_console:
        await open_console.shows("demo")
        await open_console.press("ctrl+p", *"calibrate")
        await open_console.shows("Calibrate palm")
        await open_console.press("enter")
        await open_console.until(lambda: isinstance(open_console.app.screen, CalibrationScreen))


async def test_a_rehearsal_can_be_stopped(console: Opener) -> None:
    async with console(profile=None) as open_console:
        await open_console.press("enter")
        await open_console.shows("Begin (Enter)")
        await open_console.press("f5")
        await open_console.shows("Pre-flight for demo")
        await open_console.press("escape")
        await open_console.shows("Begin (Enter)")


@pytest.mark.parametrize(
    ("zone", "says"),
    [
        (replace(USABLE, followed_from_m=0.15, threshold_m=0.22), "✓ Press threshold suits camera and palm"),
        (replace(USABLE, followed_from_m=0.40, threshold_m=0.48), "No threshold suits this camera and palm."),
    ],
)
async def test_a_threshold_is_suggested_only_where_one_suits_better(
    console: Opener, home: Home, zone: PressZone, says: str
) -> None:
    async with console(size=(130, 40)) as open_console:
        open_console.host.press_zone = zone
        await open_console.until(lambda: (report := open_console.app.live_session().state.report) and report.press_zone)
        await open_console.press("s")
        await open_console.shows(says)
        assert not [text for text in ("Use suggested threshold", "Press u") if text in open_console.text()]
        await open_console.press("u")
        open_console.host.press_zone = USABLE
        await open_console.shows("u Use suggested threshold")
        open_console.host.press_zone = zone
        await open_console.until(lambda: "Use suggested threshold" not in open_console.text())
    assert ProfileStore(home.profiles).load("demo") == DEMO_PATIENT


async def test_a_threshold_that_was_corrected_meanwhile_stays(console: Opener, home: Home) -> None:
    store = ProfileStore(home.profiles)
    async with console(size=(130, 40)) as open_console:
        open_console.host.press_zone = USABLE
        await open_console.shows("suggested 28 cm (checks)")
        corrected = msgspec.structs.replace(DEMO_PATIENT, press_threshold_m=0.32)
        store.save(corrected, by=Named("Eve"), at=datetime.now(UTC))
        await open_console.press("s")
        await open_console.shows("! Press threshold suits camera and palm")
        await open_console.press("u")
        await open_console.tells("The profile already has 32 cm")
    assert store.load("demo") == corrected


async def test_the_threshold_that_suits_the_camera_is_one_key_away(console: Opener, home: Home) -> None:
    async with console(size=(130, 40)) as open_console:
        open_console.host.press_zone = USABLE
        await open_console.shows("suggested 28 cm (checks)")
        await open_console.press("s")
        await open_console.shows("! Press threshold suits camera and palm")
        await open_console.press("u")
        await open_console.tells("Saved 28 cm")
        assert ProfileStore(home.profiles).load("demo").press_threshold_m == pytest.approx(0.28)
