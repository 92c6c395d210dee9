"""The state of everything at one moment of a recording, as the therapist's screen had it.

The newest message of each topic, and over it what the trail says happened since: the gait topic has a message each
50 ms, an accepted command its own moment.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from functools import lru_cache
from math import nan
from typing import TypeVar

import msgspec
import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from app.ipc.messages import TriggerReport
from app.ipc.snapshot import ActiveEvent, ControlSnapshot, JointSnapshot
from app.ipc.states import Action, Effect, Event, GaitState
from app.playback.session import Playback, moment_ns
from app.recording import schemas
from app.recording.index import JointSamples
from app.recording.read import Sample
from hal.joints.protocol import Joint
from kgdfa.gesture import Gesture
from logs import records as r
from logs.reason import Reason, reason
from logs.records import Record

E = TypeVar("E", bound=Enum)
Points = NDArray[np.float64]

WITHIN_NS = 2_000_000_000  # an older message of a topic is not the state any more
POSE_WITHIN_NS = 200_000_000
PICTURE_WITHIN_NS = 500_000_000
_GAIT = msgspec.json.Decoder(schemas.Gait).decode
_HEALTH = msgspec.json.Decoder(schemas.DriveHealth).decode
_VERDICT = msgspec.json.Decoder(schemas.Verdict).decode
_BUTTON = msgspec.json.Decoder(schemas.Button).decode
_IMAGE = msgspec.json.Decoder(schemas.CompressedImage).decode
_KEYPOINTS = msgspec.json.Decoder(schemas.Keypoints).decode


class RecordedFault(Enum):
    """A drive's fault as the recording has it: its code."""

    OF_DRIVE = "of-drive"  # fault


@dataclass(frozen=True, slots=True, kw_only=True)
class Moment:
    """at_ns: monotonic. hand_m: (21, 3), about its centre, MediaPipe's axes; None: no hand, or none recorded.

    picture_jpeg: the camera's image, with the patient's consent; else empty. hand_share: (21, 2), the keypoints on it,
    in shares of its width.
    """

    at_ns: int
    snapshot: ControlSnapshot | None
    report: TriggerReport | None
    hand_m: Points | None = None
    picture_jpeg: bytes = b""
    hand_share: Points | None = None


def moment(playback: Playback, at_ns: int) -> Moment:
    """Everything at this moment."""
    report = _newest_report(playback, at_ns)
    picture = None if playback.pictures is None else playback.pictures.newest(schemas.IMAGE, at_ns, PICTURE_WITHIN_NS)
    return Moment(
        at_ns=at_ns,
        snapshot=snapshot_at(playback, at_ns),
        report=report,
        hand_m=_hand(playback, report),
        picture_jpeg=b"" if picture is None else _IMAGE(picture.data).data,
        hand_share=None if picture is None else _hand_on(playback, picture.at_ns),
    )


def reports_between(playback: Playback, after_ns: int, until_ns: int) -> list[TriggerReport]:
    """What perception reported of each frame after a moment up to another."""
    verdicts = {one.at_ns: one for one in playback.index.between(schemas.VERDICT, after_ns, until_ns)}
    buttons = playback.index.between(schemas.BUTTON, after_ns, until_ns)
    return [_report(verdicts[one.at_ns], one) for one in buttons if one.at_ns in verdicts]


def snapshot_at(playback: Playback, at_ns: int) -> ControlSnapshot | None:
    """Control's state; None: nothing of it was recorded yet."""
    found = playback.index.newest(schemas.GAIT, at_ns, WITHIN_NS)
    if found is None:
        return None
    gait = _GAIT(found.data)
    state, effect = _member(GaitState, gait.state), _named(Effect, gait.effect)
    if state is None or effect is None:
        return None
    snapshot = ControlSnapshot(
        incarnation=1,
        sequence=found.at_ns,
        at_ns=found.at_ns,
        state=state,
        effect=effect,
        armed=gait.armed,
        patient_confirmed=True,
        enabled=gait.powered,
        action=_member(Action, gait.action),
        progress=gait.progress,
        pending=_member(Action, gait.pending),
        allowed=tuple(action for one in gait.allowed if (action := _member(Action, one))),
        why_not=gait.why_not,
        joints=_joints(playback, at_ns),
        events=_events(playback, gait.events, at_ns),
        refusal=gait.refusal,
        refusal_count=gait.refusal_count,
        steps=gait.steps,
        distance_walked_m=gait.distance_walked_m,
    )
    for one in playback.changes.between(found.at_ns, at_ns):
        snapshot = _after(snapshot, one)
    return snapshot


def joints_over(playback: Playback, after_ns: int, until_ns: int) -> tuple[JointSamples, JointSamples]:
    """Measured and commanded joints over some time; where a joint is held nowhere, as control's snapshot shows it."""
    measured = playback.index.joints(schemas.JOINT_STATE, after_ns, until_ns)
    commanded = playback.index.joints(schemas.JOINT_SETPOINT, after_ns, until_ns)
    _, of_measured, of_commanded = np.intersect1d(measured.at_ns, commanded.at_ns, return_indices=True)
    values = commanded.values.copy()
    target_rad = values[of_commanded, 0]
    values[of_commanded, 0] = np.where(np.isfinite(target_rad), target_rad, measured.values[of_measured, 0])
    return measured, JointSamples(at_ns=commanded.at_ns, values=values)


def _after(snapshot: ControlSnapshot, record: Record) -> ControlSnapshot:
    """The snapshot after one more change."""
    body = record.body
    if isinstance(body, r.Command):
        action = _member(Action, body.action)
        if snapshot.action is not None:  # the end of a walk, which the running step still completes
            return replace(snapshot, pending=action)
        return replace(snapshot, action=action, progress=0.0, allowed=())
    if isinstance(body, r.Refusal):
        return replace(snapshot, refusal=body.reason) if isinstance(body.reason, Reason) else snapshot
    if isinstance(body, r.EffectChanged):
        return replace(snapshot, effect=_named(Effect, body.to_effect) or snapshot.effect)
    if isinstance(body, r.GaitChanged):
        running = _member(Action, body.running)
        progress = snapshot.progress if running is snapshot.action else 0.0
        return replace(
            snapshot, state=_member(GaitState, body.state) or snapshot.state, action=running, progress=progress
        )
    return snapshot


def _joints(playback: Playback, at_ns: int) -> tuple[JointSnapshot, JointSnapshot, JointSnapshot, JointSnapshot]:
    measured, commanded = joints_over(playback, at_ns - POSE_WITHIN_NS, at_ns)
    now = measured.values[-1] if len(measured.at_ns) else np.full((3, 4), nan)
    target = commanded.values[-1] if len(commanded.at_ns) else np.full((3, 4), nan)
    found = playback.index.newest(schemas.JOINT_HEALTH, at_ns, WITHIN_NS)
    health = _HEALTH(found.data) if found is not None else None
    first, second, third, fourth = (_joint(joint, now, target, health) for joint in Joint)
    return first, second, third, fourth


def _joint(joint: Joint, now: Points, target: Points, health: schemas.DriveHealth | None) -> JointSnapshot:
    temperature_c = health.temperature_c[joint] if health is not None else None
    age_ms = health.age_ms[joint] if health is not None else None
    mine = f"{joint.name.lower()}: "
    faults = [one.removeprefix(mine) for one in health.faults if one.startswith(mine)] if health is not None else []
    return JointSnapshot(
        angle_rad=float(now[0, joint]),
        speed_rad_s=float(now[1, joint]),
        torque_nm=float(now[2, joint]),
        target_rad=float(target[0, joint]),
        temperature_c=nan if temperature_c is None else temperature_c,
        age_ms=0.0 if age_ms is None else age_ms,
        faults=tuple(reason(RecordedFault.OF_DRIVE, fault=one) for one in faults),
    )


def _events(playback: Playback, names: tuple[str, ...], at_ns: int) -> tuple[ActiveEvent, ...]:
    """Those that the gait topic names, each with what the trail says of it."""
    found = []
    for name in names:
        event, raised = _member(Event, name), playback.raised(name, at_ns)
        if event is None or raised is None or not isinstance(raised.body, r.EventRaised):
            continue
        text = raised.body.text
        found.append(
            ActiveEvent(
                event=event,
                detail=text.values if isinstance(text, Reason) else {},
                effect=_named(Effect, raised.body.effect) or Effect.NOTE,
                since_ns=moment_ns(raised),
                number=moment_ns(raised),
                present=not playback.is_over(name, raised, at_ns),
                acknowledged=False,
            )
        )
    return tuple(found)


def _newest_report(playback: Playback, at_ns: int) -> TriggerReport | None:
    button = playback.index.newest(schemas.BUTTON, at_ns, WITHIN_NS)
    if button is None:
        return None
    verdict = playback.index.newest(schemas.VERDICT, button.at_ns, 1)
    return _report(verdict, button) if verdict is not None else None


@lru_cache(maxsize=1024)  # a film asks for the same seconds again with every frame
def _report(verdict: Sample, button: Sample) -> TriggerReport:
    """One frame's; sent when it was captured, since the recording keeps the capture only."""
    hand, pushed = _VERDICT(verdict.data), _BUTTON(button.data)
    return TriggerReport(
        incarnation=1,
        sequence=pushed.frame,
        captured_ns=button.at_ns,
        sent_ns=button.at_ns,
        hand=hand.hand,
        gesture=_member(Gesture, hand.gesture),
        raw_gesture=_member(Gesture, hand.raw_gesture),
        confidence=hand.confidence,
        explanation=hand.explanation,
        hand_refusal=hand.refusal,
        votes=hand.votes,
        distance_m=pushed.distance_m,
        distance_sd_m=pushed.sd_m,
        safe_distance_m=pushed.safe_distance_m,
        threshold_m=pushed.threshold_m,
        pressed=pushed.pressed,
        release_count=pushed.release_count,
        released_gesture=_member(Gesture, pushed.released_gesture),
        cancel_count=pushed.cancel_count,
        fps=pushed.fps,
        depth_distance_m=pushed.depth_distance_m,
    )


def _hand(playback: Playback, report: TriggerReport | None) -> Points | None:
    if report is None or not report.hand:
        return None
    found = playback.index.newest(schemas.KEYPOINTS, report.captured_ns, 1)
    points = np.array(_KEYPOINTS(found.data).world_m) if found is not None else np.zeros(0)
    return points if points.shape == (21, 3) else None


def _hand_on(playback: Playback, captured_ns: int) -> Points | None:
    """The keypoints of the very frame that a picture is of."""
    found, width_px = playback.index.newest(schemas.KEYPOINTS, captured_ns, 1), playback.camera_width_px(captured_ns)
    if found is None or not width_px:
        return None
    points = np.array(_KEYPOINTS(found.data).image_px)
    return points / width_px if points.shape == (21, 2) else None


def _member(kind: type[E], value: str | None) -> E | None:
    """By its value; None for none, and for one that this version does not have."""
    return next((one for one in kind if one.value == value), None)


def _named(kind: type[E], name: str) -> E | None:
    return kind.__members__.get(name.upper())
