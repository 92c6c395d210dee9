"""Intel RealSense D400 cameras, live or from a .bag or .db3: colour, and depth aligned to it.

It is read in a thread: a driver that hangs ("Frame didn't arrive within 5000") is reported two seconds after the last
frame and opened anew.
"""

from __future__ import annotations

import os
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import cv2
import numpy as np

from hal.cameras.camera import (
    DepthArray,
    EndOfRecording,
    Frame,
    ImageArray,
    Intrinsics,
    LatestFrame,
    UsualDelay,
)
from hal.cameras.intrinsics import check_possible
from hal.cameras.realsense_devices import depth_mode, depth_unit_m, find_device, info_of, lens_of, library
from hal.cameras.realsense_streams import PipelineStreams, SensorStreams, Streams
from hal.errors import CameraFault, HardwareError, RecordingFault
from logs.reading.regular import path_named

RECORDINGS = frozenset({".bag", ".db3"})
GRAB_MS = 200
FARTHEST_M = 20.0  # beyond it a reading is no measurement
DEPTH_AGE_NS = 100_000_000  # three images: either stream may be late by one, and a hand moves little
FrameId = tuple[int, float]  # number and time by the camera's clock, ms
_TO_BGR = {"rgb8": cv2.COLOR_RGB2BGR, "yuyv": cv2.COLOR_YUV2BGR_YUY2, "rgba8": cv2.COLOR_RGBA2BGR}


@dataclass(frozen=True, slots=True)
class _FrameSet:
    image_bgr: ImageArray
    depth_m: DepthArray | None
    captured_ns: int
    depth_ns: int


class RealSenseCamera:
    """One D400 camera or a recording of one."""

    def __init__(
        self,
        device: str = "",
        *,
        width_px: int = 1280,
        height_px: int = 720,
        rate_hz: int = 30,
        software: Any = None,
    ) -> None:
        """device: serial number, "" for the first, or the path of a recording.

        software: one of its software devices, in place of a camera.
        """
        self._device = device
        self._size = (width_px, height_px)
        self._rate_hz = rate_hz
        self._context: Any = None  # librealsense's
        self._software = software
        self._streams: Streams | None = None
        self._playback: Any = None
        self._align: Any = None
        self._depth_unit_m = 0.001
        self._intrinsics: Intrinsics | None = None
        self._latest: LatestFrame[_FrameSet] | None = None
        self._sequence = 0
        self._colour_id: FrameId | None = None
        self._depth_id: FrameId | None = None
        self._depth_ns = 0  # when that came first; 0: too late to count
        self._delay = UsualDelay()
        self._name = device or "RealSense"

    @property
    def name(self) -> str:
        """Model and serial number, or the recording's file name."""
        return self._name

    @property
    def finite(self) -> bool:
        """Whether it plays a recording."""
        return self._software is None and Path(self._device).suffix.lower() in RECORDINGS

    @property
    def _stamped_live(self) -> bool:
        """Whether its stamps go on with time; a recording's and a software device's need not."""
        return self._software is None and not self.finite

    def open(self) -> None:
        """Start it. Raises HardwareError: no library, no camera, a slow port, a recording that can't be read."""
        rs = library()
        config = rs.config()
        path = path_named(self._device)
        try:
            if self._software is not None:
                self._name = info_of(rs, self._software, "name") or "RealSense"
                self._begin(rs, SensorStreams(rs, self._software))
            else:
                if self.finite:
                    self._prepare_recording(config, path)
                else:
                    self._prepare_live(rs, config)
                self._begin(rs, PipelineStreams(rs, config, self._context))
        except HardwareError:
            self.close()
            raise
        except RuntimeError as error:
            self.close()
            code = CameraFault.REALSENSE_RECORDING_DAMAGED if self.finite else CameraFault.REALSENSE_NOT_STARTED
            detail = str(error).rpartition("Reason: ")[2]  # before it, librealsense repeats the whole path
            raise HardwareError(code, camera=self._name, detail=detail) from error
        self._sequence = 0
        streams = self._streams
        assert streams is not None
        self._latest = LatestFrame(
            lambda: self._grab(streams),
            lost=HardwareError(CameraFault.NO_FRAMES, camera=self._name),
        )

    def read(self, timeout_s: float) -> Frame | None:
        """The newest pair of colour and depth. Raises HardwareError when lost, EndOfRecording at a recording's end."""
        if self._latest is None or self._intrinsics is None:
            raise HardwareError(CameraFault.NOT_OPEN, camera=self._name)
        taken = self._latest.take(timeout_s)
        if taken is None:
            return None
        self._sequence += 1
        return Frame(
            image_bgr=taken.image_bgr,
            captured_ns=taken.captured_ns,
            sequence=self._sequence,
            intrinsics=self._intrinsics,
            depth_m=taken.depth_m,
            depth_ns=taken.depth_ns if taken.depth_m is not None else None,
        )

    def close(self) -> None:
        ended = self._latest.stop() if self._latest is not None else True
        if self._streams is not None and ended:
            with suppress(RuntimeError):  # the device has gone
                self._streams.stop()
        self._latest = self._streams = self._playback = None

    def _prepare_recording(self, config: Any, path: Path) -> None:
        if not os.path.isfile(path):  # noqa: PTH113 - that of pathlib raises for what may not be looked at
            raise HardwareError(RecordingFault.NOT_FOUND, path=path)
        self._name = path.name
        config.enable_device_from_file(str(path), repeat_playback=False)

    def _prepare_live(self, rs: ModuleType, config: Any) -> None:
        self._context = self._context or rs.context()
        device = find_device(rs, self._context, self._device)
        self._name = info_of(rs, device, "name") or "RealSense"
        serial = info_of(rs, device, "serial_number")
        if (usb := info_of(rs, device, "usb_type_descriptor")).startswith(("1", "2")):
            raise HardwareError(CameraFault.USB_TOO_SLOW, camera=self._name, usb=usb)
        if serial:
            config.enable_device(serial)
            self._name = f"{self._name} {serial}"
        config.enable_stream(rs.stream.color, *self._size, rs.format.bgr8, self._rate_hz)
        config.enable_stream(rs.stream.depth, *depth_mode(rs, device), rs.format.z16, self._rate_hz)

    def _begin(self, rs: ModuleType, streams: Streams) -> None:
        self._streams, device = streams, streams.device
        self._colour_id = self._depth_id = None
        self._delay = UsualDelay()
        self._playback = device.as_playback() if device.is_playback() else None
        running = {profile.stream_type(): profile for profile in streams.profiles}
        if rs.stream.color not in running:
            raise HardwareError(CameraFault.REALSENSE_NO_COLOUR, camera=self._name)
        self._intrinsics = self._lens(running[rs.stream.color], CameraFault.INTRINSICS_IMPOSSIBLE)
        if rs.stream.depth in running:
            self._lens(running[rs.stream.depth], CameraFault.DEPTH_INTRINSICS_IMPOSSIBLE)
        self._depth_unit_m = depth_unit_m(device)
        self._align = rs.align(rs.stream.color)

    def _lens(self, profile: Any, fault: CameraFault) -> Intrinsics:
        """Of one stream. Raises HardwareError with that fault for one that can't belong to the stream's images."""
        video = profile.as_video_stream_profile()
        lens = lens_of(video.get_intrinsics())
        check_possible(lens, video.width(), video.height(), camera=self._name, fault=fault)
        return lens

    def _grab(self, streams: Streams) -> _FrameSet | None:
        """One frame set; None when none with a new colour image came in time. Depth that is old counts as none.

        Beside a live stream, librealsense gives a stalled one's last frame again and again. A camera's frames that
        waited in its queues while this process stood still are none, by their stamps, of whatever clock.
        """
        try:
            frames = streams.wait(GRAB_MS)
            colour_id = None if frames is None else _frame_id(frames.get_color_frame())
            if frames is None or colour_id is None or colour_id == self._colour_id:
                self._check_end()
                return None
            captured_ns = time.monotonic_ns()
            depth_id = _frame_id(frames.get_depth_frame())
            if self._stamped_live and self._delay.exceeded(captured_ns - round(colour_id[1] * 1e6), captured_ns):
                self._colour_id, self._depth_id, self._depth_ns = colour_id, depth_id, 0
                return None
            aligned = self._align.process(frames)
            colour, depth = aligned.get_color_frame(), aligned.get_depth_frame()
        except RuntimeError as error:
            raise HardwareError(CameraFault.REALSENSE_LOST, camera=self._name, detail=str(error)) from error
        if depth_id not in {None, self._depth_id}:
            self._depth_id, self._depth_ns = depth_id, captured_ns
        has_depth = depth_id is not None and captured_ns - self._depth_ns <= DEPTH_AGE_NS
        self._colour_id = colour_id
        depth_m = clean_depth(np.asanyarray(depth.get_data()), self._depth_unit_m) if has_depth else None
        return _FrameSet(_bgr(colour), depth_m, captured_ns, self._depth_ns)

    def _check_end(self) -> None:
        if self._playback is not None and self._playback.current_status().name == "stopped":
            raise EndOfRecording


def clean_depth(raw: Any, unit_m: float) -> DepthArray:
    """Depth units to metres, float32; saturated and impossibly far readings become 0, no measurement."""
    depth: DepthArray = np.asarray(raw, dtype=np.float32) * np.float32(unit_m)
    depth[~((depth > 0) & (depth < FARTHEST_M))] = 0.0
    return depth


def _frame_id(frame: Any) -> FrameId | None:
    """Equal for one frame given twice; None without a frame."""
    return (frame.get_frame_number(), frame.get_timestamp()) if frame else None


def _bgr(colour: Any) -> ImageArray:
    image = np.asanyarray(colour.get_data())
    layout = colour.profile.format().name
    if layout == "yuyv":
        image = image.view(np.uint8).reshape(*image.shape[:2], 2)
    converted = cv2.cvtColor(image, _TO_BGR[layout]) if layout in _TO_BGR else image.copy()
    return np.asarray(converted, dtype=np.uint8)
