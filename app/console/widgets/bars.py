"""The two lines at the bottom of every screen: the STOP bar, and the keys."""

from __future__ import annotations

from collections.abc import Mapping

from textual import events
from textual.content import Content
from textual.reactive import reactive
from textual.screen import Screen
from textual.widget import Widget

from app.console.guidance import legs_of
from app.console.state import SessionState
from app.console.stop import StopSwitch
from app.console.widgets.panel import cells
from app.ipc.states import Effect
from app.text.catalogue import knows, tr


class StopBar(Widget):
    """Says how to stop, and what has been stopped; a click stops too."""

    can_focus = False
    text = reactive("")

    def __init__(self, switch: StopSwitch, keys: Mapping[str, str], *, watching: bool) -> None:
        """keys: how each key of the console is shown, by its id."""
        super().__init__(classes="-live" if switch.live else None)
        self._switch = switch
        self._watching = watching
        self._keys = keys
        self.set_reactive(StopBar.text, self._text_of(None))

    def show(self, state: SessionState | None) -> None:
        """Take the session's newest state; None: no session."""
        dead = self._switch.live and state is not None and state.control_ended
        live = self._switch.live and not dead
        # a silent control takes no key but STOP, once it goes on
        received = state.snapshot if state is not None and state.snapshot_fresh else None
        effect, legs = (None, "held") if received is None else (received.effect, legs_of(received))
        waits_ms = 0.0 if state is None else state.stop_waits_ms
        self.text = tr("stop.sent", ms=f"{waits_ms:.0f}") if live and waits_ms > 0 else self._text_of(effect, legs)
        self.set_class(live, "-live")
        held = effect is not None and effect >= Effect.HOLD and (live or self._watching)
        if state is None:
            powerless = not live and self._switch.left_on
        else:
            powerless = state.abandoned if dead else not live and state.left_on
        if (dead or powerless) and not self._watching:
            self.text = tr("stop.left_on" if powerless else "stop.ended")
        self.set_class(powerless or held, "-held")

    def render(self) -> Content:
        return Content(self.text)

    def on_resize(self) -> None:
        self._report_region()

    def on_show(self) -> None:
        self._report_region()

    def on_mouse_down(self) -> None:
        self._switch.click()

    def _report_region(self) -> None:
        self.call_after_refresh(lambda: setattr(self._switch, "region", self.region))

    def _text_of(self, effect: Effect | None, legs: str = "held") -> str:
        if self._watching:
            return tr("stop.watching")
        if not self._switch.live or effect is None:
            return tr("stop.idle") if not self._switch.live else tr("stop.ready", key=self._stop_keys())
        text = "ready" if effect < Effect.HOLD else legs
        return tr(f"stop.{text}", key=self._stop_keys(), **self._keys)

    def _stop_keys(self) -> str:
        return " / ".join(sorted(_shown(key) for key in self._switch.keys))


def _shown(key: str) -> str:
    return tr(f"key.{key}") if knows(f"key.{key}") else key.upper()


_Key = tuple[str, str, str]  # key, how it is shown, what it does


class KeyBar(Widget):
    """Shows the bindings that ask to be shown; a click on one presses its key.

    Textual's Footer makes a widget a key each time the keys change: five times the cost of opening a dialog.
    """

    can_focus = False
    keys = reactive[tuple[_Key, ...]](())

    def on_mount(self) -> None:
        self.screen.bindings_updated_signal.subscribe(self, self._take)
        self.call_after_refresh(self._take, self.screen)

    def render(self) -> Content:
        fitting = self._fitting()
        return Content.assemble(
            *(part for _, shown, does in fitting for part in ((f" {shown}", "bold $accent"), (f" {does} ", "")))
        )

    def on_click(self, event: events.Click) -> None:
        at = 0
        for key, shown, does in self._fitting():
            at += _width((key, shown, does))
            if event.x < at:
                self.app.simulate_key(key)
                return

    def _take(self, screen: Screen[object]) -> None:
        if not self.is_attached or screen is not self.screen:
            return
        shown: dict[str, _Key] = {}
        for active in screen.active_bindings.values():
            binding = active.binding
            if binding.show and active.enabled and binding.action not in shown:
                shown[binding.action] = (binding.key, self.app.get_key_display(binding), binding.description)
        helps = [shown.pop("help")] if "help" in shown else []  # last
        self.keys = (*shown.values(), *helps)

    def _fitting(self) -> tuple[_Key, ...]:
        """Those that fit, none of them cut; always the last one: help names all."""
        room, fitting = self.size.width - sum(map(_width, self.keys[-1:])), list[_Key]()
        for key in self.keys[:-1]:
            if _width(key) > room:
                break
            fitting.append(key)
            room -= _width(key)
        return (*fitting, *self.keys[-1:])


def _width(key: _Key) -> int:
    """Cells that it takes in the bar."""
    _, shown, does = key
    return cells(f" {shown} {does} ")
