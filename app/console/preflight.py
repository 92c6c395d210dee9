"""Pre-flight from the console: every action rehearsed for this patient in the background, with progress, stoppable."""

from __future__ import annotations

import multiprocessing
from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import BindingType
from textual.containers import Vertical
from textual.widgets import Static

from app.console.base import Dialog
from app.console.language import tr
from app.console.preflight_child import Word, rehearse_all
from app.console.sentences import sentence
from app.console.session.panel import bar
from app.console.session.state import SessionState
from app.console.session.words import action_name
from app.ipc.states import Action
from app.system.config import Config
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
