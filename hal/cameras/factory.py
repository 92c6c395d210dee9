"""Builds the camera that the configuration names."""

from __future__ import annotations

from hal.cameras.camera import Camera
from hal.errors import HardwareError


def open_camera(
    kind: str,
    *,
    device: str = "",
    width_px: int = 1280,
    height_px: int = 720,
    rate_hz: float = 30.0,
    focal_px: float | None = None,
    mirrored: bool = False,
    seed: int = 1,
    depth: bool = False,
) -> Camera:
    """A camera of a kind: digital-hand, webcam, realsense, recording. Not yet opened: `open` starts it.

    device: webcam: name or index; recording: path; realsense: serial number or path of a recording.
    Raises HardwareError for an unknown kind or impossible settings.
    """
    if kind == "digital-hand":
        from hal.cameras.digital_hand import DigitalHandCamera
        from hal.cameras.hand_scene import lens_for

        return DigitalHandCamera(seed=seed, lens=lens_for(width_px, height_px, focal_px), rate_hz=rate_hz, depth=depth)
    raise HardwareError(f"There is no camera of kind {kind!r}: choose digital-hand, webcam, realsense or recording.")
