"""STOP over the real processes, in every gait state and through every screen and dialog there is."""

from __future__ import annotations

import pkgutil
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import pytest
from textual.command import CommandPalette

import app.console
from app.console.screens.after import AfterScreen
from app.console.screens.base import ConsoleScreen, Dialog
from app.console.screens.calibration import CalibrationScreen
from app.console.screens.checks import Checklist, Preflight
from app.console.screens.compare import CompareScreen
from app.console.screens.dialogs import AskText, GuidedTestChoice, HealthPage, History, Question, TherapistAct
from app.console.screens.help import HelpPage
from app.console.screens.outcomes import OutcomesPage
from app.console.screens.patient_form import PatientForm
from app.console.screens.patients import PatientsScreen
from app.console.screens.replay import ReplayScreen
from app.console.screens.review import ReviewScreen
from app.console.screens.review_dialogs import ChooseSession, WriteComment
from app.console.screens.session import SessionScreen
from app.console.screens.signin import LockScreen, SignInDialog
from app.console.screens.start import StartSession
from app.console.screens.training import TrainingScreen
from app.console.screens.vocabulary import VocabularyScreen
from app.ipc.states import Effect, GaitState
from tests.app.console.real import AnyScreen, keys_only, real_console, stop_on
from tests.app.console.stalls import walked_again

pytestmark = pytest.mark.serial

# In this order: the states that a movement passes through leave the legs in BETWEEN, which comes last.
STATES = (
    GaitState.UNPOWERED,
    GaitState.STANDING,
    GaitState.SITTING,
    GaitState.RIGHT_FORWARD,
    GaitState.LEFT_FORWARD,
    GaitState.RIGHT_HIGH_STEP,
    GaitState.RIGHT_LOW_STEP,
    GaitState.RIGHT_OBSTACLE,
    GaitState.BETWEEN,
)
# The key that opens it over the live screen, and the one that closes it.
OVER_A_SESSION: dict[AnyScreen, tuple[str, str]] = {
    Question: ("c", "escape"),
    TherapistAct: ("t", "escape"),
    Checklist: ("s", "escape"),
    CompareScreen: ("v", "escape"),
    GuidedTestChoice: ("g", "escape"),
    HealthPage: ("i", "escape"),
    HelpPage: ("f1", "escape"),
    CommandPalette: ("ctrl+p", "escape"),
    LockScreen: ("ctrl+l", "enter"),
}
# Sessions of their own, begun from the list of patients: the key that begins it, and the one that ends it.
BESIDE_A_SESSION: dict[AnyScreen, tuple[str, str]] = {TrainingScreen: ("t", "e"), VocabularyScreen: ("g", "escape")}
# Where a sign-in is asked for and a rehearsal needed: over emulated drives, in `test_real_drives`.
OVER_DRIVES: tuple[AnyScreen, ...] = (SignInDialog, Preflight)
# Nothing can move while these are open: there is no session, or its control has ended.
NOTHING_TO_STOP: tuple[AnyScreen, ...] = (
    PatientsScreen,
    PatientForm,
    AskText,
    History,
    OutcomesPage,
    CalibrationScreen,
    StartSession,
    ReviewScreen,
    ChooseSession,
    WriteComment,
    ReplayScreen,
    AfterScreen,
)


def screens() -> Iterator[AnyScreen]:
    """Every screen and dialog of the console that nothing is derived from, and the library's palette."""
    for module in pkgutil.walk_packages(app.console.__path__, "app.console."):
        import_module(module.name)
    waiting: list[AnyScreen] = [ConsoleScreen, Dialog]
    while waiting:
        screen = waiting.pop()
        if derived := [one for one in screen.__subclasses__() if one.__module__.startswith("app.console")]:
            waiting.extend(derived)
        else:
            yield screen
    yield CommandPalette


def test_every_state_and_every_screen_has_its_row() -> None:
    assert len(STATES) == len(GaitState)
    assert set(STATES) == set(GaitState)
    rows: list[AnyScreen] = [*OVER_A_SESSION, *BESIDE_A_SESSION, *OVER_DRIVES, *NOTHING_TO_STOP, SessionScreen]
    assert len(rows) == len(set(rows))
    assert set(rows) == set(screens()), "a row for each screen in one of the tables of this file"


@walked_again
async def test_stop_in_every_state(tmp_path: Path) -> None:
    async with real_console(tmp_path, make_host=keys_only, perception=False) as console:
        await console.confirm_and_arm()
        for state in STATES:
            await console.stop_in(state)
            assert console.snapshot.effect is Effect.HOLD, state
            if state is not STATES[-1]:
                await console.acknowledge()
                assert console.snapshot.action is None, f"acknowledging a stop in {state} began something"
        await console.press("space")
        await console.until(lambda: console.snapshot.effect is Effect.DAMP)
        await console.shows("LEGS DAMPED")
    assert {state.value for state in STATES} <= set(console.stops())


@pytest.mark.xdist_group("perception")
@walked_again
async def test_stop_through_every_screen(tmp_path: Path) -> None:
    async with real_console(tmp_path, profile=None) as console:
        for screen, (begins, ends) in BESIDE_A_SESSION.items():
            await console.press(begins)
            await stop_on(console, screen)
            await console.press(ends)
            await console.until(lambda: isinstance(console.app.screen, PatientsScreen) and console.app.live is None)
            assert not console.app.switch.live
        await console.press("enter")
        await console.until(lambda: isinstance(console.app.screen, StartSession))
        await console.press("enter")
        await console.begun()
        await stop_on(console, SessionScreen)
        await console.acknowledge()
        for screen, (opens, closes) in OVER_A_SESSION.items():
            await console.press(opens)
            await stop_on(console, screen)
            await console.press(closes)
            await console.until(lambda: isinstance(console.app.screen, SessionScreen))
            await console.acknowledge()
