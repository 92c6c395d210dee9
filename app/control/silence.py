"""Joints without an answer for a while, and what has become of them when they answer again.

A drive may go limp without commands; a joint that sank meanwhile must not be pulled back.
"""

from __future__ import annotations

from msgspec import Struct
from msgspec.structs import replace

from app.control.inputs import StreamState
from app.ipc.streams import NS_PER_MS
from app.motion.follower import Mode, Motion
from hal.joints.device import Joint
from hal.joints.protocol import TICK_NS, JointFeedback

JOINT_TIMEOUT_MS = 15.0  # with a tick and its margin the effect comes within 20 ms
ANSWERING_NS = 100_000_000  # who answers for so long is silent no more: the gaps of a loose connector add up


class LastAnswer(Struct, frozen=True, kw_only=True):
    """Where a joint was when it answered last, and where its target was from there."""

    position_rad: float
    offset_rad: float
    returned_ns: int = 0  # when it answered again; 0: it does not


Silences = dict[Joint, LastAnswer]


def silent_joints(streams: StreamState, feedback: JointFeedback, now_ns: int) -> frozenset[Joint]:
    """Those whose last answer is old, even if control stood still or the host slept: joints sink in that time, too.

    Without power they are asked less often, and nothing holds them.
    """
    if not streams.powered:
        return frozenset()
    # The monotonic clock stood still in a sleep, and answers of before may have waited in the socket.
    due_ns = max(now_ns - JOINT_TIMEOUT_MS * NS_PER_MS, streams.woken_ns + TICK_NS)
    return frozenset(joint for joint, at_ns in zip(Joint, feedback.measured_ns.tolist(), strict=True) if at_ns < due_ns)


def update_silences(
    before: Silences, motion: Motion, feedback: JointFeedback, silent: frozenset[Joint], now_ns: int
) -> Silences:
    """The last answers of joints that are silent, or have been so in the last ANSWERING_NS."""
    after: Silences = {}
    for joint in {*before, *silent}:
        known = before.get(joint)
        if joint in silent:
            after[joint] = replace(known, returned_ns=0) if known else _last_answer(motion, feedback, joint)
        elif known is not None and (known.returned_ns == 0 or now_ns - known.returned_ns < ANSWERING_NS):
            after[joint] = replace(known, returned_ns=known.returned_ns or now_ns)
    return after


def angles_sunk_rad(
    silences: Silences, motion: Motion, feedback: JointFeedback, silent: frozenset[Joint]
) -> dict[Joint, float]:
    """How far joints that just answer again have both moved, and come away from their targets, in their silence.

    One that leaned against its target before, or stopped short of a target that went on, has not sunk.
    """
    if motion.mode is Mode.DISABLED or motion.fully_damped:
        return {}
    returned = [joint for joint, before in silences.items() if joint not in silent and before.returned_ns == 0]
    return {joint: _sunk_rad(silences[joint], _last_answer(motion, feedback, joint)) for joint in returned}


def _last_answer(motion: Motion, feedback: JointFeedback, joint: Joint) -> LastAnswer:
    position_rad = float(feedback.position_rad[joint])
    return LastAnswer(position_rad=position_rad, offset_rad=float(motion.command.position_rad[joint]) - position_rad)


def _sunk_rad(before: LastAnswer, now: LastAnswer) -> float:
    same_side = now.offset_rad * before.offset_rad > 0
    away_rad = abs(now.offset_rad) - (abs(before.offset_rad) if same_side else 0.0)
    return min(away_rad, abs(now.position_rad - before.position_rad))
