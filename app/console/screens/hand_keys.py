"""What the screens with a session's picture share: it, the digital hand's keys, and those that lead on after a stop."""

from __future__ import annotations

import time
from functools import partial

from textual import on

from app.console import keys
from app.console.guidance import legs_of, may_switch_off
from app.console.screens.base import ConsoleScreen
from app.console.screens.dialogs import ask
from app.console.state import SessionState
from app.console.widgets.picture import Picture
from app.ipc.messages import HandCommand, HandPose, OperatorKind, TriggerReport
from app.ipc.snapshot import ActiveEvent
from app.text.catalogue import render, tr
from kgdfa.gesture import Gesture

SHAPE_SHOWN_S = 1.0  # a new shape is shown for so long before it is pushed: votes take their time on a busy machine


class HandKeys(ConsoleScreen):
    """Shows a session's picture; turns keys into movements of the digital hand, which only its camera has."""

    def __init__(self) -> None:
        super().__init__()
        self._shown_s = time.monotonic()  # since when a ready detector could see the hand's present shape
        self._push_waits = False  # until the shape has been shown
        self._incarnation: int | None = None  # of the perception that knows the picture's size

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:  # noqa: ARG002
        """Hand keys need a digital hand; they, and those after a stop, somebody who may do more than look."""
        app = self.console_app
        if action in ("acknowledge", "torque_off"):
            return app.live is not None and not app.read_only
        return not action.startswith("hand_") or (app.has_digital_hand and not app.read_only)

    def show_session(self, state: SessionState | None) -> None:
        super().show_session(state)
        if state is not None:
            if state.report is None or not state.report.detector_ready:
                self._shown_s = time.monotonic()  # nothing has detected the hand yet
            elif self._push_waits:
                self._push()
            if state.report is not None:
                self._keep_size(state.report)
            self.query_one("#picture", Picture).show(state)
            self.follow(state)

    def follow(self, state: SessionState) -> None:
        """Draw the session's newest state, besides its picture."""

    @on(Picture.Resized, "#picture")
    def _ask_for_size(self, event: Picture.Resized) -> None:
        """Ask perception for a picture of just the size that can be shown."""
        self.console_app.tell_perception(event.wanted)

    def _keep_size(self, report: TriggerReport) -> None:
        """Ask again for a picture of this size when perception was restarted."""
        if self._incarnation not in (None, report.incarnation):
            self.query_one("#picture", Picture).ask()
        self._incarnation = report.incarnation

    def action_acknowledge(self) -> None:
        """Show what waits for an acknowledgement, and acknowledge it after a yes."""
        waiting = self._waiting()
        if not waiting:
            self.app.notify(tr("acknowledge.nothing"))
            return

        def text() -> str:
            lines = [f"• {render(event.reason)}" for event in waiting]
            return "\n".join([*lines, "", tr("acknowledge.text", **self.console_app.key_names)])

        ask(self.console_app, lambda: tr("acknowledge.title"), text, lambda: self._acknowledge(waiting))

    def _waiting(self) -> list[ActiveEvent]:
        """The events that are not acknowledged."""
        state = self.console_app.live_state()
        return [event for event in state.events if not event.acknowledged] if state else []

    def _acknowledge(self, shown: list[ActiveEvent]) -> None:
        """Control takes all that was raised before: where more waits than was shown, ask again."""
        known = {event.identity for event in shown}
        if not known.issuperset(event.identity for event in self._waiting()):
            self.action_acknowledge()
        else:
            self.console_app.command(OperatorKind.ACKNOWLEDGE)

    def action_torque_off(self) -> None:
        """After a damping: the joints off, on the operator's word."""
        app = self.console_app
        state = app.live_state()
        snapshot = None if state is None else state.snapshot
        if snapshot is None or not may_switch_off(snapshot):
            app.notify(tr("torque_off.only_damped"), severity="warning")
            return
        text = "torque_off.text" if snapshot.enabled else f"torque_off.{legs_of(snapshot)}"  # opens a silent bus anew
        ask(app, lambda: tr("torque_off.title"), lambda: tr(text), partial(app.command, OperatorKind.TORQUE_OFF))

    def action_hand_sign(self, sign: str) -> None:
        """The digital hand shows a gesture, rests, or leaves; a push that waits is for the shape before."""
        self._shown_s = time.monotonic()
        self._push_waits = False
        if sign == "rest":
            self._move(HandCommand(pose=HandPose.REST))
        elif sign == "none":
            self._move(HandCommand(pose=HandPose.AWAY))
        else:
            self._move(HandCommand(gesture=Gesture(sign)))

    def action_hand_click(self) -> None:
        """Push to the camera and draw back, once the shape has been shown, as a person does."""
        self._push()

    def _push(self) -> None:
        self._push_waits = time.monotonic() - self._shown_s < SHAPE_SHOWN_S
        if not self._push_waits:
            self._move(HandCommand(click_s=keys.CLICK_S))

    def action_hand_press(self) -> None:
        """Push and stay, or draw back."""
        self._move(HandCommand(press=not self.console_app.live_session().hand.press))

    def action_hand_move(self, x: int, y: int, z: int) -> None:
        """Move the digital hand a step: right, down, away from the camera."""
        step_m = keys.HAND_STEP_M
        self._move(HandCommand(move_x_m=x * step_m, move_y_m=y * step_m, move_z_m=z * step_m))

    def _move(self, command: HandCommand) -> None:
        self.console_app.live_session().move_hand(command)
