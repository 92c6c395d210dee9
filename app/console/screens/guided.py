"""The choice of a guided test: by its digit, or from the list."""

from __future__ import annotations

from textual import events
from textual.app import ComposeResult
from textual.containers import Vertical
from textual.content import Content
from textual.widgets import OptionList, Static
from textual.widgets.option_list import Option

from app.console.screens.base import Dialog
from app.outcomes.guided import GuidedTest
from app.text.catalogue import tr

_BY_KEY = {str(number): test for number, test in enumerate(GuidedTest, start=1)}


class GuidedTestChoice(Dialog[GuidedTest]):
    """Which test begins."""

    HELP_PAGE = "session"

    def compose(self) -> ComposeResult:
        with Vertical(classes="dialog") as box:
            box.border_title = tr("guided.title")
            yield Static(tr("guided.text"), markup=False)
            yield OptionList(*(Option(_described(key, test), id=test.name) for key, test in _BY_KEY.items()))
        yield from self.compose_bottom()

    def on_screen_resume(self) -> None:
        """Enter alone must choose nothing, least of all what was chosen last."""
        self.query_one(OptionList).highlighted = None

    def on_key(self, event: events.Key) -> None:
        if event.key in _BY_KEY:
            event.stop()
            self.dismiss(_BY_KEY[event.key])

    def on_option_list_option_selected(self, event: OptionList.OptionSelected) -> None:
        self.dismiss(GuidedTest[str(event.option_id)])


def _described(key: str, test: GuidedTest) -> Content:
    return Content.assemble((f" {key}  ", "bold"), (tr(test), "bold"), f"\n    {tr(f'guided.how.{test.name}')}")
