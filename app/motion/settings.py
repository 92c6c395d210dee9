"""What control is set up with for one session: device, patient, gains and poses, as arrays ready for the tick."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from app.ipc.states import GaitState
from hal.joints.device import Exoskeleton
from hal.joints.guard import Limits
from hal.joints.protocol import JointArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Gains:
    """The impedance of held and of damped joints, each (4,), SI at the joint."""

    stiffness_nm_rad: JointArray
    damping_nm_s_rad: JointArray
    slack_damping_nm_s_rad: JointArray  # alone, after a damp
    assist: JointArray  # share of the feed-forward torque, the weak side's scale


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """One session's constants; poses (4,) a state, radians."""

    limits: Limits
    gains: Gains
    poses: Mapping[GaitState, JointArray]
    warn_c: JointArray
    limit_c: JointArray
    patient: str
    simulated: bool = True


STIFFNESS_SHARE = 0.8  # of the device's greatest; the rest is the guard's margin
DAMPING_SHARE = 0.9


def gains_of(device: Exoskeleton, assist_left: float, assist_right: float) -> Gains:
    """Gains from the device's limits; the weak side's assist scales its stiffness and feed-forward torque."""
    assist = np.array([assist_left, assist_left, assist_right, assist_right])
    stiffest = np.array([joint.max_stiffness_nm_rad for joint in device.joints])
    most_damped = np.array([joint.max_damping_nm_s_rad for joint in device.joints])
    return Gains(
        stiffness_nm_rad=STIFFNESS_SHARE * stiffest * assist,
        damping_nm_s_rad=DAMPING_SHARE * most_damped,
        slack_damping_nm_s_rad=np.array([joint.damp_nm_s_rad for joint in device.joints]),
        assist=assist,
    )
