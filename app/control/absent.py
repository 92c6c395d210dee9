"""Joints that could not be opened: they answer nothing and say why, so that the console can show it."""

from __future__ import annotations

import numpy as np

from hal.errors import HardwareError
from hal.joints.joints import DriveFault, DriveState, JointCommand, JointFeedback

_UNKNOWN = np.full(4, np.nan)
_NEVER_NS = np.zeros(4, dtype=np.int64)


class AbsentJoints:
    """Stands in for a driver that refused to open, until the next try."""

    def __init__(self, reason: str) -> None:
        self._reason = reason

    def open(self, now_ns: int) -> None:  # noqa: ARG002 - the Protocol's
        """Raises HardwareError: that is why it stands here."""
        raise HardwareError(self._reason)

    def enable(self, now_ns: int) -> None:  # noqa: ARG002 - the Protocol's
        """Raises HardwareError."""
        raise HardwareError(self._reason)

    def write(self, command: JointCommand, now_ns: int) -> None:
        """Nobody is there to be told."""

    def read(self, now_ns: int) -> JointFeedback:  # noqa: ARG002 - the Protocol's
        """No joint has ever answered, nothing is known of any."""
        return JointFeedback(
            measured_ns=_NEVER_NS,
            position_rad=_UNKNOWN,
            velocity_rad_s=_UNKNOWN,
            torque_nm=_UNKNOWN,
            temperature_c=_UNKNOWN,
            faults=(DriveFault.NONE,) * 4,
            state=DriveState.UNCONFIGURED,
            detail=self._reason,
        )

    def close(self, now_ns: int) -> None:
        """Nothing is open."""
