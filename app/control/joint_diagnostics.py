"""What joints, drives and bus report in a tick, as the table of events compares it with its limits."""

from __future__ import annotations

from collections.abc import Iterable
from math import isnan, nan
from operator import ge, gt
from typing import TYPE_CHECKING

import numpy as np
from msgspec import Struct

from app.control.inputs import Inputs, Settings, answers_ns
from app.control.silence import angles_sunk_rad, silent_joints
from app.ipc.streams import NS_PER_MS
from app.motion.follower import Mode, Motion
from hal.errors import HardwareError
from hal.joints.guard import RANGE_MARGIN_RAD, SPEED_MARGIN, TORQUE_MARGIN, Refusal
from hal.joints.protocol import BusFault, DriveFault, Joint, JointFeedback
from logs.reason import Reason

if TYPE_CHECKING:  # the state holds events, whose rows read the diagnostics
    from app.control.state import ControlState

FOLLOWING_WARN_RAD = 0.14  # 8°, four times the tracking that the plans are checked for
SETTLED_NS = 500 * NS_PER_MS  # after a movement the joints settle; later motion while held is unexpected


class JointDiagnostics(Struct, frozen=True, kw_only=True):
    """What joints, drives and bus report; errors are 0 where nothing is held that could err."""

    answering: bool = True  # every joint has answered at least once
    age_ms: float = 0.0  # of the oldest answer; without power, of drives that are asked then
    drives_lost: bool = False
    neutral: bool = False  # with power or without, no joint is stiff or damped
    drive_faults: DriveFault = DriveFault.NONE
    drive_detail: HardwareError | None = None
    silent_joint: Joint | None = None
    silent: frozenset[Joint] = frozenset()  # without an answer for a while, whoever is to blame
    sunk_rad: float = 0.0  # the most of a joint that answers again, since its last answer before
    sunk: frozenset[Joint] = frozenset()  # those that have sunk too far meanwhile
    drive_error: Reason | None = None
    bus: BusFault = BusFault.NONE
    hottest_c: float = nan
    warm: bool = False
    hot: bool = False
    following_rad: float = 0.0
    pose_error_rad: float = 0.0
    drift_rad_s: float = 0.0
    fastest_rad_s: float = 0.0  # of the joints that answer
    beyond_range: bool = False
    beyond_speed: bool = False
    beyond_torque: bool = False
    guard_refusal: Refusal | None = None
    feedback: JointFeedback | None = None  # what the figures above are of
    settings: Settings | None = None


def joint_diagnostics(inputs: Inputs, state: ControlState, settings: Settings) -> JointDiagnostics:
    """As of this tick's feedback."""
    now_ns, feedback = inputs.now_ns, inputs.feedback
    motion, streams = state.motion, state.streams
    measured_ns, temperatures_c = feedback.measured_ns.tolist(), feedback.temperature_c.tolist()
    oldest_ns = min(answers_ns(feedback, streams.powered), default=now_ns)
    silent = silent_joints(streams, feedback, now_ns)
    sunk_rad = angles_sunk_rad(state.silenced, motion, feedback, silent)
    fastest_rad_s = _fastest_rad_s(feedback, silent if streams.powered else feedback.unasked)
    return JointDiagnostics(
        answering=min(measured_ns) > 0,
        age_ms=(now_ns - streams.own_delay_ns - oldest_ns) / NS_PER_MS,
        drives_lost=motion.mode is not Mode.DISABLED and not streams.powered,
        neutral=motion.mode is Mode.DISABLED,
        drive_faults=_union(feedback.faults),
        drive_detail=feedback.detail,
        silent_joint=_silent_joint(measured_ns, oldest_ns),
        silent=silent,
        sunk_rad=max(sunk_rad.values(), default=0.0),
        sunk=frozenset(joint for joint, angle_rad in sunk_rad.items() if angle_rad > FOLLOWING_WARN_RAD),
        drive_error=inputs.drive_error,
        bus=feedback.bus,
        hottest_c=max([value for value in temperatures_c if not isnan(value)], default=nan),
        following_rad=_following_rad(motion, feedback),
        pose_error_rad=_pose_error_rad(state, feedback, settings),
        drift_rad_s=fastest_rad_s if _is_settled(state, now_ns) else 0.0,
        fastest_rad_s=fastest_rad_s,
        guard_refusal=inputs.guard_refusal,
        feedback=feedback,
        settings=settings,
        **exceeded(feedback, settings),
    )


def exceeded(feedback: JointFeedback, settings: Settings) -> dict[str, bool]:
    """Which limits any joint exceeds: fields of `JointDiagnostics`. A temperature not measured (NaN) is above none."""
    limits, temperatures_c = settings.limits, feedback.temperature_c.tolist()
    speeds, torques = map(abs, feedback.velocity_rad_s.tolist()), map(abs, feedback.torque_nm.tolist())
    return {
        "warm": any(map(ge, temperatures_c, settings.warn_c.tolist())),
        "hot": any(map(ge, temperatures_c, settings.limit_c.tolist())),
        "beyond_range": _beyond_range(feedback.position_rad.tolist(), settings),
        "beyond_speed": any(map(gt, speeds, [SPEED_MARGIN * limit for limit in limits.speed_rad_s.tolist()])),
        "beyond_torque": any(map(gt, torques, [TORQUE_MARGIN * limit for limit in limits.torque_nm.tolist()])),
    }


def _silent_joint(measured_ns: list[int], oldest_ns: int) -> Joint | None:
    """The joint without an answer for the longest time; None when all answer."""
    if max(measured_ns) - oldest_ns < 10 * NS_PER_MS:
        return None
    return Joint(measured_ns.index(oldest_ns))


def _union(faults: Iterable[DriveFault]) -> DriveFault:
    union = DriveFault.NONE
    for fault in faults:
        if fault is not DriveFault.NONE:
            union |= fault
    return union


def _beyond_range(values: list[float], settings: Settings) -> bool:
    low, high = settings.limits.low_rad.tolist(), settings.limits.high_rad.tolist()
    return any(
        not least - RANGE_MARGIN_RAD <= value <= most + RANGE_MARGIN_RAD
        for value, least, most in zip(values, low, high, strict=True)
    )


def _following_rad(motion: Motion, feedback: JointFeedback) -> float:
    """The largest distance of a stiff joint from its target."""
    if motion.mode not in {Mode.HOLDING, Mode.MOVING}:
        return 0.0
    return float(np.abs(motion.command.position_rad - feedback.position_rad).max())


def _pose_error_rad(state: ControlState, feedback: JointFeedback, settings: Settings) -> float:
    """The largest distance of a resting, stiff joint from its state's pose."""
    pose = settings.poses.get(state.gait.state)
    if pose is None or state.gait.running is not None or state.motion.mode is not Mode.HOLDING:
        return 0.0
    return float(np.abs(pose - feedback.position_rad).max())


def _fastest_rad_s(feedback: JointFeedback, stale: frozenset[Joint]) -> float:
    """The largest speed of a joint; stale: those whose last answer, for ever the same, tells nothing of now."""
    speeds_rad_s = zip(Joint, map(abs, feedback.velocity_rad_s.tolist()), strict=True)
    return max((speed for joint, speed in speeds_rad_s if joint not in stale), default=0.0)


def _is_settled(state: ControlState, now_ns: int) -> bool:
    """Whether the joints have been held for a while."""
    still_ns = now_ns - state.still_since_ns
    held = state.streams.powered and state.motion.mode is Mode.HOLDING
    return held and state.still_since_ns > 0 and still_ns >= SETTLED_NS
