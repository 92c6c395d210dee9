"""The keys that move the digital hand: on the session's screen, in training, and where cameras are compared."""

from __future__ import annotations

from app.console import keys
from app.console.screens.base import ConsoleScreen
from app.ipc.messages import HandCommand, HandPose
from kgdfa.gesture import Gesture


class HandKeys(ConsoleScreen):
    """Turns keys into movements of the digital hand; with another camera the keys do not exist."""

    def __init__(self) -> None:
        super().__init__()
        self._pressing = False

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:  # noqa: ARG002
        """Hand keys need a digital hand, and somebody who may do more than look."""
        if not action.startswith("hand_"):
            return True
        return self.console_app.has_digital_hand and not self.console_app.read_only

    def action_hand_sign(self, sign: str) -> None:
        """The digital hand shows a gesture, rests, or leaves."""
        if sign == "rest":
            self._move(HandCommand(pose=HandPose.REST))
        elif sign == "none":
            self._move(HandCommand(pose=HandPose.AWAY))
        else:
            self._move(HandCommand(gesture=Gesture(sign)))

    def action_hand_click(self) -> None:
        """Push to the camera and draw back."""
        self._move(HandCommand(click_s=keys.CLICK_S))

    def action_hand_press(self) -> None:
        """Push and stay, or draw back."""
        self._pressing = not self._pressing
        self._move(HandCommand(press=self._pressing))

    def action_hand_move(self, x: int, y: int, z: int) -> None:
        """Move the digital hand a step."""
        self._move(keys.hand_move(x, y, z))

    def _move(self, command: HandCommand) -> None:
        self.console_app.live_session().move_hand(command)
