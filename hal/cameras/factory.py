"""Builds the camera that the configuration names."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from hal.cameras.camera import Camera
from hal.errors import HardwareError


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """Everything a configuration can say of a camera."""

    device: str
    width_px: int
    height_px: int
    rate_hz: float
    focal_px: float | None
    mirrored: bool
    seed: int
    depth: bool
    store: Path | None


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
    store: Path | None = None,
) -> Camera:
    """A camera of a kind: digital-hand, webcam, realsense, recording. Not yet opened: its `open` starts it.

    device: webcam: name or index; recording: a video, a folder of pictures or a recorded session; realsense:
    serial number, or path of a .bag or .db3. store: the cameras.toml with measured intrinsics.
    depth: whether the digital hand also gives depth. Raises HardwareError for an unknown kind or bad settings.
    """
    if kind not in _BUILDERS:
        raise HardwareError(f"There is no camera of kind {kind!r}: choose {', '.join(_BUILDERS)}.")
    return _BUILDERS[kind](
        Wanted(
            device=device,
            width_px=width_px,
            height_px=height_px,
            rate_hz=rate_hz,
            focal_px=focal_px,
            mirrored=mirrored,
            seed=seed,
            depth=depth,
            store=store,
        )
    )


def _digital_hand(wanted: Wanted) -> Camera:
    from hal.cameras.digital_hand.driver import DigitalHandCamera
    from hal.cameras.digital_hand.render import lens_for

    lens = lens_for(wanted.width_px, wanted.height_px, wanted.focal_px)
    return DigitalHandCamera(seed=wanted.seed, lens=lens, rate_hz=wanted.rate_hz, depth=wanted.depth)


def _webcam(wanted: Wanted) -> Camera:
    from hal.cameras.webcam import WebcamCamera

    return WebcamCamera(
        wanted.device,
        width_px=wanted.width_px,
        height_px=wanted.height_px,
        rate_hz=wanted.rate_hz,
        focal_px=wanted.focal_px,
        mirrored=wanted.mirrored,
        store=wanted.store,
    )


def _recording(wanted: Wanted) -> Camera:
    from hal.cameras.playback import PlaybackCamera, folder_moments, video_moments
    from hal.cameras.recording import INDEX, recorded_moments

    if not wanted.device:
        raise HardwareError("No recording is named: set the camera's device to a video or a folder of pictures.")
    path = Path(wanted.device).expanduser()
    if not path.exists():
        raise HardwareError(f"The recording {path} does not exist: check the path.")
    if (path / INDEX).exists():
        moments = recorded_moments(path)
    elif path.is_dir():
        moments = folder_moments(path, wanted.rate_hz)
    else:
        moments = video_moments(path)
    return PlaybackCamera(path, moments, focal_px=wanted.focal_px, mirrored=wanted.mirrored, store=wanted.store)


def _realsense(wanted: Wanted) -> Camera:
    from hal.cameras.realsense import RealSenseCamera

    return RealSenseCamera(
        wanted.device, width_px=wanted.width_px, height_px=wanted.height_px, rate_hz=round(wanted.rate_hz)
    )


_BUILDERS: dict[str, Callable[[Wanted], Camera]] = {
    "digital-hand": _digital_hand,
    "webcam": _webcam,
    "realsense": _realsense,
    "recording": _recording,
}
