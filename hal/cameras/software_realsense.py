"""A D435i made of librealsense's own software device: what it is fed goes through the real library to the driver.

Tests feed it the digital hand with a D435i's failures; `rleex evaluate trigger` times the depth camera's chain with it.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from hal.cameras.camera import DepthArray, ImageArray, Intrinsics
from hal.cameras.realsense_devices import library

SERIAL = "000000000001"
DEPTH_UNIT_M = 0.001
RATE_HZ = 30


class SoftwareRealSense:
    """Colour and depth sensors behind one lens; `device` is librealsense's, for `RealSenseCamera(software=...)`."""

    def __init__(
        self,
        lens: Intrinsics,
        *,
        depth_size: tuple[int, int] | None = None,
        stated: Intrinsics | None = None,
        stated_depth: Intrinsics | None = None,
    ) -> None:
        """depth_size: (width, height) of the depth stream, the colour's when None. stated: what the device says its
        lenses are, as a damaged calibration may, whatever its images are. Raises HardwareError: no library."""
        rs = self._rs = library()
        self._period_ms = 1000 / RATE_HZ
        self._depth_size = depth_size or (lens.width_px, lens.height_px)
        self.device = rs.software_device()
        self.device.register_info(rs.camera_info.name, "Software D435I")
        self.device.register_info(rs.camera_info.serial_number, SERIAL)
        depth_lens = _resized(lens, *self._depth_size)
        self._depth, self._depth_profile = self._add("Stereo Module", rs.stream.depth, depth_lens, stated=stated_depth)
        self._depth.add_read_only_option(rs.option.depth_units, DEPTH_UNIT_M)
        self._colour, self._colour_profile = self._add("RGB Camera", rs.stream.color, lens, stated=stated)
        self._depth_profile.register_extrinsics_to(self._colour_profile, _same_place(rs))
        self.device.create_matcher(rs.matchers.dlr_c)

    def raw(self, depth_m: DepthArray) -> NDArray[np.uint16]:
        """(h, w) float32 metres of the colour's size, in the depth stream's size and units."""
        raw = np.round(depth_m / DEPTH_UNIT_M).astype(np.uint16)
        if raw.shape == self._depth_size[::-1]:
            return raw
        return np.asarray(cv2.resize(raw, self._depth_size, interpolation=cv2.INTER_NEAREST), np.uint16)

    def push(self, image_bgr: ImageArray, raw_depth: NDArray[np.uint16], number: int) -> None:
        """Frame `number`, counted from 1: (h, w, 3) uint8, and depth as `raw` makes it."""
        self._send(self._depth, self._depth_profile, raw_depth, number)
        self._send(self._colour, self._colour_profile, image_bgr, number)

    def _add(self, name: str, kind: Any, lens: Intrinsics, *, stated: Intrinsics | None) -> tuple[Any, Any]:
        rs, depth = self._rs, kind == self._rs.stream.depth
        layout = rs.format.z16 if depth else rs.format.bgr8
        stream = rs.video_stream()
        stream.type, stream.fmt, stream.index, stream.uid = kind, layout, 0, 1 if depth else 2
        stream.width, stream.height, stream.fps, stream.bpp = lens.width_px, lens.height_px, RATE_HZ, 2 if depth else 3
        stream.intrinsics = _rs_intrinsics(rs, stated or lens)
        sensor = self.device.add_sensor(name)
        return sensor, rs.video_stream_profile(sensor.add_video_stream(stream))

    def _send(self, sensor: Any, profile: Any, pixels: Any, number: int) -> None:
        rs, whole = self._rs, np.ascontiguousarray(pixels)
        video = rs.software_video_frame()
        video.pixels, video.stride, video.bpp = whole, whole.strides[0], whole.strides[1]
        video.timestamp, video.domain = number * self._period_ms, rs.timestamp_domain.hardware_clock
        video.frame_number, video.profile = number, profile
        if whole.dtype == np.uint16:
            video.depth_units = DEPTH_UNIT_M
        sensor.on_video_frame(video)


def _resized(lens: Intrinsics, width_px: int, height_px: int) -> Intrinsics:
    """The same field of view on another number of pixels."""
    across, down = width_px / lens.width_px, height_px / lens.height_px
    return Intrinsics(
        width_px=width_px,
        height_px=height_px,
        fx_px=lens.fx_px * across,
        fy_px=lens.fy_px * down,
        cx_px=(lens.cx_px + 0.5) * across - 0.5,
        cy_px=(lens.cy_px + 0.5) * down - 0.5,
        source=lens.source,
    )


def _rs_intrinsics(rs: Any, lens: Intrinsics) -> Any:
    made = rs.intrinsics()
    made.width, made.height = lens.width_px, lens.height_px
    made.fx, made.fy, made.ppx, made.ppy = lens.fx_px, lens.fy_px, lens.cx_px, lens.cy_px
    made.model, made.coeffs = rs.distortion.none, [0.0] * 5
    return made


def _same_place(rs: Any) -> Any:
    """No distance between the two sensors: the digital hand renders depth from the colour camera's place."""
    same = rs.extrinsics()
    same.rotation, same.translation = [1, 0, 0, 0, 1, 0, 0, 0, 1], [0, 0, 0]
    return same
