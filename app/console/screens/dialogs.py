"""Small dialogs: a question with two answers, a choice by key, a list, a patient's history, a line to type."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Generic, TypeVar

from textual import events
from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.content import Content
from textual.widgets import Button, Input, OptionList, Static
from textual.widgets.option_list import Option

from app.console.keys import GESTURE_KEYS
from app.console.screens.base import Dialog
from app.console.state import SessionState
from app.console.widgets.gesture import FINGERS
from app.console.widgets.health import health_lines
from app.console.widgets.panel import Lines, Panel, content_of, plain
from app.console.widgets.patient_details import changed_values, field_name, local_text
from app.ipc.states import ACTION_OF, Action
from app.outcomes.guided import GuidedTest
from app.text.catalogue import knows, tr
from hal.joints.device import JointDevice
from profiles.store import Change

T = TypeVar("T")

MAX_ANSWER = 4096  # a path
Wording = Callable[[], str]  # in the language of now


class Question(Dialog[bool]):
    """Asks; only `y` or its button says yes."""

    BINDINGS: ClassVar[list[BindingType]] = [("y", "answer(True)", "bind.yes"), ("n", "answer(False)", "bind.no")]

    def __init__(self, title: Wording, text: Wording) -> None:
        super().__init__()
        self._title = title
        self._text = text

    def compose(self) -> ComposeResult:
        with Vertical(classes="dialog") as box:
            box.border_title = self._title()
            with VerticalScroll(classes="dialog-text", can_focus=False):
                yield Static(self._text(), markup=False)
            with Horizontal(classes="dialog-buttons"):
                yield Button(f"{tr('dialog.no')} (n)", id="no")
                yield Button(f"{tr('dialog.yes')} (y)", id="yes", variant="primary")
        yield from self.compose_bottom()

    def on_button_pressed(self, event: Button.Pressed) -> None:
        self.dismiss(event.button.id == "yes")

    def action_answer(self, yes: bool) -> None:
        """Answer by key."""
        self.dismiss(yes)


def ask(app: App[None], title: Wording, text: Wording, then: Callable[[], Any]) -> None:
    """Ask, and go on after a yes."""
    question = Question(title, text)
    app.push_screen(question, question.answering(lambda yes: then() if yes else None))


class HealthPage(Dialog[None]):
    """What is behind the dot: camera, control, links, joints, in figures for an engineer."""

    HELP_PAGE = "health"
    BINDINGS: ClassVar[list[BindingType]] = [Binding("i", "cancel", "bind.cancel", id="health")]

    def __init__(self, devices: tuple[JointDevice, ...]) -> None:
        super().__init__()
        self._devices = devices

    def compose(self) -> ComposeResult:
        with VerticalScroll(classes="dialog page") as box:
            box.border_title = tr("health.title")
            yield Panel(id="health")
        yield from self.compose_bottom()

    def show_session(self, state: SessionState | None) -> None:
        super().show_session(state)
        if state is not None:
            panel = self.query_one("#health", Panel)
            before = len(panel.lines)
            panel.lines = health_lines(state, self._devices, panel.content_size.width)
            if len(panel.lines) != before:
                panel.refresh(layout=True)


class Choice(Dialog[T], Generic[T]):
    """One of several: by its key, or from the list."""

    TEXTS: ClassVar[tuple[str, str]]  # keys of title and text
    BY_KEY: ClassVar[Mapping[str, Any]]

    def describe(self, key: str) -> Content:
        """What this key chooses."""
        raise NotImplementedError

    def compose(self) -> ComposeResult:
        title, text = self.TEXTS
        with Vertical(classes="dialog") as box:
            box.border_title = tr(title)
            yield Static(tr(text), markup=False)
            yield OptionList(*self.options())
        yield from self.compose_bottom()

    def options(self) -> list[Option]:
        """The list, as it is now."""
        return [Option(self.describe(key), id=key) for key in self.BY_KEY]

    def on_screen_resume(self) -> None:
        """Enter alone must choose nothing, least of all what was chosen last."""
        self.query_one(OptionList).highlighted = None

    def on_key(self, event: events.Key) -> None:
        if event.key in self.BY_KEY:
            event.stop()
            self.dismiss(self.BY_KEY[event.key])

    def on_option_list_option_selected(self, event: OptionList.OptionSelected) -> None:
        self.dismiss(self.BY_KEY[str(event.option_id)])


class GuidedTestChoice(Choice[GuidedTest]):
    """Which guided test begins."""

    HELP_PAGE = "session"
    TEXTS = ("guided.title", "guided.text")
    BY_KEY: ClassVar[Mapping[str, GuidedTest]] = {str(number): test for number, test in enumerate(GuidedTest, start=1)}

    def describe(self, key: str) -> Content:
        test = self.BY_KEY[key]
        return Content.assemble((f" {key}  ", "bold"), (tr(test), "bold"), f"\n    {tr(f'guided.how.{test.name}')}")


class TherapistAct(Choice[Action]):
    """The twelve actions by key; those that the machine allows now stand out."""

    TEXTS = ("act.title", "act.text")
    BY_KEY: ClassVar[Mapping[str, Action]] = {key: ACTION_OF[gesture] for key, gesture in GESTURE_KEYS.items()}

    def __init__(self, allowed: tuple[Action, ...]) -> None:
        super().__init__()
        self._allowed = allowed

    def show_session(self, state: SessionState | None) -> None:
        super().show_session(state)
        allowed = state.snapshot.allowed if state is not None and state.snapshot is not None else ()
        if allowed != self._allowed:
            self._allowed = allowed
            options = self.query_one(OptionList)
            at = options.highlighted
            options.clear_options()
            options.add_options(self.options())
            options.highlighted = at

    def describe(self, key: str) -> Content:
        action = self.BY_KEY[key]
        allowed = action in self._allowed
        return Content.assemble(
            (f" {key}  ", "bold"),
            (f"{FINGERS[GESTURE_KEYS[key]]}  ", ""),
            (tr(action), "bold $success" if allowed else "$text-muted"),
            ("" if allowed else f"  {tr('act.not_now')}", "$text-muted"),
        )


class Lists(Dialog[None]):
    """Lines that keep themselves up to date, there with the first paint: the checks, a patient's history."""

    def __init__(self) -> None:
        super().__init__()
        self._lines: Lines = ()

    def title_and_text(self) -> tuple[str, str]:
        """What stands in the border, and above the lines."""
        raise NotImplementedError

    def lines_of(self, state: SessionState | None) -> Lines:
        """What to show; None: no session."""
        raise NotImplementedError

    def compose(self) -> ComposeResult:
        self._lines = self.lines_of(self.console_app.live_state())
        title, text = self.title_and_text()
        with VerticalScroll(classes="dialog") as box:
            box.border_title = title
            yield Static(text, markup=False, id="text")
            yield Static(content_of(self._lines), id="lines")
        yield from self.compose_bottom()

    def show_session(self, state: SessionState | None) -> None:
        super().show_session(state)
        lines = self.lines_of(state)
        if lines != self._lines:
            self._lines = lines
            self.query_one("#lines", Static).update(content_of(lines))


class History(Lists):
    """What changed in a profile, when and by whom, newest first."""

    HELP_PAGE = "history"

    def __init__(self, name: str, changes: tuple[Change, ...]) -> None:
        super().__init__()
        self._patient, self._changes = name, changes

    def title_and_text(self) -> tuple[str, str]:
        """The patient."""
        return tr("history.title", name=self._patient), ""

    def lines_of(self, state: SessionState | None) -> Lines:  # noqa: ARG002 - a history has no session
        """Every change, in the language there is now."""
        return history_lines(self._changes)


def history_lines(changes: tuple[Change, ...]) -> Lines:
    """A head and a line a field for each change."""
    lines: list[tuple[tuple[str, str], ...]] = []
    for change in reversed(changes):
        who = change.by or tr("history.nobody")
        lines.append(
            (
                (f"{local_text(change.at)}  {who}", "bold $primary"),
                (f"  {tr(change.why) if knows(change.why) else change.why}", "$text-muted"),
            )
        )
        lines += [
            ((f"  {field_name(field)}{': ' if values else ''}", ""), (" → ".join(values or ()), "bold"))
            for field, values in changed_values(change.changes).items()
        ]
    return tuple(lines) or (plain(tr("history.none"), "$text-muted"),)


class AskText(Dialog[str]):
    """Asks for one line; Enter gives it, Escape gives nothing."""

    def __init__(self, title: Wording, text: Wording, start: str = "") -> None:
        super().__init__()
        self._title = title
        self._text = text
        self._start = start

    def compose(self) -> ComposeResult:
        with Vertical(classes="dialog") as box:
            box.border_title = self._title()
            yield Static(self._text(), markup=False)
            yield Input(self._start, id="answer", max_length=MAX_ANSWER)
        yield from self.compose_bottom()

    def keep(self) -> bool:
        return all(field.value == self._start for field in self.query(Input))

    def on_input_submitted(self, event: Input.Submitted) -> None:
        self.dismiss(event.value.strip())
