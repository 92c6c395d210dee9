"""The STOP bar: on every screen, in every size, the same place."""

from __future__ import annotations

from textual import events
from textual.content import Content
from textual.screen import Screen
from textual.widget import Widget

from app.console.stop import StopSwitch
from app.console.widgets.panel import cells
from app.ipc.states import Effect
from app.text.catalogue import knows, tr

_WORDS = {
    Effect.NOTE: "stop.ready",
    Effect.REFUSE: "stop.ready",
    Effect.HOLD: "stop.held",
    Effect.DAMP: "stop.damped",
}


class StopBar(Widget):
    """Says how to stop, and what has been stopped; a click stops too."""

    can_focus = False

    def __init__(self, switch: StopSwitch, *, watching: bool) -> None:
        super().__init__(classes="-live" if switch.live else None)
        self._switch = switch
        self._watching = watching
        self._words = self._describe(None)

    def show(self, effect: Effect | None) -> None:
        """Take the effect in force; None: no session."""
        words = self._describe(effect)
        if words != self._words:
            self._words = words
            self.refresh()
        self.set_class(self._switch.live, "-live")
        self.set_class(effect is not None and effect >= Effect.HOLD, "-held")

    def render(self) -> Content:
        return Content(self._words)

    def on_resize(self) -> None:
        self._tell_region()

    def on_show(self) -> None:
        self._tell_region()

    def on_mouse_down(self) -> None:
        self._switch.stop()

    def _tell_region(self) -> None:
        self.call_after_refresh(lambda: setattr(self._switch, "region", self.region))

    def _describe(self, effect: Effect | None) -> str:
        if self._watching:
            return tr("stop.watching")
        if not self._switch.live or effect is None:
            return tr("stop.idle") if not self._switch.live else tr("stop.ready", key=self._key())
        return tr(_WORDS[effect], key=self._key())

    def _key(self) -> str:
        return " / ".join(sorted(_shown(key) for key in self._switch.keys))


def _shown(key: str) -> str:
    return tr(f"key.{key}") if knows(f"key.{key}") else key.upper()


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
