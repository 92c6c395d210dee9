"""The check of a plan again, over the recorded peaks: whether it may run, and which limit refuses it."""

from __future__ import annotations

from collections.abc import Iterator

from app.motion.plan import PLAN_SPEED_SHARE, PLAN_TORQUE_SHARE, PlanFault
from app.motion.plan_check import LEAST_CLEARANCE_M
from app.replay.difference import Difference, difference
from hal.joints.protocol import Joint
from logs.reason import Reason, key_of, reason
from logs.records import JointLimits, PlanChecked, Record

REPLAYED = {key_of(one) for one in (PlanFault.TOO_FAST, PlanFault.TOO_MUCH_TORQUE, PlanFault.TOO_LITTLE_CLEARANCE)}


def plan_differences(record: Record, body: PlanChecked, limits: JointLimits) -> Iterator[Difference]:
    """A plan that may run is within its limits; one refused for its peaks is beyond the limit that it names.

    Other refusals (angles, a path out of reach) rest on the whole path, which the trail does not hold.
    """
    beyond = [*_beyond(body, limits)]
    if body.ok and beyond:
        yield difference(record, "ok", True, beyond[0].code)
    code = body.reason.code if isinstance(body.reason, Reason) else ""
    if not body.ok and code in REPLAYED and body.reason not in beyond:
        same = (one for one in beyond if one.code == code)
        yield difference(record, "reason", body.reason, next(same, None))


def _beyond(body: PlanChecked, limits: JointLimits) -> Iterator[Reason]:
    for joint in Joint:
        speed, fastest = body.peak_speed_rad_s[joint], limits.speed_rad_s[joint]
        if speed is not None and fastest is not None and speed > PLAN_SPEED_SHARE * fastest:
            limit = PLAN_SPEED_SHARE * fastest
            yield reason(PlanFault.TOO_FAST, joint=joint, speed_rad_s=speed, limit_rad_s=limit)
        torque, strongest = body.peak_torque_nm[joint], limits.torque_nm[joint]
        if torque is not None and strongest is not None and torque > PLAN_TORQUE_SHARE * strongest:
            limit = PLAN_TORQUE_SHARE * strongest
            yield reason(PlanFault.TOO_MUCH_TORQUE, joint=joint, torque_nm=torque, limit_nm=limit)
    clearance = body.min_clearance_m
    if clearance is not None and clearance < LEAST_CLEARANCE_M:
        yield reason(PlanFault.TOO_LITTLE_CLEARANCE, clearance_m=clearance, limit_m=LEAST_CLEARANCE_M)
