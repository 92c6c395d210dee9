"""The digital hand in a software D435i: recorded by librealsense, or live."""

from __future__ import annotations

import gc
import threading
from pathlib import Path

import pyrealsense2 as rs

from hal.cameras.digital_hand.driver import DigitalHandCamera
from hal.cameras.digital_hand.render import lens_for
from hal.cameras.software_realsense import SoftwareRealSense

WIDTH, HEIGHT = 320, 180
PERIOD_NS = 33_333_333


def a_hand(rest_m: float = 0.4) -> DigitalHandCamera:
    """With gesture 5, on a clock that tests set."""
    return DigitalHandCamera(
        seed=1, lens=lens_for(WIDTH, HEIGHT), depth=True, gesture="5", rest_m=rest_m, clock_ns=lambda: 0
    )


def feed(camera: SoftwareRealSense, hand: DigitalHandCamera, number: int) -> None:
    """Frame `number` of the hand, counted from 1."""
    frame = hand.render(number * PERIOD_NS)
    assert frame.depth_m is not None
    camera.push(frame.image_bgr, camera.raw(frame.depth_m), number)


def record(path: Path, frames: int = 8) -> DigitalHandCamera:
    """Write a .db3 of so many frame sets; the hand that was recorded, frame n (from 1) at n periods."""
    hand = a_hand()
    camera = SoftwareRealSense(hand.lens)
    recorder = rs.recorder(str(path), camera.device)
    sensors = recorder.query_sensors()
    arrived = threading.Semaphore(0)
    for sensor in sensors:
        sensor.open(sensor.get_stream_profiles()[0])
        sensor.start(lambda _: arrived.release())
    for number in range(1, frames + 1):
        feed(camera, hand, number)
    for _ in range(2 * frames):
        assert arrived.acquire(timeout=10)
    for sensor in sensors:
        sensor.stop()
        sensor.close()
    del recorder, sensors, sensor
    gc.collect()  # the recorder writes its index when it is destroyed
    return hand
