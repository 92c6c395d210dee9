"""Cameras as people name them in commands and on the screen that compares two."""

from __future__ import annotations

import re
from os.path import exists, realpath

import msgspec

from app.perception.look import LookFault
from app.system.config import RATES_HZ, CameraConfig, with_camera
from app.system.errors import AppError
from logs.reading.regular import path_named
from profiles.schema import DistanceUsed

_DIGITAL = re.compile(r"(digital-hand|digital-d435i)(?::(\d{1,9}))?")
_RATE = re.compile(r"(.+)@(\d{1,3}(?:\.\d+)?)")


def parse_camera(source: str, base: CameraConfig) -> tuple[CameraConfig, DistanceUsed]:
    """A camera as people name it, and what it measures the distance with.

    digital-hand or digital-d435i (which gives depth), with `:SEED`; realsense; a webcam's name or number; the path of a
    recording. `@RATE` behind it: frames per second, but where a file has that name. Raises AppError for a bad rate.
    """
    rated = None if _exists(source) else _RATE.fullmatch(source)
    rate_hz = float(rated[2]) if rated else base.rate_hz
    least_hz, most_hz = RATES_HZ
    if not least_hz <= rate_hz <= most_hz:
        raise AppError(LookFault.RATE_OUT_OF_RANGE, rate_hz=rate_hz, least_hz=least_hz, most_hz=most_hz)
    source = rated[1] if rated else source
    digital = _DIGITAL.fullmatch(source)
    kind, device = ("digital-hand", "") if digital else kind_of(source)
    made = msgspec.structs.replace(with_camera(base, kind, device), rate_hz=rate_hz)
    depth = kind == "realsense"
    if digital:
        depth = digital[1] == "digital-d435i"
        made = msgspec.structs.replace(made, depth=depth, seed=int(digital[2]) if digital[2] else base.seed)
    return made, DistanceUsed.DEPTH if depth else DistanceUsed.MONOCULAR


def kind_of(source: str) -> tuple[str, str]:
    """Kind and device of a camera's name."""
    if source == "digital-hand":
        return source, ""
    if source == "realsense" or source.lower().endswith((".bag", ".db3")):
        return "realsense", "" if source == "realsense" else source
    looks_like_path = "/" in source and not source.startswith("/dev/video")
    if looks_like_path or _exists(source):
        return "recording", source
    return "webcam", source


def _exists(source: str) -> bool:
    """Whether a file or folder has this name; Path's own method raises for too long a name."""
    return exists(path_named(source))  # noqa: PTH110


def refuse_same_device(first: CameraConfig, second: CameraConfig) -> None:
    """Two names of one device can't be compared; one digital hand may be looked at twice. Raises AppError."""
    if first.kind == second.kind != "digital-hand" and _device_of(first) == _device_of(second):
        names = (first.device or first.kind, second.device or second.kind)
        raise AppError(LookFault.SAME_DEVICE, first=names[0], second=names[1])


def _device_of(camera: CameraConfig) -> str:
    if camera.kind == "webcam":
        from hal.cameras.webcam_list import find_webcam, list_webcams

        return str(find_webcam(camera.device, list_webcams()).index)
    if camera.kind == "recording" or camera.device.lower().endswith((".bag", ".db3")):
        return realpath(path_named(camera.device))
    if camera.device:
        return camera.device
    from hal.cameras.realsense_devices import list_realsense

    return next((serial for serial, _ in list_realsense()), "")
