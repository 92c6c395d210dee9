"""Screens that show a session's picture: its size, and the keys that move the digital hand."""

from __future__ import annotations

import time

from textual import on
from textual.timer import Timer

from app.console import keys
from app.console.screens.base import ConsoleScreen
from app.console.widgets.picture import Picture
from app.ipc.messages import HandCommand, HandPose
from kgdfa.gesture import Gesture

SHOWN_S = 0.7  # a new shape is shown for so long before it is pushed: taken in 0.2 s, voted, and the button's 0.2 s


class HandKeys(ConsoleScreen):
    """Turns keys into movements of the digital hand; with another camera the keys do not exist."""

    def __init__(self) -> None:
        super().__init__()
        self._pressing = False
        self._shown_s = 0.0  # when the shape was shown that the hand has now
        self._waiting: Timer | None = None  # a push until the shape has been shown

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:  # noqa: ARG002
        """Hand keys need a digital hand, and somebody who may do more than look."""
        if not action.startswith("hand_"):
            return True
        return self.console_app.has_digital_hand and not self.console_app.read_only

    @on(Picture.Resized, "#picture")
    def _ask_for_size(self, event: Picture.Resized) -> None:
        """Ask perception for a picture of just the size that can be shown."""
        self.console_app.tell_perception(event.wanted)

    def action_hand_sign(self, sign: str) -> None:
        """The digital hand shows a gesture, rests, or leaves; a push that waits is for the shape before."""
        self._shown_s = time.monotonic()
        if self._waiting is not None:
            self._waiting.stop()
        if sign == "rest":
            self._move(HandCommand(pose=HandPose.REST))
        elif sign == "none":
            self._move(HandCommand(pose=HandPose.AWAY))
        else:
            self._move(HandCommand(gesture=Gesture(sign)))

    def action_hand_click(self) -> None:
        """Push to the camera and draw back, once the shape has been shown, as a person does."""
        if self._waiting is not None:
            self._waiting.stop()
        push, left_s = HandCommand(click_s=keys.CLICK_S), self._shown_s + SHOWN_S - time.monotonic()
        if left_s > 0:
            self._waiting = self.set_timer(left_s, lambda: self._move(push))
        else:
            self._move(push)

    def action_hand_press(self) -> None:
        """Push and stay, or draw back."""
        self._pressing = not self._pressing
        self._move(HandCommand(press=self._pressing))

    def action_hand_move(self, x: int, y: int, z: int) -> None:
        """Move the digital hand a step: right, down, away from the camera."""
        step_m = keys.HAND_STEP_M
        self._move(HandCommand(move_x_m=x * step_m, move_y_m=y * step_m, move_z_m=z * step_m))

    def _move(self, command: HandCommand) -> None:
        self.console_app.live_session().move_hand(command)
