"""Rows of the table of events: where the legs are, measured against where they should be."""

from __future__ import annotations

from app.control.events.row import Latch, Row
from app.ipc.states import Effect, Event

POSE_LIMIT_RAD = 0.21  # 12°
STILL_RAD_S = 0.5

E, F = Event, Effect
POSE = (
    Row(E.NOT_HOMED, F.REFUSE, lambda d: not d.powered and d.joints.answering and d.joints.beyond_range),
    # A swinging leg is slow for a moment at each turning point: the event settles.
    Row(E.LEGS_MOVING, F.REFUSE, lambda d: not d.powered and d.joints.fastest_rad_s > STILL_RAD_S, settles=True),
    Row(
        E.FAR_FROM_POSE,
        F.REFUSE,
        lambda d: d.joints.pose_error_rad > POSE_LIMIT_RAD,
        Latch.POWERED,
        lambda d: {"angle_rad": d.joints.pose_error_rad},
        displaces=True,
    ),
)
