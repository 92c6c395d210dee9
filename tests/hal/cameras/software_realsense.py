"""A D435i made of librealsense's own software device, fed by the digital hand, and recorded by librealsense.

`software_device.add_to(context)` lists no device since librealsense 2.55 (its issue 13819), so the driver meets the
device through librealsense's recorder and playback.
"""

from __future__ import annotations

import gc
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pyrealsense2 as rs

from hal.cameras.digital_hand import DigitalHandCamera
from hal.cameras.hand_scene import lens_for

WIDTH, HEIGHT, RATE = 320, 180, 30
PERIOD_NS = 33_333_333
SERIAL = "000000000001"


def record(path: Path, frames: int = 8) -> DigitalHandCamera:
    """Write a .db3 of so many frame sets; the hand that was recorded, frame n (from 1) at n periods."""
    hand = DigitalHandCamera(seed=1, lens=lens_for(WIDTH, HEIGHT), depth=True, gesture="5", rest_m=0.4)
    device = rs.software_device()
    device.register_info(rs.camera_info.name, "Software D435I")
    device.register_info(rs.camera_info.serial_number, SERIAL)
    depth, depth_profile = _sensor(device, hand, rs.stream.depth, rs.format.z16)
    depth.add_read_only_option(rs.option.depth_units, 0.001)
    colour, colour_profile = _sensor(device, hand, rs.stream.color, rs.format.bgr8)
    same = rs.extrinsics()
    same.rotation, same.translation = [1, 0, 0, 0, 1, 0, 0, 0, 1], [0, 0, 0]
    depth_profile.register_extrinsics_to(colour_profile, same)
    recorder = rs.recorder(str(path), device)
    sensors = recorder.query_sensors()
    arrived = threading.Semaphore(0)
    for sensor in sensors:
        sensor.open(sensor.get_stream_profiles()[0])
        sensor.start(lambda _: arrived.release())
    for number in range(1, frames + 1):
        frame = hand.render(number * PERIOD_NS)
        assert frame.depth_m is not None
        _push(depth, depth_profile, (frame.depth_m * 1000).astype(np.uint16), number)
        _push(colour, colour_profile, frame.image_bgr, number)
    for _ in range(2 * frames):
        assert arrived.acquire(timeout=10)
    for sensor in sensors:
        sensor.stop()
        sensor.close()
    del recorder, sensors, sensor
    gc.collect()  # the recorder writes its index when it is destroyed
    return hand


def _sensor(device: Any, hand: DigitalHandCamera, kind: Any, layout: Any) -> tuple[Any, Any]:
    sensor = device.add_sensor("Stereo Module" if layout == rs.format.z16 else "RGB Camera")
    lens = rs.intrinsics()
    lens.width, lens.height = WIDTH, HEIGHT
    lens.fx, lens.fy, lens.ppx, lens.ppy = hand.lens.fx_px, hand.lens.fy_px, hand.lens.cx_px, hand.lens.cy_px
    lens.model, lens.coeffs = rs.distortion.none, [0.0] * 5
    stream = rs.video_stream()
    stream.type, stream.fmt, stream.index, stream.uid = kind, layout, 0, 1 if layout == rs.format.z16 else 2
    stream.width, stream.height, stream.fps = WIDTH, HEIGHT, RATE
    stream.bpp = 2 if layout == rs.format.z16 else 3
    stream.intrinsics = lens
    return sensor, rs.video_stream_profile(sensor.add_video_stream(stream))


def _push(sensor: Any, profile: Any, pixels: Any, number: int) -> None:
    whole = np.ascontiguousarray(pixels)
    video = rs.software_video_frame()
    video.pixels, video.stride, video.bpp = whole, whole.strides[0], whole.strides[1]
    video.timestamp, video.domain = number * PERIOD_NS / 1e6, rs.timestamp_domain.hardware_clock
    video.frame_number, video.profile = number, profile
    if whole.dtype == np.uint16:
        video.depth_units = 0.001
    sensor.on_video_frame(video)
