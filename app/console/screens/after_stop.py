"""What leads on after a stop, on every screen that shows a session: each by two deliberate keys."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from app.console.screens.dialogs import ask
from app.ipc.messages import OperatorKind
from app.ipc.snapshot import ActiveEvent
from app.ipc.states import Effect
from app.text.catalogue import render, tr

if TYPE_CHECKING:
    from app.console.app import ConsoleApp


def ask_to_acknowledge(app: ConsoleApp) -> None:
    """Show what waits for an acknowledgement, and acknowledge it after a yes."""
    waiting = _waiting(app)
    if not waiting:
        app.notify(tr("acknowledge.nothing"))
        return

    def text() -> str:
        lines = [f"• {render(event.reason)}" for event in waiting]
        return "\n".join([*lines, "", tr("acknowledge.text", **app.key_names)])

    ask(app, lambda: tr("acknowledge.title"), text, partial(_acknowledge, app, waiting))


def ask_for_torque_off(app: ConsoleApp) -> None:
    """After a damping: the joints off, on the operator's word."""
    state = app.live_state()
    snapshot = None if state is None else state.snapshot
    if snapshot is None or not (snapshot.effect is Effect.DAMP or snapshot.damped):
        app.notify(tr("torque_off.only_damped"), severity="warning")
        return
    text = "torque_off.text" if snapshot.enabled else "torque_off.off"  # even so: it opens a silent bus anew
    ask(app, lambda: tr("torque_off.title"), lambda: tr(text), partial(app.command, OperatorKind.TORQUE_OFF))


def _waiting(app: ConsoleApp) -> list[ActiveEvent]:
    """The events that are not acknowledged."""
    state = app.live_state()
    return [event for event in state.events if not event.acknowledged] if state else []


def _acknowledge(app: ConsoleApp, shown: list[ActiveEvent]) -> None:
    """Control takes all that was raised before: where more waits than was shown, ask again."""
    known = {event.identity for event in shown}
    if not known.issuperset(event.identity for event in _waiting(app)):
        ask_to_acknowledge(app)
    else:
        app.command(OperatorKind.ACKNOWLEDGE)
