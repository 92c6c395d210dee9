"""Messages as a session's processes publish them, made up for tests."""

from __future__ import annotations

from app.ipc.messages import Preview, TriggerReport
from app.ipc.snapshot import ActiveEvent, ControlSnapshot, JointSnapshot
from app.ipc.states import Action, Effect, Event, GaitState
from logs.reason import Value

ALLOWED_STANDING = (
    Action.STEP_RIGHT_FIRST,
    Action.WALK,
    Action.STAIR_UP,
    Action.STAIR_DOWN,
    Action.OBSTACLE,
    Action.SIT_DOWN,
)
JOINT = JointSnapshot(angle_rad=0.1, target_rad=0.12, speed_rad_s=0.0, torque_nm=3.2, temperature_c=31.0, age_ms=2.0)

STANDING = ControlSnapshot(
    incarnation=1,
    sequence=1,
    at_ns=0,
    state=GaitState.STANDING,
    effect=Effect.NOTE,
    armed=True,
    patient_confirmed=True,
    enabled=True,
    allowed=ALLOWED_STANDING,
    joints=(JOINT, JOINT, JOINT, JOINT),
)


def flat(width_px: int = 96, height_px: int = 54) -> Preview:
    """A picture of one colour."""
    rgb = bytes((40, 80, 120)) * (width_px * height_px)
    return Preview(sequence=1, captured_ns=0, width_px=width_px, height_px=height_px, rgb=rgb)


def gradient(width_px: int = 96, height_px: int = 54) -> Preview:
    """A picture whose colours tell where each pixel came from."""
    rows = [bytes((x * 255 // width_px, y * 255 // height_px, 96)) for y in range(height_px) for x in range(width_px)]
    return Preview(sequence=1, captured_ns=0, width_px=width_px, height_px=height_px, rgb=b"".join(rows))


def without_hand(captured_ns: int, sequence: int, threshold_m: float) -> TriggerReport:
    """Perception's report of a frame, without what its pipeline found."""
    return TriggerReport(
        incarnation=1,
        sequence=sequence,
        captured_ns=captured_ns,
        sent_ns=captured_ns,
        hand=False,
        gesture=None,
        camera="c",
        threshold_m=threshold_m,
        fps=30.0,
    )


def event(event: Event, effect: Effect, since_ns: int = 0, **detail: Value) -> ActiveEvent:
    """An unacknowledged event, present now."""
    return ActiveEvent(
        event=event,
        effect=effect,
        detail=detail,
        since_ns=since_ns,
        number=since_ns,
        present=True,
        acknowledged=False,
    )
