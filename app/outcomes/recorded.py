"""The legs' history as a recording holds it."""

from __future__ import annotations

from array import array
from dataclasses import dataclass
from math import nan
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from app.ipc.states import LEVEL_WALKING
from app.motion.kinematics import Array, Mask
from app.outcomes.measures import LegHistory
from app.recording import schemas
from app.recording.read import Recording, messages
from hal.joints.body import Body
from hal.joints.device import Joint
from hal.joints.protocol import TICK_NS

WALKING_ACTIONS = frozenset(action.value for action in LEVEL_WALKING)  # as they are recorded
_decode_joints = msgspec.json.Decoder(schemas.JointStates).decode
_decode_gait = msgspec.json.Decoder(schemas.Gait).decode


@dataclass(slots=True, kw_only=True)
class RecordedLegs:
    """What a recording holds of the legs; the message's own times."""

    recording: Recording
    at_ns: NDArray[np.int64]  # (n,)
    joints_rad: Array  # (n, 4)
    gait_ns: NDArray[np.int64]  # (m,)
    powered: Mask  # (m,)
    walking: Mask  # (m,)
    trail_lines: list[bytes]


def read_legs(path: Path) -> RecordedLegs:
    """Everything that measures are made of, up to where a file is cut. Raises AppError."""
    recording = Recording(path=path)
    at_ns, joints = array("q"), array("d")  # an hour is 1.8 million samples
    gait: list[tuple[int, bool, bool]] = []
    lines: list[bytes] = []
    for one in messages(recording, schemas.JOINT_STATE, schemas.GAIT, schemas.TRAIL):
        if one.topic == schemas.TRAIL:
            lines.append(one.data)
        elif one.topic == schemas.GAIT:
            now = _decode_gait(one.data)
            gait.append((one.at_ns, now.powered, now.action in WALKING_ACTIONS))
        else:
            angles = [joint.position for joint in _decode_joints(one.data).joints]
            at_ns.append(one.at_ns)
            joints.extend(nan if angle is msgspec.UNSET else angle for angle in angles)
    order = np.argsort(np.array(at_ns, dtype=np.int64), kind="stable")
    return RecordedLegs(
        recording=recording,
        at_ns=np.array(at_ns, dtype=np.int64)[order],
        joints_rad=np.array(joints, dtype=np.float64).reshape(-1, len(Joint))[order],
        gait_ns=np.array([at_ns for at_ns, _, _ in gait], dtype=np.int64),
        powered=np.array([powered for _, powered, _ in gait], dtype=bool),
        walking=np.array([walking for _, _, walking in gait], dtype=bool),
        trail_lines=lines,
    )


def history_of(legs: RecordedLegs, body: Body) -> LegHistory | None:
    """On a grid of control's rate, where a late or lost tick holds the one before; None without a sample."""
    measured = np.isfinite(legs.joints_rad).all(axis=1)
    at_ns, joints_rad = legs.at_ns[measured], legs.joints_rad[measured]
    if not len(at_ns) or not len(legs.gait_ns):
        return None
    ticks = round((int(at_ns[-1]) - int(at_ns[0])) / TICK_NS) + 1
    grid_ns = at_ns[0] + np.arange(ticks, dtype=np.int64) * TICK_NS
    newest = np.searchsorted(at_ns, grid_ns + TICK_NS // 2, side="right") - 1
    gait = np.clip(np.searchsorted(legs.gait_ns, grid_ns, side="right") - 1, 0, None)
    return LegHistory(
        body=body,
        joints_rad=joints_rad[newest],
        powered=legs.powered[gait],
        walking=legs.walking[gait],
    )
