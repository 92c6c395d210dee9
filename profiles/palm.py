"""The palm anchor, the length of 5-17 (Eq. 4's H): a calibration wins over a measured palm, that over an estimate."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from profiles.anthropometry import PalmEstimate, estimate_palm
from profiles.schema import Calibration, Profile

ANCHOR_OF_PALM = 0.75  # palm width less one finger, a finger being a quarter of it (paper, text at Eq. 4)
MEASURED_SD_M = 0.001  # a ruler across the palm
CALIBRATED_SD = 0.01  # a ruler to the palm: about 3 mm in 30 cm


class AnchorSource(Enum):
    """How the anchor is known."""

    CALIBRATED = "calibrated"
    MEASURED = "measured"
    ESTIMATED = "estimated"


@dataclass(frozen=True, slots=True, kw_only=True)
class Anchor:
    """The anchor for one patient before one camera. sd_m: its expected error."""

    length_m: float
    sd_m: float
    source: AnchorSource

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


def anchor(profile: Profile, *, camera: str = "", focal_px: float = 0.0, width_px: int = 0) -> Anchor:
    """The best anchor there is for this patient before the camera of that name, focal length and picture width."""
    calibration = calibration_for(profile, camera)
    if calibration is not None:
        return _calibrated(calibration, focal_px, width_px)
    if profile.palm.measured_width_m is not None:
        return Anchor(
            length_m=ANCHOR_OF_PALM * profile.palm.measured_width_m,
            sd_m=ANCHOR_OF_PALM * MEASURED_SD_M,
            source=AnchorSource.MEASURED,
        )
    estimate = palm_estimate(profile)
    return Anchor(
        length_m=ANCHOR_OF_PALM * estimate.width_m,
        sd_m=ANCHOR_OF_PALM * estimate.sd_m,
        source=AnchorSource.ESTIMATED,
    )


def palm_estimate(profile: Profile) -> PalmEstimate:
    """What sex and stature say of this patient's palm, whatever else is known."""
    return estimate_palm(profile.sex, profile.stature_m, profile.palm.population)


def calibration_for(profile: Profile, camera: str) -> Calibration | None:
    """The newest calibration made with that camera."""
    made = [one for one in profile.calibrations if one.camera == camera]
    return max(made, key=lambda one: one.calibrated_at) if camera and made else None


def _calibrated(calibration: Calibration, focal_px: float, width_px: int) -> Anchor:
    """What was solved is f·H: with another focal length given for the same pictures, H follows."""
    focal_then_px = calibration.focal_px
    if focal_px > 0 and width_px > 0 and calibration.width_px > 0:
        focal_then_px = focal_px * calibration.width_px / width_px
    length_m = calibration.focal_anchor_px_m / focal_then_px
    relative_sd = max(CALIBRATED_SD, calibration.residual)
    return Anchor(length_m=length_m, sd_m=relative_sd * length_m, source=AnchorSource.CALIBRATED)
