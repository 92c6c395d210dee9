"""The keys of the screen in one line, each clickable: one widget, where a widget a key costs 20 ms a dialog."""

from __future__ import annotations

from textual import events
from textual.content import Content
from textual.screen import Screen
from textual.widget import Widget

from app.console.session.panel import cells


class KeyBar(Widget):
    """Shows the bindings that ask to be shown; a click on one presses its key."""

    can_focus = False

    def __init__(self) -> None:
        super().__init__()
        self._keys: tuple[tuple[str, str, str], ...] = ()  # key, how it is shown, what it does

    def on_mount(self) -> None:
        self.screen.bindings_updated_signal.subscribe(self, self._take)
        self.call_after_refresh(self._take, self.screen)

    def render(self) -> Content:
        parts = [part for _, shown, does in self._keys for part in ((f" {shown}", "bold $accent"), (f" {does} ", ""))]
        return Content.assemble(*parts)

    def on_click(self, event: events.Click) -> None:
        at = 0
        for key, shown, does in self._keys:
            at += cells(f" {shown} {does} ")
            if event.x < at:
                self.app.simulate_key(key)
                return

    def _take(self, screen: Screen[object]) -> None:
        if not self.is_attached or screen is not self.screen:
            return
        shown: dict[str, tuple[str, str, str]] = {}
        for active in screen.active_bindings.values():
            binding = active.binding
            if binding.show and active.enabled and binding.action not in shown:
                shown[binding.action] = (binding.key, self.app.get_key_display(binding), binding.description)
        keys = tuple(shown.values())
        if keys != self._keys:
            self._keys = keys
            self.refresh()
