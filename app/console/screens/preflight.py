"""Pre-flight from the console: every action rehearsed for this patient in the background, with progress, stoppable."""

from __future__ import annotations

import multiprocessing
from collections.abc import Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import BindingType
from textual.containers import Vertical
from textual.widgets import Static

from app.console.screens.base import Dialog
from app.console.sentences import sentence
from app.console.state import SessionState
from app.console.terms import action_name
from app.console.widgets.panel import bar
from app.ipc.states import Action
from app.system.config import Config
from app.system.paths import Home
from app.text.catalogue import tr
from profiles.schema import Profile

BAR_CELLS = 40


class Preflight(Dialog[bool]):
    """Gives True when every action has passed; Escape stops it and keeps what has passed so far."""

    HELP_PAGE = "preflight"
    BINDINGS: ClassVar[list[BindingType]] = [("enter", "close_if_done", "bind.cancel")]

    def __init__(self, profile: Profile, config: Config, actions: tuple[Action, ...] = tuple(Action)) -> None:
        super().__init__()
        self._profile = profile
        self._config = config
        self._actions = actions
        self._ended = False
        self._passed = False

    def compose(self) -> ComposeResult:
        with Vertical(classes="dialog") as box:
            box.border_title = tr("preflight.title", name=self._profile.identifier)
            yield Static(tr("preflight.words"), markup=False)
            yield Static(tr("preflight.starting"), id="progress", markup=False)
        yield from self.compose_bottom()

    def on_mount(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._words, theirs = context.Pipe(duplex=False)
        home = self.console_app.home.root
        given = (theirs, home, self._config, self._profile, self._actions)
        self._child = context.Process(target=rehearse_all, args=given, daemon=True)
        self._child.start()
        theirs.close()

    def on_unmount(self) -> None:
        self._child.kill()
        self._child.join()
        self._words.close()

    def show_session(self, state: SessionState | None) -> None:
        super().show_session(state)
        try:
            while not self._ended and self._words.poll():
                self._take(self._words.recv())
        except EOFError:
            self._end(tr("preflight.died"))

    def action_cancel(self) -> None:
        self.dismiss(self._passed)

    def action_close_if_done(self) -> None:
        """Enter closes once it is over."""
        if self._ended:
            self.dismiss(self._passed)

    def _take(self, word: Word) -> None:
        if isinstance(word, Action):
            at = self._actions.index(word)
            drawn = bar(at / len(self._actions), BAR_CELLS)
            self._show(f"{drawn} {at + 1}/{len(self._actions)}\n{action_name(word)} …")
        elif isinstance(word, str):
            self._end(f"✗ {sentence(word)}")
        else:
            self._passed = not word
            said = "\n".join(f"✗ {sentence(reason)}" for reason in word)
            self._end(said or tr("preflight.passed"))

    def _end(self, said: str) -> None:
        self._ended = True
        hint = tr("preflight.next_session") if self._passed and self.console_app.live is not None else ""
        self._show("\n".join(part for part in (said, hint) if part))

    def _show(self, said: str) -> None:
        self.query_one("#progress", Static).update(said)


# What comes through the pipe: an action that begins; at the end the reasons why actions failed, or an error's words.
Word = Action | tuple[str, ...] | str


def rehearse_all(words: Connection, home: Path, config: Config, profile: Profile, actions: Sequence[Action]) -> None:
    """Rehearse what is not on record yet, keep the verdicts, tell of each."""
    from app.motion.patient import patient_of
    from app.motion.preflight import cleared_actions, run_preflight
    from app.system.scheduling import set_scheduling
    from hal.joints.device import DEFAULT_DEVICE, load_exoskeleton

    set_scheduling("rehearsal")
    place = Home(home)
    device = load_exoskeleton(Path(config.joints.device) if config.joints.device else DEFAULT_DEVICE)
    patient = patient_of(profile, device)
    done = cleared_actions(place, patient, device)
    wanted = [action for action in actions if action not in done]
    try:
        results = run_preflight(place, patient, device, wanted, watch=words.send)
    except OSError as error:
        words.send(f"The rehearsals can't be kept in {home}: {error.strerror}; free space, then rehearse again.")
        return
    words.send(tuple(result.reason for result in results if not result.passed))
