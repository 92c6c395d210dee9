"""Calibrates a palm before a camera: collects distances while the palm is held at a known one, and solves f·H."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from enum import Enum

from app.system.errors import AppError
from hal.cameras.camera import FIRST_FRAME_S, SILENCE_S, Camera, EndOfRecording, Frame, Intrinsics
from kgdfa.distance import HALF_PALM_M
from kgdfa.pipeline import Detector
from kgdfa.robust_distance import RobustRange
from profiles.palm import Calibrated, calibrate, reference_segment
from profiles.schema import Profile

WANTED_SAMPLES = 45
MAX_FRAMES = 300  # ten seconds of a 30 Hz camera
FRAME_TIMEOUT_S = 0.5  # between two chances to interrupt
MAX_TILT_RAD = 0.6  # a palm turned further is not facing the camera


class PalmHint(Enum):
    """What the patient is to do while the palm is measured, or why nothing is."""

    SHOW_PALM = "show palm"
    SHOW_ONE_HAND = "show one hand"
    HOLD_FLAT = "hold flat"
    FACE_CAMERA = "face camera"
    HOLD_STILL = "hold still"
    NO_FRAME = "no frame"  # camera


@dataclass(slots=True)
class PalmSampler:
    """Distances of a palm by a provisional segment; feed it frames until it has enough."""

    profile: Profile
    detector: Detector
    samples_m: list[float]
    hint: PalmHint = PalmHint.SHOW_PALM
    _finder: RobustRange | None = None
    _lens: Intrinsics | None = None

    @property
    def provisional_reference_m(self) -> float:
        """What the profile knows of the palm without this camera."""
        return reference_segment(self.profile).length_m

    @property
    def enough(self) -> bool:
        """Whether to solve now."""
        return len(self.samples_m) >= WANTED_SAMPLES

    def take(self, frame: Frame) -> None:
        """One frame: a sample when a palm faces the camera, else a hint."""
        if self._finder is None or frame.intrinsics != self._lens:
            self._lens = frame.intrinsics
            self._finder = RobustRange(
                focal_px=self._lens.fx_px,
                reference_m=self.provisional_reference_m,
                centre_px=(self._lens.cx_px, self._lens.cy_px),
                distortion=(self._lens.k1, self._lens.k2),
            )
            self.samples_m.clear()
        hands = self.detector.detect(frame.image_bgr, frame.captured_ns)
        distance = self._finder.measure(hands[0], frame.captured_ns) if len(hands) == 1 else None
        if distance is None:
            self.hint = PalmHint.SHOW_ONE_HAND if len(hands) != 1 else PalmHint.HOLD_FLAT
        elif distance.tilt_rad > MAX_TILT_RAD:
            self.hint = PalmHint.FACE_CAMERA
        else:
            self.samples_m.append(distance.shown_m)
            self.hint = PalmHint.HOLD_STILL

    def solve(self, camera: str, distance_m: float, at: datetime) -> Calibrated:
        """The calibration. Raises ProfileError when the samples don't suffice."""
        return calibrate(
            self.profile,
            camera=camera,
            focal_px=self._lens.fx_px if self._lens else 0.0,
            width_px=self._lens.width_px if self._lens else 0,
            height_px=self._lens.height_px if self._lens else 0,
            distance_m=distance_m,
            measured_m=self.samples_m,
            provisional_reference_m=self.provisional_reference_m,
            offset_m=HALF_PALM_M,
            at=at,
        )


def sample_palm(
    profile: Profile, camera: Camera, detector: Detector, watch: Callable[[PalmSampler, Frame], None]
) -> PalmSampler:
    """Read an open camera until there are samples enough, ten seconds' worth of frames went by, or a recording ends.

    Raises AppError when no image comes, HardwareError when the camera is lost.
    """
    sampler = PalmSampler(profile, detector, [])
    for number in range(MAX_FRAMES):
        try:
            frame = _next_frame(camera, SILENCE_S if number else FIRST_FRAME_S)
        except EndOfRecording:
            break
        sampler.take(frame)
        watch(sampler, frame)
        if sampler.enough:
            break
    return sampler


def _next_frame(camera: Camera, limit_s: float) -> Frame:
    for _ in range(round(limit_s / FRAME_TIMEOUT_S)):
        frame = camera.read(FRAME_TIMEOUT_S)
        if frame is not None:
            return frame
    raise AppError(PalmHint.NO_FRAME, camera=camera.name)
