"""Frames per second of both cameras on the digital hand, from what the cable brings to the report.

A webcam's frame is decoded and goes through the pipeline; a D435i's colour and depth of 848×480 go through
librealsense, which aligns them, and the pipeline with its depth branch. One frame after the other in one process;
rendering the digital hand is not counted.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from app.evaluate.hand_motions import CHANGES, Moment, take
from app.evaluate.harness import DISTANCES_CM, FRAME_NS, Step
from app.evaluate.trigger.chain import CAMERAS, CHOICES, chain
from app.evaluate.trigger.table6 import FIRST_HAND, FRAMES, CameraRates, Change
from hal.cameras.camera import ImageArray
from hal.cameras.digital_hand.depth import DepthCamera
from hal.cameras.digital_hand.render import lens_for, person_of
from hal.cameras.realsense import RealSenseCamera
from hal.cameras.realsense_devices import DEPTH_SIZE
from hal.cameras.software_realsense import SoftwareRealSense
from kgdfa.pipeline import Detector, Pipeline, PipelineInput

JPEG_QUALITY = 90  # a webcam sends 1280×720 as MJPEG, 30 a second
READ_S = 1.0
WARM_UP = 3  # the first frames detect the hand and fill caches


def measure_rates(detector: Detector, *, focal_px: float, step: Step) -> CameraRates:
    """Each camera's frames per second at each distance, in robust mode, over one change of each kind."""
    rates: CameraRates = {}
    start_ns = 0
    for cm in DISTANCES_CM:
        moments = [
            moment
            for number in range(len(CHANGES))
            for moment in Change(distance_cm=cm, number=number, focal_px=focal_px).moments()[-FRAMES[2] :]
        ]
        person, lens = person_of(FIRST_HAND), lens_for(focal_px=focal_px)
        pipelines = [chain("robust", person, lens, detector, choice=CHOICES[name, "robust"]) for name in CAMERAS]
        start_ns += 1_000_000_000 + 2 * len(moments) * FRAME_NS
        rates[cm] = {
            "monocular": monocular_fps(pipelines[0], moments, start_ns),
            "D435i": depth_fps(pipelines[1], moments, start_ns + len(moments) * FRAME_NS, FIRST_HAND),
        }
        step()
    return rates


def monocular_fps(pipeline: Pipeline, moments: Sequence[Moment], start_ns: int) -> float:
    """Decoding and the whole pipeline, frames per second."""
    taken = [_jpeg(take(moment, index)[0]) for index, moment in enumerate(moments)]

    def one(index: int) -> None:
        image = np.asarray(cv2.imdecode(taken[index], cv2.IMREAD_COLOR), np.uint8)
        pipeline.process(PipelineInput(image_bgr=image, captured_ns=start_ns + index * FRAME_NS))

    return _rate(one, len(taken))


def depth_fps(pipeline: Pipeline, moments: Sequence[Moment], start_ns: int, seed: int) -> float:
    """librealsense, alignment, and the whole pipeline with its depth branch, frames per second."""
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
            PipelineInput(image_bgr=frame.image_bgr, captured_ns=start_ns + index * FRAME_NS, depth_m=frame.depth_m)
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
