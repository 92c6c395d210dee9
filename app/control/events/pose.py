"""Rows of the table of events: where the legs are, measured against where they should be."""

from __future__ import annotations

from app.control.events.drives import worst_range
from app.control.events.row import Above, Latch, Row
from app.ipc.states import Effect, Event

POSE_LIMIT_RAD = 0.21  # 12°
STILL_RAD_S = 0.5

_FASTEST = Above("speed_rad_s", lambda d: d.joints.fastest_rad_s, STILL_RAD_S)

E, F = Event, Effect
POSE = (
    Row(
        E.NOT_HOMED,
        F.REFUSE,
        lambda d: not d.powered and d.joints.answering and d.joints.beyond_range,
        compares=worst_range,
    ),
    # A swinging leg is slow for a moment at each turning point: the event settles.
    Row(
        E.LEGS_MOVING,
        F.REFUSE,
        lambda d: not d.powered and _FASTEST(d),
        compares=_FASTEST.compared,
        settles=True,
    ),
    Row(
        E.FAR_FROM_POSE,
        F.REFUSE,
        Above("pose_error_rad", lambda d: d.joints.pose_error_rad, POSE_LIMIT_RAD),
        Latch.POWERED,
        lambda d: {"angle_rad": d.joints.pose_error_rad},
        displaces=True,
    ),
)
