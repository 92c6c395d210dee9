"""A second of the four joints, summed tick by tick, for the audit trail."""

from __future__ import annotations

from math import isfinite

import numpy as np

from hal.joints.joints import JointArray, JointFeedback
from logs.records import JointStatistics, Quad


class JointSecond:
    """Collects ticks; `take` gives the record and starts anew."""

    def __init__(self) -> None:
        self._clear()

    def add(self, feedback: JointFeedback, target_rad: JointArray) -> None:
        """One tick."""
        angle_rad, torque_nm = feedback.position_rad, feedback.torque_nm
        error_rad = angle_rad - target_rad
        self.ticks += 1
        np.minimum(self._low[0], angle_rad, out=self._low[0])
        np.minimum(self._low[1], torque_nm, out=self._low[1])
        np.maximum(self._high[0], angle_rad, out=self._high[0])
        np.maximum(self._high[1], torque_nm, out=self._high[1])
        self._sum[0] += angle_rad
        self._sum[1] += torque_nm
        self._sum[2] += target_rad
        self._sum[3] += error_rad * error_rad
        self._temperature_c = feedback.temperature_c

    def take(self, period_s: float, state: str) -> JointStatistics:
        """The record of what was collected."""
        mean = self._sum / max(1, self.ticks)
        record = JointStatistics(
            period_s=period_s,
            angle_min_rad=_quad(self._low[0]),
            angle_mean_rad=_quad(mean[0]),
            angle_max_rad=_quad(self._high[0]),
            target_mean_rad=_quad(mean[2]),
            torque_min_nm=_quad(self._low[1]),
            torque_mean_nm=_quad(mean[1]),
            torque_max_nm=_quad(self._high[1]),
            temperature_c=_quad(self._temperature_c),
            tracking_rms_rad=_quad(np.sqrt(mean[3])),
            state=state,
        )
        self._clear()
        return record

    def _clear(self) -> None:
        self.ticks = 0
        self._low = np.full((2, 4), np.inf)
        self._high = np.full((2, 4), -np.inf)
        self._sum = np.zeros((4, 4))
        self._temperature_c = np.full(4, np.nan)


def _quad(values: JointArray) -> Quad:
    one, two, three, four = (float(value) if isfinite(value) else None for value in values)
    return one, two, three, four
