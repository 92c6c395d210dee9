"""The next step in a sentence, so that nobody needs the manual; who can only watch is told what is going on instead."""

from __future__ import annotations

from collections.abc import Callable

from app.console.screens.checks import ready
from app.console.state import SessionState
from app.console.widgets.panel import Lines, plain
from app.ipc.messages import ControlSnapshot
from app.ipc.states import Effect, GaitState
from app.text.catalogue import tr

_LEGS_ASTRAY = (GaitState.UNPOWERED, GaitState.BETWEEN)
_ENDINGS = ("shutting down", "shutting down, giving way")  # control's events of these names, whose table brings numpy


def describe(state: SessionState, keys: dict[str, str], *, watching: bool = False) -> Lines:
    """One line; `keys` maps a key's name in the key table to how it is shown."""
    name, style = next_step(state)
    if watching:
        return (plain(f"· {tr(f'watch.{name}', **keys)}", style),)
    return (plain(f"▶ {tr(f'guide.{name}', **keys)}", style),)


def next_step(state: SessionState) -> tuple[str, str]:
    """Name of the words, and their style: the first row that applies."""
    for applies, name, style in _STEPS:
        if applies(state, state.snapshot):
            return name, style
    return _hand_step(state)


def _hand_step(state: SessionState) -> tuple[str, str]:
    report = state.report
    if report is not None and report.pressed:
        return "withdraw", "bold $success"
    if report is not None and report.gesture is not None:
        return "push", "bold $primary"
    return "sign", "$primary"


def _down(state: SessionState) -> bool:
    return any(not process.alive and process.exit_code is not None for process in state.processes)


def _gone(state: SessionState, name: str) -> bool:
    return any(process.name == name and not process.alive for process in state.processes)


def _ending(state: SessionState) -> bool:
    """Control's last word was that it ends: its silence after that is no fault."""
    return any(event.name in _ENDINGS for event in state.events)


_Applies = Callable[[SessionState, ControlSnapshot | None], bool]
_STEPS: tuple[tuple[_Applies, str, str], ...] = (
    (lambda state, _: bool(state.fault), "failed", "bold $error"),
    (lambda state, now: now is None and _down(state), "process_down", "bold $error"),
    (lambda _, now: now is None, "starting", "$text-muted"),
    (lambda state, _: _ending(state) and not _gone(state, "audit"), "ending", "bold $warning"),
    (lambda state, _: not state.snapshot_fresh and _gone(state, "guardian"), "nobody_stops", "bold $error"),
    (lambda state, _: not state.snapshot_fresh, "control_silent", "bold $error"),
    (lambda _, now: now is not None and now.effect is Effect.DAMP, "damped", "bold $error"),
    (lambda _, now: now is not None and now.effect is Effect.HOLD, "held", "bold $error"),
    (lambda _, now: now is not None and not now.patient_confirmed, "confirm", "bold $accent"),
    (lambda state, _: not ready(state), "checks", "bold $warning"),
    (lambda _, now: now is not None and not now.armed, "arm", "bold $accent"),
    (lambda _, now: now is not None and now.action is not None, "moving", "bold $accent"),
    (lambda _, now: now is not None and now.state in _LEGS_ASTRAY, "initialise", "bold $accent"),
)
