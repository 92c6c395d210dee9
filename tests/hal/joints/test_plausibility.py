"""The watch on a drive's ranges finds a wrong velocity range, and takes no silence of a swinging leg for one."""

from __future__ import annotations

import math

import pytest

from hal.joints.joints import DriveFault
from hal.joints.plausibility import RangeWatch

TICK_NS = 2_000_000


def judged(*, share: float, silent_ms: float = 0.0, seconds: float = 3.0) -> DriveFault:
    """A leg swings ±0.3 rad at 3 Hz; velocities come scaled by `share`, and in every 50 ms there is a silence."""
    watch, verdict = RangeWatch(), DriveFault.NONE
    for now_ns in range(0, int(seconds * 1e9), TICK_NS):
        if now_ns % 50_000_000 < silent_ms * 1e6:
            continue
        phase = 2 * math.pi * 3.0 * now_ns / 1e9
        velocity = 0.3 * 2 * math.pi * 3.0 * math.cos(phase)
        verdict = watch.judge(0.3 * math.sin(phase), share * velocity, now_ns)
    return verdict


@pytest.mark.parametrize("silent_ms", [0.0, 8.0, 14.0, 20.0, 30.0, 45.0])
def test_silences_of_a_swinging_leg_are_no_wrong_range(silent_ms: float) -> None:
    assert judged(share=1.0, silent_ms=silent_ms) is DriveFault.NONE


@pytest.mark.parametrize("share", [50 / 22.5, 22.5 / 50, 50 / 25.64, 25.64 / 50])
def test_the_ranges_of_other_firmware_are_found(share: float) -> None:
    assert judged(share=share) is DriveFault.WRONG_RANGE


@pytest.mark.parametrize("share", [50 / 22.5, 22.5 / 50])
def test_they_are_found_between_short_silences_too(share: float) -> None:
    assert judged(share=share, silent_ms=8.0) is DriveFault.WRONG_RANGE


def test_a_leg_at_rest_proves_nothing() -> None:
    watch = RangeWatch()
    verdicts = {watch.judge(0.1, 0.02, now_ns) for now_ns in range(0, 2_000_000_000, TICK_NS)}
    assert verdicts == {DriveFault.NONE}
