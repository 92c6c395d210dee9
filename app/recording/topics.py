"""From what control, perception and the trail say to the messages of a recording."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from enum import Enum
from math import isfinite

import numpy as np
from msgspec import UNSET, Struct

from app.ipc.messages import OperatorCommand
from app.ipc.recording import QUANTITIES, HandFrame, TickBatch
from app.recording import schemas
from app.recording.schemas import Four, Gains, JointState, JointStates, Time, time_of
from hal.joints.device import JOINT_NAMES, Joint
from logs.records import Record

Message = tuple[str, int, Struct]  # topic, monotonic time, message

_LEVELS = {"event-raised": 3, "refusal": 3, "stop": 3, "records-lost": 4, "guard-refusal": 4}  # of foxglove.Log
_INFO = 2


class TickMessages:
    """Turns batches of ticks into messages; remembers the gains, which are written when they change."""

    def __init__(self, clock_offset_ns: int) -> None:
        self._offset_ns = clock_offset_ns
        self._gains: list[list[float]] | None = None
        self._first_tick = -1  # of the newest batch
        self._counted: dict[str, int] = {}  # the losses that its control had counted
        self.lost: Counter[str] = Counter()  # messages by topic, before they came here

    def of(self, batch: TickBatch) -> Iterator[Message]:
        """Every message of a batch."""
        times_ns = np.frombuffer(batch.at_ns, dtype=np.int64).tolist()
        ticks = np.frombuffer(batch.values, dtype=np.float64).reshape(-1, len(QUANTITIES), len(Joint)).tolist()
        self._count_lost(batch)
        for at_ns, values in zip(times_ns, ticks, strict=True):
            when = time_of(at_ns + self._offset_ns)
            yield schemas.JOINT_STATE, at_ns, _states(when, *values[:3])
            yield schemas.JOINT_SETPOINT, at_ns, _states(when, *values[3:6])
            if values[6:] != self._gains:
                self._gains = values[6:]
                gains = Gains(stiffness_nm_rad=_four(values[6]), damping_nm_s_rad=_four(values[7]))
                yield schemas.JOINT_GAINS, at_ns, gains
        for one in batch.contacts:
            yield schemas.CONTACT, one.at_ns, schemas.FootContact(left_n=one.left_n, right_n=one.right_n)
        for command in batch.commands:
            yield schemas.OPERATOR, command.sent_ns, _operator(command)
        yield from _snapshot(batch)

    def _count_lost(self, batch: TickBatch) -> None:
        """A control that was restarted numbers its ticks and counts its losses from 0 again."""
        self.lost.update(batch.lost)
        if batch.first_tick > self._first_tick:
            self.lost.subtract(self._counted)
        self._first_tick, self._counted = batch.first_tick, batch.lost


def _snapshot(batch: TickBatch) -> Iterator[Message]:
    now, ages = batch.snapshot, batch.ages
    health = schemas.DriveHealth(
        temperature_c=_four([joint.temperature_c for joint in now.joints]),
        age_ms=_four([joint.age_ms for joint in now.joints]),
        faults=tuple(
            f"{name}: {fault.code}"
            for name, joint in zip(JOINT_NAMES, now.joints, strict=True)
            for fault in joint.faults
        ),
    )
    yield schemas.JOINT_HEALTH, now.at_ns, health
    gait = schemas.Gait(
        state=now.state.value,
        action=_value(now.action),
        progress=now.progress,
        effect=now.effect.name.lower(),
        armed=now.armed,
        powered=now.enabled,
        steps=now.steps,
        distance_walked_m=now.distance_walked_m,
        events=tuple(one.event.value for one in now.events),
        refusal=now.refusal,
        refusal_count=now.refusal_count,
        allowed=tuple(action.value for action in now.allowed),
        pending=_value(now.pending),
        why_not=now.why_not,
    )
    yield schemas.GAIT, now.at_ns, gait
    links = schemas.LinkHealth(
        report_age_ms=ages.report_ms,
        console_age_ms=ages.console_ms,
        audit_age_ms=ages.audit_ms,
        guardian_age_ms=ages.guardian_ms,
        audit_waiting=ages.audit_waiting,
        missed_ticks=now.lateness.missed,
        late_p99_ms=now.lateness.p99_ms,
        late_max_ms=now.lateness.max_ms,
    )
    yield schemas.LINKS, now.at_ns, links


def of_hand(frame: HandFrame) -> Iterator[Message]:
    """Keypoints, verdict and button of one frame; of a report without a capture by when it was sent."""
    report = frame.report
    number, at_ns = report.sequence, report.captured_ns or report.sent_ns
    keypoints = schemas.Keypoints(
        frame=number,
        image_px=tuple((x, y) for x, y in np.frombuffer(frame.image_px).reshape(-1, 2).tolist()),
        world_m=tuple((x, y, z) for x, y, z in np.frombuffer(frame.world_m).reshape(-1, 3).tolist()),
    )
    yield schemas.KEYPOINTS, at_ns, keypoints
    verdict = schemas.Verdict(
        frame=number,
        hand=report.hand,
        gesture=_value(report.gesture),
        raw_gesture=_value(report.raw_gesture),
        confidence=report.confidence,
        votes=report.votes,
        explanation=report.explanation,
        refusal=report.hand_refusal,
    )
    yield schemas.VERDICT, at_ns, verdict
    button = schemas.Button(
        frame=number,
        distance_m=report.distance_m,
        sd_m=report.distance_sd_m,
        safe_distance_m=report.safe_distance_m,
        depth_distance_m=report.depth_distance_m,
        threshold_m=report.threshold_m,
        pressed=report.pressed,
        release_count=report.release_count,
        released_gesture=_value(report.released_gesture),
        cancel_count=report.cancel_count,
        fps=report.fps,
    )
    yield schemas.BUTTON, at_ns, button


def log_of(record: Record, line: bytes, clock_offset_ns: int) -> schemas.Log:
    """A record of the trail as a line of a log: its kind, and the line itself."""
    kind = str(type(record.body).__struct_config__.tag)
    return schemas.Log(
        timestamp=time_of(record.monotonic_ns + clock_offset_ns),
        level=_LEVELS.get(kind, _INFO),
        message=f"{kind} {line.decode().strip()}",
        name=record.process,
        line=record.sequence,
    )


def _operator(command: OperatorCommand) -> schemas.Operator:
    return schemas.Operator(
        command=command.kind.value,
        operator=command.operator,
        sequence=command.sequence,
        lease=command.lease,
        action=_value(command.action),
    )


def _states(when: Time, positions: list[float], speeds: list[float], efforts: list[float]) -> JointStates:
    joints = zip(JOINT_NAMES, positions, speeds, efforts, strict=True)
    return JointStates(when, tuple(JointState(name, _known(q), _known(v), _known(t)) for name, q, v, t in joints))


def _known(value: float) -> float:
    return value if isfinite(value) else UNSET  # type: ignore[return-value]  # left out of the message


def _four(values: list[float]) -> Four:
    one, two, three, four = (value if isfinite(value) else None for value in values)
    return one, two, three, four


def _value(member: Enum | None) -> str | None:
    return None if member is None else str(member.value)
