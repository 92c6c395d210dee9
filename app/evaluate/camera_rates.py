"""How many frames a second each camera's own way takes, from what the cable brings to the report.

Monocular: a webcam's compressed picture (MJPEG, as they send 1280×720 at 30 a second) is decoded and goes through the
pipeline. D435i: colour and depth of 848×480 go through librealsense, which aligns them, then through the pipeline with
its depth branch. One frame after the other in one process, on the digital hand; rendering it is not counted.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from app.evaluate.digital_scenes import Moment, take
from app.ipc.streams import TRIGGER
from hal.cameras.camera import ImageArray
from hal.cameras.digital_hand.depth import DepthCamera
from hal.cameras.realsense import DEPTH_SIZE, RealSenseCamera
from hal.cameras.software_realsense import SoftwareRealSense
from kgdfa.pipeline import Picture, Pipeline

CameraRates = dict[int, dict[str, float]]  # distance in cm → camera → frames a second

JPEG_QUALITY = 90
FRAME_NS = TRIGGER.period_ns
READ_S = 1.0
WARM_UP = 3  # the first frames find the hand and fill caches


def monocular_fps(pipeline: Pipeline, moments: Sequence[Moment], start_ns: int) -> float:
    """Decoding and the whole pipeline, frames a second."""
    taken = [_jpeg(take(moment, index)[0]) for index, moment in enumerate(moments)]

    def one(index: int) -> None:
        image = np.asarray(cv2.imdecode(taken[index], cv2.IMREAD_COLOR), np.uint8)
        pipeline.process(Picture(image_bgr=image, captured_ns=start_ns + index * FRAME_NS))

    return _rate(one, len(taken))


def depth_fps(pipeline: Pipeline, moments: Sequence[Moment], start_ns: int, seed: int) -> float:
    """librealsense's way, alignment, and the whole pipeline with its depth branch, frames a second."""
    stereo = DepthCamera(seed)
    software = SoftwareRealSense(moments[0].scene.lens, depth_size=DEPTH_SIZE)
    taken = [_with_depth(moment, index, stereo, software) for index, moment in enumerate(moments)]
    camera = RealSenseCamera(software=software.device)
    camera.open()

    def one(index: int) -> None:
        software.push(*taken[index], index + 1)
        frame = camera.read(READ_S if index else FRAME_NS / 1e9)  # the first set lacks a stream
        if frame is None:
            return
        pipeline.process(
            Picture(image_bgr=frame.image_bgr, captured_ns=start_ns + index * FRAME_NS, depth_m=frame.depth_m)
        )

    try:
        return _rate(one, len(taken))
    finally:
        camera.close()


def _with_depth(
    moment: Moment, index: int, stereo: DepthCamera, software: SoftwareRealSense
) -> tuple[ImageArray, NDArray[np.uint16]]:
    image, depth_m = take(moment, index, stereo)
    assert depth_m is not None
    return image, software.raw(depth_m)


def _jpeg(image: ImageArray) -> ImageArray:
    return np.asarray(cv2.imencode(".jpg", image, (cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY))[1], np.uint8)


def _rate(one: Callable[[int], None], frames: int) -> float:
    for index in range(WARM_UP):
        one(index)
    began = time.perf_counter()
    for index in range(WARM_UP, frames):
        one(index)
    return (frames - WARM_UP) / (time.perf_counter() - began)
