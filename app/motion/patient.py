"""From a patient's profile and the device to what planning and simulation need: body, gait, ranges, strength."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import radians

import numpy as np
from numpy.typing import NDArray

from hal.joints.body import Body, average_body
from hal.joints.device import Exoskeleton
from profiles.schema import GaitParameters, Profile

PLAN_RANGE_MARGIN_RAD = radians(1.0)  # the plan keeps this far inside the ranges, tracking errors take the rest
PLAN_SPEED_SHARE = 0.8  # of the device's joint speed that a plan may use
PLAN_TORQUE_SHARE = 0.9  # of the device's joint torque that the estimate may reach

FourJoints = NDArray[np.float64]  # (4,), in the order of hal.joints.protocol.Joint


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Patient:
    """A wearer in this device: what a plan is made from and checked against. Compared by identity, so that what is
    solved once for a patient can be kept."""

    identifier: str
    body: Body
    gait: GaitParameters
    device_kg: float
    low_rad: FourJoints
    high_rad: FourJoints
    speed_rad_s: FourJoints  # what a plan may use
    torque_nm: FourJoints  # what a plan's estimate may reach
    hip_max_rad: float | None = None  # the patient's own ranges, where narrower than the device's
    knee_max_rad: float | None = None


def body_of(profile: Profile) -> Body:
    """The wearer's body; measured lengths win over those estimated from stature."""
    body = average_body(profile.stature_m, profile.mass_kg, profile.gait.body_weight_support)
    return replace(
        body,
        thigh_m=profile.thigh_length_m or body.thigh_m,
        shank_m=profile.shank_length_m or body.shank_m,
    )


def patient_of(profile: Profile, device: Exoskeleton) -> Patient:
    """The wearer in the device; the narrower of device's and patient's own range holds."""
    own = [profile.hip_max_rad, profile.knee_max_rad] * 2
    high = [
        min(radians(joint.max_deg), mine if mine is not None else np.inf)
        for joint, mine in zip(device.joints, own, strict=True)
    ]
    return Patient(
        identifier=profile.identifier,
        body=body_of(profile),
        gait=profile.gait,
        device_kg=device.mass_kg,
        low_rad=np.radians([joint.min_deg for joint in device.joints]) + PLAN_RANGE_MARGIN_RAD,
        high_rad=np.array(high) - PLAN_RANGE_MARGIN_RAD,
        speed_rad_s=PLAN_SPEED_SHARE * np.radians([joint.max_speed_deg_s for joint in device.joints]),
        torque_nm=PLAN_TORQUE_SHARE * np.array([joint.max_torque_nm for joint in device.joints]),
        hip_max_rad=profile.hip_max_rad,
        knee_max_rad=profile.knee_max_rad,
    )
