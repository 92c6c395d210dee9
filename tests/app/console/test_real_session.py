"""Each of a therapist's ways through the console, over the real processes: digital hand, simulated joints, trail."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest

from app.console.lock import Idle, since_boot_s
from app.console.screens.after import AfterScreen
from app.console.screens.checks import Preflight
from app.console.screens.patients import PatientsScreen
from app.console.screens.session import SessionScreen
from app.console.screens.signin import LockScreen, SignInDialog
from app.demo.drives import emulated_drives
from app.ipc.states import Action, Event, GaitState
from app.motion.plan import patient_of
from app.motion.preflight import run_preflight
from app.session.host import SessionHost
from app.system.config import JointsConfig, SessionSetup
from app.system.operators import Role, add_operator, load_store, save_store
from app.system.paths import Home
from hal.joints.device import load_exoskeleton
from kgdfa.gesture import Gesture
from logs.read import session_paths
from profiles.schema import DEMO_PATIENT
from tests.app.console.breakable import BREAK, MEND, UNPLUGGED, begin_breakable
from tests.app.console.real import RealConsole, keys_only, real_config, real_console, stop_on
from tests.app.console.stalls import walked_again

pytestmark = pytest.mark.serial
with_perception = pytest.mark.xdist_group("perception")

PIN = "483920"
AWAY_S = 0.3  # a tenth of what standing up takes: a console that locks while legs move is caught


def breakable_host(setup: SessionSetup) -> SessionHost:
    """A session whose camera can be broken."""
    return SessionHost(setup, entry=begin_breakable)


def breakable_joint(setup: SessionSetup) -> SessionHost:
    """A session without perception whose joint can be broken."""
    return SessionHost(setup, entry=begin_breakable, without=frozenset({"perception"}))


@with_perception
@walked_again
async def test_a_first_patient_is_made_and_powers_the_legs_by_gesture(tmp_path: Path) -> None:
    async with real_console(tmp_path, profile=None) as console:
        await console.press("n")
        await console.shows("New patient")
        await console.press(*"P-0042", "tab", "tab", *"162", "tab", *"58")
        await console.shows("values are in range")
        await console.press("ctrl+s")
        await console.shows("P-0042")
        await console.press("enter")
        await console.shows("Session with P-0042")
        await console.press("enter")
        await console.begun()
        await console.confirm_and_arm()
        await console.request(Gesture.ZERO)
        await console.bring(GaitState.STANDING)
        await end_with_note(console, "stood for the first time")
        assert console.app.store.load("P-0042").stature_m == 1.62
    assert '"text":"stood for the first time"' in trail_of(tmp_path)


@walked_again
async def test_a_session_with_walking_stairs_and_stop(tmp_path: Path) -> None:
    async with real_console(tmp_path, make_host=keys_only, perception=False) as console:
        await console.confirm_and_arm()
        await console.walk(steps=2)
        await console.stop()
        await console.acknowledge()
        for stair in (Action.STAIR_UP, Action.STAIR_DOWN):
            await console.whole(stair)
        await end_with_note(console, "good")
    trail = trail_of(tmp_path)
    assert '"kind":"note","text":"good"' in trail
    assert '"kind":"stop"' in trail


@with_perception
@walked_again
async def test_a_camera_is_lost_and_found_and_a_perception_that_dies_comes_back(tmp_path: Path) -> None:
    async with real_console(tmp_path, make_host=breakable_host) as console:
        await console.confirm_and_arm()
        console.signal("perception", BREAK)
        await console.shows("✗ No image from the camera")
        await console.until(lambda: console.report.camera_fault == UNPLUGGED)
        await console.until(lambda: console.in_force(Event.CAMERA_STALE))
        await console.bring(GaitState.STANDING)  # the therapist's keys still act
        console.signal("perception", MEND)
        await console.until(lambda: not console.report.camera_fault and console.report.hand)
        await console.until(lambda: console.report.detector_ready)  # one that dies before still counts as starting
        await console.until(lambda: not console.in_force(Event.CAMERA_STALE))

        dead, first = console.pid("perception"), console.report.incarnation
        console.signal("perception", signal.SIGKILL)
        await console.until(lambda: console.pid("perception") != dead)
        await console.until(lambda: console.report.incarnation != first and console.report.hand)
        await console.until(lambda: not console.in_force(Event.PERCEPTION_TIMEOUT))
        assert console.snapshot.reports[-1].action is Action.INITIALISE, "something moved meanwhile"
    assert f'"event":"{Event.PERCEPTION_TIMEOUT.value}"' in trail_of(tmp_path)


@walked_again
async def test_a_drive_fault_holds_the_legs_until_it_is_mended_and_acknowledged(tmp_path: Path) -> None:
    async with real_console(tmp_path, make_host=breakable_joint, perception=False) as console:
        await console.confirm_and_arm()
        await console.walk(steps=1)
        console.signal("control", BREAK)
        await console.until(lambda: console.in_force(Event.DRIVE_FAULT))
        await console.shows("over-current")
        await console.press("t", "0")
        await console.until(lambda: console.snapshot.refusal)
        console.signal("control", MEND)
        await console.acknowledge()
        assert console.snapshot.action is None
        await console.bring(GaitState.STANDING)


@with_perception
@walked_again
async def test_a_known_patient_from_sign_in_to_the_first_step_over_emulated_drives(tmp_path: Path) -> None:
    home = Home(tmp_path)
    save_store(home.keys, add_operator(load_store(home.keys), "Ada", Role.ENGINEER, PIN))
    with emulated_drives(JointsConfig(kind="can")) as joints:
        device = load_exoskeleton()
        run_preflight(home, patient_of(DEMO_PATIENT, device), device, (Action.INITIALISE, Action.STEP_RIGHT_FIRST))
        async with real_console(tmp_path, profile=None, config=real_config(joints=joints)) as console:
            await console.press("enter")
            await console.shows("Session with demo")
            await console.press("enter")
            await console.until(lambda: isinstance(console.app.screen, SignInDialog))
            await console.press(*"Ada", "enter", *PIN, "enter")
            await console.until(lambda: isinstance(console.app.screen, SessionScreen))
            await console.begun()
            await console.confirm_and_arm()
            await console.bring(GaitState.RIGHT_FORWARD)

            await console.press("s", "p")
            await stop_on(console, Preflight)
            await console.press("escape", "escape")
            await console.until(lambda: isinstance(console.app.screen, SessionScreen))
            await console.acknowledge()
            await console.press("ctrl+l")
            await stop_on(console, SignInDialog)
            await console.press(*PIN, "enter")
            await console.until(lambda: isinstance(console.app.screen, SessionScreen))
            await console.acknowledge()


@walked_again
async def test_an_untouched_console_locks_once_the_legs_rest_and_stop_works_through_it(tmp_path: Path) -> None:
    async with real_console(tmp_path, make_host=keys_only, perception=False) as console:
        await console.confirm_and_arm()
        await stand_unwatched(console)
        await console.press("escape")
        assert isinstance(console.app.screen, LockScreen), "escape is too easily hit to unlock"
        await console.stop()
        assert isinstance(console.app.screen, LockScreen)
        watch(console, limit_s=0)
        await console.press("enter")
        await console.until(lambda: isinstance(console.app.screen, SessionScreen))
        await console.acknowledge()
        assert console.snapshot.action is None


async def stand_unwatched(console: RealConsole) -> None:
    """Bring the legs to standing, and touch nothing until the console has locked; not while the legs move."""
    while not console.at(GaitState.STANDING):
        if isinstance(console.app.screen, LockScreen):  # a stall of the host has kept the legs from standing
            watch(console, limit_s=0)
            await console.press("enter")
        if console.held:
            await console.pick_up()
        await console.begin(Action.INITIALISE)
        watch(console, limit_s=AWAY_S)
        await console.until(lambda: isinstance(console.app.screen, LockScreen))
        assert console.snapshot.action is None, "locked while the legs moved"


def watch(console: RealConsole, *, limit_s: float) -> None:
    """From now on an untouched console locks after this time; 0: never."""
    console.app._idle = Idle(touched_s=since_boot_s(), limit_s=limit_s)


async def end_with_note(console: RealConsole, note: str) -> None:
    """End the session, and say something about it, without ratings."""
    await console.press("e")
    await console.shows("End the session?")
    await console.press("y")
    await console.until(lambda: isinstance(console.app.screen, AfterScreen) and console.app.focused)
    await console.press("tab", "tab", "tab", *(key if key != " " else "space" for key in note), "ctrl+s")
    await console.until(lambda: isinstance(console.app.screen, PatientsScreen) and console.app.live is None)


def trail_of(home: Path) -> str:
    """The audit trail of the only session."""
    (trail,) = session_paths(home / "logs")
    return trail.read_text()
