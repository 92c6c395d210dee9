"""The palm anchor, the length of 5-17 (Eq. 4's H): a calibration wins over a measured palm, that over an estimate."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import Enum

import msgspec

from profiles.anthropometry import PalmEstimate, estimate_palm
from profiles.errors import ProfileError
from profiles.schema import Calibration, Profile

REFERENCE_OF_PALM = 0.75  # palm width less one finger, a finger being a quarter of it (paper, text at Eq. 4)
MEASURED_SD_M = 0.001  # a ruler across the palm
CALIBRATED_SD = 0.01  # a ruler to the palm: about 3 mm in 30 cm


class ReferenceSource(Enum):
    """How the anchor is known."""

    CALIBRATED = "calibrated"
    MEASURED = "measured"
    ESTIMATED = "estimated"


@dataclass(frozen=True, slots=True, kw_only=True)
class ReferenceSegment:
    """The anchor for one patient before one camera. sd_m: its expected error."""

    length_m: float
    sd_m: float
    source: ReferenceSource

    @property
    def distance_error(self) -> float:
        """The standard error that it puts on every distance, as a share."""
        return self.sd_m / self.length_m

    @property
    def sentence(self) -> str:
        """For people."""
        return (
            f"palm anchor {self.length_m * 100:.2f} cm, {self.source.value}, "
            f"± {self.sd_m * 1000:.1f} mm, distance ± {self.distance_error * 100:.1f} %"
        )


def reference_segment(
    profile: Profile, *, camera: str = "", focal_px: float = 0.0, width_px: int = 0
) -> ReferenceSegment:
    """The best anchor there is for this patient before the camera of that name, focal length and picture width."""
    calibration = calibration_for(profile, camera)
    if calibration is not None:
        return _calibrated(calibration, focal_px, width_px)
    if profile.palm.measured_width_m is not None:
        return ReferenceSegment(
            length_m=REFERENCE_OF_PALM * profile.palm.measured_width_m,
            sd_m=REFERENCE_OF_PALM * MEASURED_SD_M,
            source=ReferenceSource.MEASURED,
        )
    estimate = palm_estimate(profile)
    return ReferenceSegment(
        length_m=REFERENCE_OF_PALM * estimate.width_m,
        sd_m=REFERENCE_OF_PALM * estimate.sd_m,
        source=ReferenceSource.ESTIMATED,
    )


def palm_estimate(profile: Profile) -> PalmEstimate:
    """What sex and stature say of this patient's palm, whatever else is known."""
    return estimate_palm(profile.sex, profile.stature_m, profile.palm.population)


def calibration_for(profile: Profile, camera: str) -> Calibration | None:
    """The newest calibration made with that camera."""
    made = [one for one in profile.calibrations if one.camera == camera]
    return max(made, key=lambda one: one.calibrated_at) if camera and made else None


def _calibrated(calibration: Calibration, focal_px: float, width_px: int) -> ReferenceSegment:
    """What was solved is f·H: with another focal length given for the same pictures, H follows."""
    focal_then_px = calibration.focal_px
    if focal_px > 0 and width_px > 0 and calibration.width_px > 0:
        focal_then_px = focal_px * calibration.width_px / width_px
    length_m = calibration.focal_anchor_px_m / focal_then_px
    relative_sd = max(CALIBRATED_SD, calibration.residual)
    return ReferenceSegment(length_m=length_m, sd_m=relative_sd * length_m, source=ReferenceSource.CALIBRATED)


MIN_SAMPLES = 20
MAX_RESIDUAL = 0.05  # a hand held still before a good camera scatters by 1 to 2 %
MAX_DEVIATION_SD = 3.0  # from what is known of the palm otherwise
DISTANCE_RANGE_M = (0.15, 0.80)
_MAD_TO_SD = 1.4826


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibrated:
    """A calibration, and what is to be thought of it. doubt: a sentence, "" when it is plausible."""

    calibration: Calibration
    reference_m: float
    expected: ReferenceSegment
    doubt: str


def calibrate(
    profile: Profile,
    *,
    camera: str,
    focal_px: float,
    width_px: int,
    distance_m: float,
    measured_m: Sequence[float],
    provisional_reference_m: float,
    at: datetime,
) -> Calibrated:
    """Solve f·H from distances measured with a provisional anchor while the palm was `distance_m` away.

    Raises ProfileError when there are too few samples, they scatter too much, or the distance is out of range.
    """
    _check_samples(distance_m, measured_m)
    middle_m = statistics.median(measured_m)
    residual = _MAD_TO_SD * statistics.median(abs(one - middle_m) for one in measured_m) / middle_m
    if residual > MAX_RESIDUAL:
        raise ProfileError(
            f"The samples scatter by {residual * 100:.1f} %, at most {MAX_RESIDUAL * 100:g} % will do: "
            "hold the palm flat and still towards the camera, in good light, and calibrate again."
        )
    reference_m = provisional_reference_m * distance_m / middle_m
    calibration = Calibration(
        camera=camera,
        focal_anchor_px_m=focal_px * reference_m,
        focal_px=focal_px,
        distance_m=distance_m,
        residual=residual,
        calibrated_at=at.astimezone(UTC).isoformat(timespec="seconds"),
        width_px=width_px,
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


def _check_samples(distance_m: float, measured_m: Sequence[float]) -> None:
    low, high = DISTANCE_RANGE_M
    if not low <= distance_m <= high:
        raise ProfileError(
            f"Calibration distance {distance_m * 100:g} cm: hold the palm {low * 100:g} to {high * 100:g} cm "
            "from the camera's front; 30 cm is best."
        )
    if len(measured_m) < MIN_SAMPLES:
        raise ProfileError(
            f"Only {len(measured_m)} of at least {MIN_SAMPLES} samples: show the whole hand to the camera, "
            "in good light, and calibrate again."
        )


def _doubt(profile: Profile, reference_m: float, expected: ReferenceSegment) -> str:
    off_sd = abs(reference_m - expected.length_m) / expected.sd_m
    # An estimate that a measured palm backs is tight: leave room for the focal length and keypoint bias.
    allowed_sd = MAX_DEVIATION_SD if expected.source is ReferenceSource.ESTIMATED else 8.0
    if off_sd <= allowed_sd:
        return ""
    return (
        f"This makes the palm {reference_m / REFERENCE_OF_PALM * 100:.1f} cm wide, while {_source(profile, expected)}: "
        "check the distance, the camera's focal length and the patient's stature."
    )


def _source(profile: Profile, expected: ReferenceSegment) -> str:
    if expected.source is ReferenceSource.MEASURED:
        return f"{expected.length_m / REFERENCE_OF_PALM * 100:.1f} cm were measured"
    estimate = palm_estimate(profile)
    return f"sex and stature say {estimate.width_m * 100:.1f} ± {estimate.sd_m * 100:.1f} cm"
