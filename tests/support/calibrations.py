"""Calibrations of a palm, as a profile keeps them."""

from __future__ import annotations

from typing import Any

import msgspec

from profiles.schema import Calibration

_PALM = Calibration(
    camera="webcam",
    focal_anchor_px_m=50.0,
    focal_px=600.0,
    distance_m=0.36,
    residual=0.01,
    calibrated_at="2026-05-20T08:00:00+00:00",
)


def calibrated_with(**changes: Any) -> Calibration:
    """One of 20 May 2026 with a webcam, but for these fields."""
    return msgspec.structs.replace(_PALM, **changes)
