"""Assembles what perception runs from the session's set-up: camera, detector, pipeline."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING

from app.perception.camera import PerceptionNote
from app.perception.reporting import MeasuredRate, Scale
from app.system.config import ArmFrom, SessionSetup
from app.system.hand_model import find_model
from app.system.paths import Home
from hal.cameras.camera import Camera, Frame, IntrinsicsSource
from hal.cameras.factory import open_camera
from kgdfa.button_state import RADIUS_SHARE, ButtonMode, ButtonPlace
from kgdfa.depth import LEAST_M, DepthRange
from kgdfa.distance import DistanceChoice, PublishedRange, RangeFinder
from kgdfa.gesture import RuleSet
from kgdfa.hand import Side
from kgdfa.pipeline import Pipeline
from kgdfa.preprocess import AsNeeded
from kgdfa.press_zone import PressZone, press_zone
from kgdfa.published import PublishedRules
from kgdfa.robust import RobustRules
from kgdfa.robust_distance import RobustRange
from kgdfa.track import Enrolment
from logs import records
from logs.reason import Reason, reason, reason_of
from profiles.palm import ReferenceSegment, ReferenceSource, calibration_for, reference_segment
from profiles.schema import DistanceUsed, HandUsed

if TYPE_CHECKING:
    from kgdfa.keypoints import HandDetector

RULES: dict[str, type[PublishedRules] | type[RobustRules]] = {"published": PublishedRules, "robust": RobustRules}
RANGES: dict[str, type[PublishedRange] | type[RobustRange]] = {"published": PublishedRange, "robust": RobustRange}

SIDES: dict[HandUsed, Side | None] = {HandUsed.LEFT: Side.LEFT, HandUsed.RIGHT: Side.RIGHT, HandUsed.EITHER: None}
_LEFT = {"left": True, "right": False, "either": None}
ARMS_RAD: dict[ArmFrom, float | None] = {
    "below": 0.0, "left": math.pi / 2, "above": math.pi, "right": -math.pi / 2, "anywhere": None,
}  # fmt: skip


def make_camera(setup: SessionSetup) -> Camera:
    """The camera the configuration names, not yet opened. Raises HardwareError for an impossible one."""
    wanted = setup.config.camera
    return open_camera(
        wanted.kind,
        device=wanted.device,
        width_px=wanted.width_px,
        height_px=wanted.height_px,
        rate_hz=wanted.rate_hz,
        focal_px=wanted.focal_px,
        mirrored=wanted.mirrored,
        seed=wanted.seed,
        depth=wanted.depth or setup.profile.distance_source is not DistanceUsed.MONOCULAR,
        depth_holes=wanted.depth_holes,
        # Depth alone is blind where the digital hand would push by itself.
        threshold_m=setup.profile.press_threshold_m if choice_of(setup) is DistanceChoice.DEPTH else None,
        limit=wanted.limit,
        left=_LEFT[setup.profile.hand.value if wanted.hand == "profile" else wanted.hand],
        store=Home(setup.home).cameras,
    )


def make_detector(setup: SessionSetup) -> HandDetector:
    """The hand detector on this home's model; takes seconds. Raises AppError or KgdfaError."""
    from kgdfa.keypoints import live_detector  # brings mediapipe, two seconds of imports

    return live_detector(find_model(Home(setup.home), setup.config))


def make_pipeline(
    setup: SessionSetup, detector: HandDetector, frame: Frame, camera: str
) -> tuple[Pipeline, ButtonPlace]:
    """The chain for this patient before this camera, whose first frame carries its intrinsics."""
    place = make_place(setup, frame)
    config = setup.config
    finder: RangeFinder = RANGES[config.button.mode](
        focal_px=frame.intrinsics.fx_px,
        reference_m=reference_for(setup, frame, camera).length_m,
        centre_px=(frame.intrinsics.cx_px, frame.intrinsics.cy_px),
        distortion=(frame.intrinsics.k1, frame.intrinsics.k2),
    )
    rules: RuleSet = RULES[config.rules]()
    mode = ButtonMode(config.button.mode)
    pipeline = Pipeline(
        detector=detector,
        rules=rules,
        range_finder=finder,
        place=place,
        mode=mode,
        prepare=AsNeeded(),
        # Robust: the published reading takes a hole for a hand at the lens, which is for the evaluations only.
        depth_finder=DepthRange(mode="robust"),  # this first frame may lack depth that others have
        choice=choice_of(setup),
        enrolment=enrolment_of(setup),
        follow=detector.follow,
    )
    return pipeline, place


def enrolment_of(setup: SessionSetup) -> Enrolment:
    """Whose hand commands: the profile's side, its arm from where the configuration says."""
    return Enrolment(side=SIDES[setup.profile.hand], arm_rad=ARMS_RAD[setup.config.camera.arm])


def choice_of(setup: SessionSetup) -> DistanceChoice:
    """Which distance commands for this patient."""
    return DistanceChoice(setup.profile.distance_source.value)


def make_place(setup: SessionSetup, frame: Frame) -> ButtonPlace:
    """The virtual button on this image."""
    width_px, height_px = frame.intrinsics.width_px, frame.intrinsics.height_px
    return ButtonPlace(
        x_px=setup.config.button.x * width_px,
        y_px=setup.config.button.y * height_px,
        radius_px=RADIUS_SHARE * width_px,
        threshold_m=setup.profile.press_threshold_m,
    )


def reference_for(setup: SessionSetup, frame: Frame, camera: str) -> ReferenceSegment:
    """The patient's reference segment before this camera."""
    lens = frame.intrinsics
    return reference_segment(
        setup.profile, camera=camera, focal_px=lens.fx_px, width_px=lens.width_px, height_px=lens.height_px
    )


def zone_for(setup: SessionSetup, frame: Frame, camera: str) -> PressZone:
    """Where a press works for this patient before this camera."""
    lens, segment = frame.intrinsics, reference_for(setup, frame, camera)
    return press_zone(
        focal_px=lens.fx_px,
        width_px=lens.width_px,
        height_px=lens.height_px,
        reference_m=segment.length_m,
        palm_width_m=segment.palm_width_m,
        least_m=LEAST_M if choice_of(setup) is DistanceChoice.DEPTH else 0.0,
        arm_rad=ARMS_RAD[setup.config.camera.arm],
    )


def lasting_hint(setup: SessionSetup, zone: PressZone, frame: Frame, camera: str) -> Reason | None:
    """Why this camera does not suit the patient: no depth, a threshold that does not fit, a calibration not in use."""
    if frame.depth_m is None and choice_of(setup) is not DistanceChoice.MONOCULAR:
        return reason(PerceptionNote.NO_DEPTH, camera=camera)
    threshold_m = setup.profile.press_threshold_m
    if not zone.fits(threshold_m):
        return reason(PerceptionNote.THRESHOLD_UNSUITED, threshold_m=threshold_m, zone=zone.explain())
    if calibration_for(setup.profile, camera) is None:
        return None
    in_use = reference_for(setup, frame, camera).source is ReferenceSource.CALIBRATED
    return None if in_use else reason(PerceptionNote.CALIBRATION_UNUSED, camera=camera)


def scale_of(setup: SessionSetup, frame: Frame, camera: str) -> Scale:
    """What turns pixels into metres for this patient before this camera."""
    segment, lens = reference_for(setup, frame, camera), frame.intrinsics
    return Scale(
        anchor_m=segment.length_m,
        anchor_method=segment.source.value,
        focal_px=lens.fx_px,
        focal_source=lens.source.value,
    )


def rests_on_assumption(scale: Scale) -> bool:
    """Whether distances rest on an assumed focal length; a calibration solves f·H, whatever f is."""
    assumed = scale.focal_source == IntrinsicsSource.ASSUMED.value
    return assumed and scale.anchor_method != ReferenceSource.CALIBRATED.value


def camera_records(
    setup: SessionSetup, camera: str, frame: Frame, rate: MeasuredRate | None = None
) -> tuple[records.Camera, records.Calibration]:
    """What the trail must hold of the camera of this name and of the reference segment in use."""
    observed, palm = frame.intrinsics, reference_for(setup, frame, camera)
    rate = rate or MeasuredRate()
    return (
        records.Camera(
            camera=camera,
            camera_kind=setup.config.camera.kind,
            width_px=observed.width_px,
            height_px=observed.height_px,
            rate_hz=setup.config.camera.rate_hz,
            focal_px=observed.fx_px,
            intrinsics_source=observed.source.value,
            mirrored=setup.config.camera.turned_back,
            measured_hz=rate.hz,
            frames=rate.frames,
        ),
        records.Calibration(
            method=palm.source.value,
            anchor_m=palm.length_m,
            focal_px=observed.fx_px,
            sd_m=palm.sd_m,
            focal_source=observed.source.value,
            text=reason_of(palm.explain()),
        ),
    )


class Loading:
    """The detector, built in a thread from `begin` on. Its error, if any, is raised by `ready`.

    Loading delays the first frame by half a second even beside it (one interpreter), so it begins after that frame.
    """

    def __init__(self, build: Callable[[], HandDetector]) -> None:
        self._build = build
        self._value: HandDetector | None = None
        self._error: Exception | None = None
        self._thread: threading.Thread | None = None

    def begin(self) -> None:
        """Start building, once."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="detector-loader", daemon=True)
            self._thread.start()

    def ready(self) -> HandDetector | None:
        """The detector, or None while it is being built. Raises what building raised."""
        if self._error is not None:
            raise self._error
        return self._value

    def close(self) -> None:
        """Close what was built."""
        if self._value is not None:
            self._value.close()

    def _run(self) -> None:
        try:
            self._value = self._build()
        except Exception as error:  # noqa: BLE001 - raised by `ready`
            self._error = error
