"""Which RealSense cameras are connected, and what one of them says of itself.

librealsense is imported only here, and only when such a camera is opened or asked for.
"""

from __future__ import annotations

import json
import subprocess
import sys
from types import ModuleType
from typing import Any

from hal.cameras.camera import Intrinsics, IntrinsicsSource
from hal.errors import CameraFault, HardwareError

DEPTH_SIZE = (848, 480)  # the D435i's best depth mode, Intel's tuning guide
LISTING_LIMIT_S = 15.0
_LISTING = """
import json, pyrealsense2 as rs
found = rs.context().query_devices()
wanted = (rs.camera_info.serial_number, rs.camera_info.name)
devices = [found[number] for number in range(found.size())]
print(json.dumps([[one.get_info(what) if one.supports(what) else "" for what in wanted] for one in devices]))
"""


def library() -> ModuleType:
    """librealsense's Python module. Raises HardwareError without it."""
    try:
        import pyrealsense2 as rs
    except ImportError as error:
        raise HardwareError(CameraFault.NO_REALSENSE_LIBRARY, detail=str(error)) from error
    module: ModuleType = rs
    return module


def list_realsense() -> tuple[tuple[str, str], ...]:
    """Serial number and model of every connected camera. Raises HardwareError without the library or an answer.

    Asked in a process of its own: librealsense's context once spun without end, holding the interpreter.
    """
    library()
    try:
        asked = subprocess.run(
            [sys.executable, "-c", _LISTING], capture_output=True, check=True, timeout=LISTING_LIMIT_S
        )
    except (subprocess.SubprocessError, OSError) as error:
        raise HardwareError(CameraFault.NO_REALSENSE_LIBRARY, detail=type(error).__name__) from error
    return tuple((serial, name) for serial, name in json.loads(asked.stdout))


def find_device(rs: ModuleType, context: Any, serial: str) -> Any:
    """librealsense's device with that serial number, the first for "". Raises HardwareError when it isn't there."""
    # By index: `list` of librealsense's own sequence once went on without end in a process that had opened others.
    found = context.query_devices()
    devices = [found[number] for number in range(found.size())]
    for device in devices:
        if serial in ("", info_of(rs, device, "serial_number")):
            return device
    known = ", ".join(info_of(rs, device, "serial_number") for device in devices)
    if known:
        raise HardwareError(CameraFault.REALSENSE_IS_ANOTHER, serial=serial, known=known)
    raise HardwareError(CameraFault.REALSENSE_NOT_FOUND)


def info_of(rs: ModuleType, device: Any, what: str) -> str:
    """A member of `camera_info`; empty where the device does not say it."""
    key = getattr(rs.camera_info, what)
    return str(device.get_info(key)) if device.supports(key) else ""


def depth_mode(rs: ModuleType, device: Any) -> tuple[int, int]:
    """The best depth resolution that the device offers."""
    modes = {
        (mode.width(), mode.height())
        for sensor in device.query_sensors()
        for stream in sensor.get_stream_profiles()
        if stream.stream_type() == rs.stream.depth and (mode := stream.as_video_stream_profile())
    }
    return DEPTH_SIZE if DEPTH_SIZE in modes or not modes else max(modes)


def depth_unit_m(device: Any) -> float:
    """The length of a depth image's unit."""
    for sensor in device.query_sensors():
        if sensor.is_depth_sensor():
            return float(sensor.as_depth_sensor().get_depth_scale())
    return 0.001


def lens_of(lens: Any) -> Intrinsics:
    """librealsense's lens as ours; the factory's calibration counts as measured."""
    return Intrinsics(
        width_px=lens.width,
        height_px=lens.height,
        fx_px=lens.fx,
        fy_px=lens.fy,
        cx_px=lens.ppx,
        cy_px=lens.ppy,
        source=IntrinsicsSource.MEASURED,
    )
