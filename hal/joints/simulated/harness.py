"""The simulated harness's reel: it locks in a fall, runs free without load, and lifts a wearer whose drives are off."""

from __future__ import annotations

from hal.joints.simulated.mjcf import TIMESTEP_S

LOCKS_M_S = 0.6  # a harness that pays out faster than this locks, as a fall-arrest reel does
STIFFNESS_N_M = 30_000.0
DAMPING_N_S_M = 4000.0
SLACK_S = 0.3  # without load for this long it runs free again
HELP_S, LIFT_M_S = 3.0, 0.1  # without torque for so long the wearer is lifted, as a helper does with a powered hoist


class Reel:
    """One step of physics a call; heights are the hip's, metres."""

    def __init__(self) -> None:
        self._locked_m: float | None = None
        self._slack_s = self._unpowered_s = 0.0

    def lock(self, height_m: float) -> None:
        """Lock at this height."""
        self._locked_m, self._slack_s = height_m, 0.0

    def lifts(self, *, unpowered: bool) -> bool:
        """Whether a helper lifts now; unpowered: the drives give no torque in this step."""
        self._unpowered_s = self._unpowered_s + TIMESTEP_S if unpowered else 0.0
        return self._unpowered_s > HELP_S

    def wind(self, height_m: float, most_m: float) -> None:
        """One step's lift towards the most height, never down."""
        locked = height_m if self._locked_m is None else self._locked_m
        if locked < most_m:
            self.lock(min(locked + LIFT_M_S * TIMESTEP_S, most_m))

    def force_n(self, height_m: float, speed_m_s: float) -> float:
        """What it carries beyond its constant share, newtons."""
        if self._locked_m is None:
            if speed_m_s > -LOCKS_M_S:
                return 0.0
            self._locked_m, self._slack_s = height_m, 0.0
        force = 0.0
        if height_m < self._locked_m:
            force = max(0.0, STIFFNESS_N_M * (self._locked_m - height_m) - DAMPING_N_S_M * speed_m_s)
        self._slack_s = self._slack_s + TIMESTEP_S if force <= 0 else 0.0
        if self._slack_s > SLACK_S:
            self._locked_m = None
        return force
