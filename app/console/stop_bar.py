"""The STOP bar: on every screen, in every size, the same place."""

from __future__ import annotations

from textual.content import Content
from textual.widget import Widget

from app.console.language import knows, tr
from app.console.stop import StopSwitch
from app.ipc.states import Effect

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
