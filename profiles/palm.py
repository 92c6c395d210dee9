"""The reference segment, keypoints 5 to 17 (Eq. 4's H): how long it is for a patient, and its calibration.

A calibration wins over a measured palm, that over an estimate. A calibration at a known distance solves f·H (Eq. 4
turned round) for one patient and one camera.
"""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import Enum

import msgspec

from profiles.anthropometry import PalmEstimate, estimate_palm
from profiles.errors import Finding, ProfileError, ProfileFault
from profiles.fields import REFERENCE_RANGE_CM
from profiles.schema import Calibration, Profile

REFERENCE_OF_PALM = 0.75  # palm width less one finger, a finger being a quarter of it (paper, text at Eq. 4)
MEASURED_SD_M = 0.001  # a ruler across the palm
CALIBRATED_SD = 0.01  # a ruler to the palm: about 3 mm in 30 cm
ASPECT_SLACK = 0.01  # sizes that a camera calls 16:9 differ by so much, as 848×480


class ReferenceSource(Enum):
    """How the reference segment is known."""

    CALIBRATED = "calibrated"
    MEASURED = "measured"
    ESTIMATED = "estimated"


class PalmFinding(Enum):
    """What is known of a palm: codes of findings."""

    REFERENCE = "reference"  # source, length_m, palm_width_m, sd_m, distance_error
    ESTIMATE = "estimate"  # population, width_m, sd_m, distance_error
    NOT_AS_MEASURED = "not as measured"  # width_m, measured_m
    NOT_AS_ESTIMATED = "not as estimated"  # width_m, estimate_m, sd_m


@dataclass(frozen=True, slots=True, kw_only=True)
class ReferenceSegment:
    """The reference segment of one patient before one camera. sd_m: its expected error."""

    length_m: float
    sd_m: float
    source: ReferenceSource

    @property
    def distance_error(self) -> float:
        """The standard error that it puts on every distance, as a share."""
        return self.sd_m / self.length_m

    @property
    def palm_width_m(self) -> float:
        """The paper's palm width, of which the segment is a fixed share."""
        return self.length_m / REFERENCE_OF_PALM

    def explain(self) -> Finding:
        """The segment with its error and what that makes of a distance."""
        return Finding(
            PalmFinding.REFERENCE,
            {
                "source": self.source,
                "length_m": self.length_m,
                "palm_width_m": self.palm_width_m,
                "sd_m": self.sd_m,
                "distance_error": self.distance_error,
            },
        )


def reference_segment(
    profile: Profile, *, camera: str = "", focal_px: float = 0.0, width_px: int = 0, height_px: int = 0
) -> ReferenceSegment:
    """The best that is known of this patient before the camera of that name, focal length and image size."""
    calibration = calibration_for(profile, camera)
    if calibration is not None and (segment := _calibrated(calibration, focal_px, width_px, height_px)):
        return segment
    width_m, sd_m, source = profile.palm.measured_width_m, MEASURED_SD_M, ReferenceSource.MEASURED
    if width_m is None:
        estimate = palm_estimate(profile)
        width_m, sd_m, source = estimate.width_m, estimate.sd_m, ReferenceSource.ESTIMATED
    return ReferenceSegment(length_m=REFERENCE_OF_PALM * width_m, sd_m=REFERENCE_OF_PALM * sd_m, source=source)


def palm_estimate(profile: Profile) -> PalmEstimate:
    """What sex and stature say of this patient's palm, whatever else is known."""
    return estimate_palm(profile.sex, profile.stature_m, profile.palm.population)


def calibration_for(profile: Profile, camera: str) -> Calibration | None:
    """The newest calibration made with that camera."""
    made = [one for one in profile.calibrations if one.camera == camera]
    return max(made, key=lambda one: one.calibrated_at) if camera and made else None


def calibrated_camera(profile: Profile) -> str:
    """The camera of the newest calibration; empty: there is none."""
    newest = max(profile.calibrations, key=lambda one: one.calibrated_at, default=None)
    return newest.camera if newest else ""


def _calibrated(calibration: Calibration, focal_px: float, width_px: int, height_px: int) -> ReferenceSegment | None:
    """What was solved is f·H: with another focal length given for the same images, H follows.

    None for images of another shape, or of another width than a calibration without a height was made with: how a
    camera crops and scales them is not known.
    """
    focal_then_px = calibration.focal_px
    if focal_px > 0 and min(width_px, height_px, calibration.width_px) > 0:
        scale = _scale_to(calibration, width_px, height_px)
        if scale is None:
            return None
        focal_then_px = focal_px / scale
    length_m = calibration.focal_anchor_px_m / focal_then_px
    relative_sd = max(CALIBRATED_SD, calibration.residual)
    return ReferenceSegment(length_m=length_m, sd_m=relative_sd * length_m, source=ReferenceSource.CALIBRATED)


def _scale_to(calibration: Calibration, width_px: int, height_px: int) -> float | None:
    """How much larger images of this size are than those calibrated with, by the long side; None: not to be known."""
    if not calibration.height_px:  # taken as landscape; of another width it may have been of another shape
        return 1.0 if width_px == calibration.width_px and width_px >= height_px else None
    (short_px, long_px), (short_then_px, long_then_px) = (
        sorted((width_px, height_px)),
        sorted((calibration.width_px, calibration.height_px)),
    )
    same = abs(short_px / long_px * long_then_px / short_then_px - 1) <= ASPECT_SLACK
    return long_px / long_then_px if same else None


MIN_SAMPLES = 20
MAX_RESIDUAL = 0.05  # a hand held still before a good camera scatters by 1 to 2 %
MAX_DEVIATION_SD = 3.0  # from what is known of the palm otherwise
DISTANCE_RANGE_M = (0.15, 0.80)  # a palm fills the picture; a palm is a few pixels
_MAD_TO_SD = 1.4826


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibrated:
    """A calibration. doubt: why it is not plausible, None when it is."""

    calibration: Calibration
    reference_m: float
    expected: ReferenceSegment
    doubt: Finding | None


def calibrate(
    profile: Profile,
    *,
    camera: str,
    focal_px: float,
    width_px: int,
    distance_m: float,
    measured_m: Sequence[float],
    provisional_reference_m: float,
    offset_m: float,
    at: datetime,
    height_px: int = 0,
) -> Calibrated:
    """Solve f·H from distances measured with a provisional segment while the palm was `distance_m` away.

    offset_m: what the distances hold that is not proportional to the segment (`kgdfa.distance.HALF_PALM_M`).
    Raises ProfileError when there are too few samples, they scatter too much, the distance is out of range, or the
    segment is no palm's.
    """
    _check_samples(distance_m, measured_m)
    middle_m = statistics.median(measured_m)
    residual = _MAD_TO_SD * statistics.median(abs(one - middle_m) for one in measured_m) / middle_m
    if residual > MAX_RESIDUAL:
        raise ProfileError(ProfileFault.SCATTER, residual=residual, most=MAX_RESIDUAL)
    reference_m = provisional_reference_m * (distance_m - offset_m) / (middle_m - offset_m)
    _check_reference(reference_m, focal_px)
    calibration = Calibration(
        camera=camera,
        focal_anchor_px_m=focal_px * reference_m,
        focal_px=focal_px,
        distance_m=distance_m,
        residual=residual,
        calibrated_at=at.astimezone(UTC).isoformat(timespec="seconds"),
        width_px=width_px,
        height_px=height_px,
    )
    expected = reference_segment(profile)
    return Calibrated(
        calibration=calibration,
        reference_m=reference_m,
        expected=expected,
        doubt=_doubt(profile, reference_m, expected),
    )


def with_calibration(profile: Profile, calibration: Calibration) -> Profile:
    """The profile with this calibration in place of an earlier one for the same camera."""
    others = tuple(one for one in profile.calibrations if one.camera != calibration.camera)
    return msgspec.structs.replace(profile, calibrations=(*others, calibration))


def check_distance(distance_m: float) -> None:
    """Refuse a distance at which no palm is calibrated. Raises ProfileError."""
    low, high = DISTANCE_RANGE_M
    if not low <= distance_m <= high:
        raise ProfileError(ProfileFault.DISTANCE, distance_m=distance_m, low_m=low, high_m=high)


def _check_samples(distance_m: float, measured_m: Sequence[float]) -> None:
    check_distance(distance_m)
    if len(measured_m) < MIN_SAMPLES:
        raise ProfileError(ProfileFault.TOO_FEW_SAMPLES, count=len(measured_m), least=MIN_SAMPLES)


def _check_reference(reference_m: float, focal_px: float) -> None:
    low, high = (cm / 100 for cm in REFERENCE_RANGE_CM)
    if not low <= reference_m <= high:
        raise ProfileError(ProfileFault.NO_PALM, reference_m=reference_m, low_m=low, high_m=high, focal_px=focal_px)


def _doubt(profile: Profile, reference_m: float, expected: ReferenceSegment) -> Finding | None:
    off_sd = abs(reference_m - expected.length_m) / expected.sd_m
    # An estimate that a measured palm backs is tight: leave room for the focal length and keypoint bias.
    allowed_sd = MAX_DEVIATION_SD if expected.source is ReferenceSource.ESTIMATED else 8.0
    if off_sd <= allowed_sd:
        return None
    width_m = reference_m / REFERENCE_OF_PALM
    if expected.source is ReferenceSource.MEASURED:
        return Finding(PalmFinding.NOT_AS_MEASURED, {"width_m": width_m, "measured_m": expected.palm_width_m})
    estimate = palm_estimate(profile)
    return Finding(
        PalmFinding.NOT_AS_ESTIMATED, {"width_m": width_m, "estimate_m": estimate.width_m, "sd_m": estimate.sd_m}
    )


def explain_estimate(estimate: PalmEstimate) -> Finding:
    """A palm width that nobody measured, its error and what that makes of a distance."""
    return Finding(
        PalmFinding.ESTIMATE,
        {
            "population": estimate.population.value,
            "width_m": estimate.width_m,
            "sd_m": estimate.sd_m,
            "distance_error": estimate.distance_error,
        },
    )
