"""What a rehearsal is judged by: its figures, their limits, and what is said of those that pass them."""

from __future__ import annotations

from math import degrees, radians

from msgspec import Struct

from app.messages import Quad

RMS_LIMIT_RAD = radians(2.0)
CLEARANCE_LIMIT_M = 0.02
SLIDE_LIMIT_M = 0.02
PENETRATION_LIMIT_M = 0.005  # contacts in the simulation are a little soft
FALLEN_RAD = radians(10.0)  # of a joint from the pose it should end in
ALL_IT_HAS_NM = 1e-6  # a drive this near its limit was held there


class Verdict(Struct, frozen=True, kw_only=True):
    """One rehearsed action in figures; joints in the order of hal's Joint."""

    action: str
    passed: bool
    reasons: tuple[str, ...]
    duration_s: float = 0.0
    peak_torque_nm: Quad = (0.0, 0.0, 0.0, 0.0)
    torque_limit_nm: Quad = (0.0, 0.0, 0.0, 0.0)
    peak_speed_deg_s: Quad = (0.0, 0.0, 0.0, 0.0)
    speed_limit_deg_s: Quad = (0.0, 0.0, 0.0, 0.0)
    tracking_rms_deg: Quad = (0.0, 0.0, 0.0, 0.0)
    clearance_m: float | None = None  # None: no foot swings
    slide_m: float = 0.0
    penetration_m: float = 0.0
    contact_peak_n: float = 0.0
    stride_m: float = 0.0
    energy_j: float = 0.0
    temperature_c: float = 0.0
    balance_peak_nm: float = 0.0
    hold_peak_n: float = 0.0


def objections(verdict: Verdict, missed_rad: float, *, struck: bool) -> tuple[str, ...]:
    """Everything that is wrong with it.

    missed_rad: the farthest joint's distance from the pose that it should end in; struck: a leg met the obstacle.
    """
    worst_rms = max(verdict.tracking_rms_deg)
    clearance_m = verdict.clearance_m
    found = [
        (missed_rad > FALLEN_RAD, f"It ends {degrees(missed_rad):.0f}° from where it should."),
        (worst_rms > degrees(RMS_LIMIT_RAD), f"Tracking error {worst_rms:.1f}° rms, at most 2° are allowed."),
        (
            _any_above(verdict.peak_speed_deg_s, verdict.speed_limit_deg_s),
            f"A joint turns at {max(verdict.peak_speed_deg_s):.0f}°/s, beyond its limit.",
        ),
        (
            _any_above(verdict.peak_torque_nm, verdict.torque_limit_nm, by=-ALL_IT_HAS_NM),
            f"A drive gives all it has, {max(verdict.peak_torque_nm):.0f} Nm.",
        ),
        (
            clearance_m is not None and clearance_m < CLEARANCE_LIMIT_M,
            f"A swinging foot passes at {100 * (clearance_m or 0):.1f} cm, at least 2 cm are needed.",
        ),
        (verdict.slide_m > SLIDE_LIMIT_M, f"A standing foot slides {100 * verdict.slide_m:.1f} cm."),
        (
            verdict.penetration_m > PENETRATION_LIMIT_M,
            f"Something sinks {1000 * verdict.penetration_m:.0f} mm into something.",
        ),
        (struck, "A leg strikes the obstacle."),
    ]
    return tuple(text for wrong, text in found if wrong)


def _any_above(values: Quad, limits: Quad, by: float = 0.0) -> bool:
    return any(value > limit + by for value, limit in zip(values, limits, strict=True))
