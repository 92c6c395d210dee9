"""Keys and course move the digital hand; any other camera has no hand to move."""

from __future__ import annotations

from app.ipc.messages import HandCommand
from hal.cameras.camera import Camera
from hal.cameras.digital_hand.camera import DigitalHandCamera


def steer(camera: Camera, command: HandCommand) -> None:
    """Pass a command on to the digital hand. Raises HardwareError for what it can't do."""
    if not isinstance(camera, DigitalHandCamera):
        return
    shape = command.gesture or command.pose
    moved = (command.move_x_m, command.move_y_m, command.move_z_m)
    camera.command(
        gesture=shape.value if shape is not None else None,
        press=command.press,
        click_s=command.click_s,
        move_m=moved if any(moved) else None,
    )
