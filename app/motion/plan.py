"""What is asked of the planner and what it gives: a motion as a table of samples at the tick rate, and its check.

Planning takes milliseconds, a tick has two: plans are made in the planner process and arrive as arrays, so that
the tick only looks up its row. Walking is a chain of one-step plans, each requested while the one before runs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
from math import radians

import numpy as np
from msgspec import Struct

from app.ipc.snapshot import Quad
from app.ipc.states import Action, GaitState
from app.motion.kinematics import Array
from hal.joints.body import Body, average_body
from hal.joints.device import Exoskeleton
from hal.joints.protocol import TICK_HZ, JointArray
from logs.reason import Reason
from profiles.schema import GaitParameters, Profile

ROW_BYTES = 4 * 8  # four joints, float64


class Phase(Enum):
    """Which part of an action a plan is; all but walking are WHOLE."""

    WHOLE = "whole"
    WALK_START = "walk start"  # from standing, left leg first, ends moving, left leg forward
    WALK_RIGHT = "walk right"  # one step of the periodic gait, right leg swings
    WALK_LEFT = "walk left"
    WALK_CLOSE_RIGHT = "walk close right"  # right leg swings up to the left, to standing
    WALK_CLOSE_LEFT = "walk close left"


class PlanFault(Enum):
    """Why a movement can't be planned for this patient in this device."""

    TOO_FAR_FROM_STATE = "too far from the state's pose"
    BEYOND_FLEXION = "beyond the joint's flexion"
    BEYOND_EXTENSION = "beyond the joint's extension"
    TOO_FAST = "too fast"
    TOO_MUCH_TORQUE = "too much torque"
    TOO_LITTLE_CLEARANCE = "too little clearance"
    LEFT_LEG_TOO_SHORT = "left leg too short"
    RIGHT_LEG_TOO_SHORT = "right leg too short"
    CHAIR_DOES_NOT_FIT = "chair does not fit"


class PlanRequest(Struct, frozen=True, kw_only=True, tag="plan-request"):
    """Control to planner, ordered; the pose is the measured one, (4,) radians."""

    number: int
    action: Action
    phase: Phase
    from_state: GaitState
    start_rad: Quad


class PlanCheck(Struct, frozen=True, kw_only=True):
    """The whole plan against the patient and the device."""

    reason: Reason | None = None  # why it is refused
    peak_speed_rad_s: Quad = (0.0, 0.0, 0.0, 0.0)
    peak_torque_nm: Quad = (0.0, 0.0, 0.0, 0.0)
    min_clearance_m: float = 0.0

    @property
    def ok(self) -> bool:
        """Whether the plan may run."""
        return self.reason is None


class Plan(Struct, frozen=True, kw_only=True, eq=False, tag="plan"):
    """Planner to control, ordered: samples at TICK_HZ, each (n, 4) in the order of hal's Joint.

    torque_nm is the feed-forward estimate. Raises ValueError when the tables differ in length.
    """

    number: int
    action: Action
    phase: Phase
    from_state: GaitState
    to_state: GaitState
    position_rad: Array
    velocity_rad_s: Array
    torque_nm: Array
    check: PlanCheck
    steps: int = 0
    advance_m: float = 0.0

    def __post_init__(self) -> None:
        if not self.position_rad.shape == self.velocity_rad_s.shape == self.torque_nm.shape:
            raise ValueError("a plan's tables differ in length")

    @property
    def duration_s(self) -> float:
        """From the first sample to the last."""
        return (len(self.position_rad) - 1) / TICK_HZ


def encode_array(value: object) -> bytes:
    """msgspec's enc_hook for plans: a table as its bytes."""
    assert isinstance(value, np.ndarray)
    return value.tobytes()


def decode_table(_: type, raw: bytes) -> Array:
    """msgspec's dec_hook for plans: bytes as a table (n, 4). Raises ValueError when they are no rows of four."""
    if not raw or len(raw) % ROW_BYTES:
        raise ValueError("a plan's table is not rows of four")
    return np.frombuffer(raw).reshape(-1, 4)


def quad(values: Array) -> Quad:
    """Four values as plain floats, in the order of hal's Joint."""
    return (float(values[0]), float(values[1]), float(values[2]), float(values[3]))


PLAN_RANGE_MARGIN_RAD = radians(1.0)  # the plan keeps this far inside the ranges, tracking errors take the rest
PLAN_SPEED_SHARE = 0.8  # of the device's joint speed that a plan may use
PLAN_TORQUE_SHARE = 0.9  # of the device's joint torque that the estimate may reach


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Patient:
    """A wearer in this device: what a plan is made from and checked against. Compared by identity, so that what is
    solved once for a patient can be kept."""

    identifier: str
    body: Body
    gait: GaitParameters
    device_kg: float
    low_rad: JointArray
    high_rad: JointArray
    speed_rad_s: JointArray  # what a plan may use
    torque_nm: JointArray  # what a plan's estimate may reach
    hip_max_rad: float | None = None  # the patient's own ranges, where narrower than the device's
    knee_max_rad: float | None = None


def body_of(profile: Profile) -> Body:
    """The wearer's body; measured lengths win over those estimated from stature."""
    body = average_body(profile.stature_m, profile.mass_kg, profile.gait.body_weight_support)
    return replace(body, thigh_m=profile.thigh_length_m or body.thigh_m, shank_m=profile.shank_length_m or body.shank_m)


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
