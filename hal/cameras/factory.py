"""Builds the camera that the configuration names."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hal.cameras.camera import Camera
from hal.errors import CameraFault, HardwareError, RecordingFault
from logs.reading.regular import path_named


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraRequest:
    """All settings of a camera."""

    device: str = ""
    width_px: int = 1280
    height_px: int = 720
    rate_hz: float = 30.0
    focal_px: float | None = None
    mirrored: bool = False
    seed: int = 1
    depth: bool = False
    depth_holes: float = 0.0
    threshold_m: float | None = None
    left: bool | None = None
    limit: str = "none"
    store: Path | None = None


def open_camera(kind: str, **settings: Any) -> Camera:
    """A camera of a kind: digital-hand, webcam, realsense, recording; settings: those of CameraRequest. Not open yet.

    device: webcam: name or index; recording: a video, a folder of images or a recorded session; realsense:
    serial number, or path of a .bag or .db3. store: the cameras.toml with measured intrinsics.
    depth: whether the digital hand also gives depth; depth_holes: share of frames in which it misses the hand.
    threshold_m: how near the digital hand must push; it rests and stops as far from it as it does by itself from 20 cm.
    left: which of the digital person's hands; None: as the seed draws it. limit: what it can't do, of HandLimit.
    Raises HardwareError for an unknown kind or bad settings.
    """
    if kind not in _BUILDERS:
        raise HardwareError(CameraFault.UNKNOWN_KIND, kind=kind, known=", ".join(_BUILDERS))
    return _BUILDERS[kind](CameraRequest(**settings))


def _digital_hand(wanted: CameraRequest) -> Camera:
    from hal.cameras.digital_hand.driver import PRESS_M, REST_M, THRESHOLD_M, DigitalHandCamera
    from hal.cameras.digital_hand.movement import HandLimit
    from hal.cameras.digital_hand.render import lens_for, person_of

    lens = lens_for(wanted.width_px, wanted.height_px, wanted.focal_px)
    person = person_of(wanted.seed, left=wanted.left)
    return DigitalHandCamera(
        seed=wanted.seed,
        person=person,
        lens=lens,
        rate_hz=wanted.rate_hz,
        depth=wanted.depth,
        depth_holes=wanted.depth_holes,
        limit=HandLimit(wanted.limit),
        ahead=True,
        rest_m=REST_M if wanted.threshold_m is None else wanted.threshold_m + REST_M - THRESHOLD_M,
        press_m=PRESS_M if wanted.threshold_m is None else wanted.threshold_m + PRESS_M - THRESHOLD_M,
    )


def _webcam(wanted: CameraRequest) -> Camera:
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


def _recording(wanted: CameraRequest) -> Camera:
    from hal.cameras.playback import PlaybackCamera, RecordedFrame, folder_source, video_source

    path = path_named(wanted.device)

    def source() -> Iterator[RecordedFrame]:  # looked for when it is opened, as a webcam is: a session tells why not
        if not wanted.device:
            raise HardwareError(RecordingFault.NOT_NAMED)
        if not os.path.exists(path):  # noqa: PTH110 - that of pathlib raises for what may not be looked at
            raise HardwareError(RecordingFault.NOT_FOUND, path=path)
        folder = os.path.isdir(path)  # noqa: PTH112 - the same
        return folder_source(path, wanted.rate_hz)() if folder else video_source(path)()

    return PlaybackCamera(
        path,
        source,
        focal_px=wanted.focal_px,
        focal_size_px=(wanted.width_px, wanted.height_px),
        mirrored=wanted.mirrored,
        store=wanted.store,
    )


def _realsense(wanted: CameraRequest) -> Camera:
    from hal.cameras.realsense import RealSenseCamera

    return RealSenseCamera(
        wanted.device, width_px=wanted.width_px, height_px=wanted.height_px, rate_hz=round(wanted.rate_hz)
    )


_BUILDERS: dict[str, Callable[[CameraRequest], Camera]] = {
    "digital-hand": _digital_hand,
    "webcam": _webcam,
    "realsense": _realsense,
    "recording": _recording,
}
