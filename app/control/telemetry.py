"""What control publishes of itself: the snapshot, how late ticks begin, and the joints' statistics."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isfinite, isnan, nan

import numpy as np
from msgspec import Struct
from msgspec.structs import asdict
from numpy.typing import NDArray

from app.control.events.table import ROW, RaisedEvent, blocker
from app.control.gait import machine as gait_machine
from app.control.inputs import Inputs
from app.control.requests import uncleared
from app.control.state import ControlState
from app.ipc.snapshot import ActiveEvent, ControlSnapshot, JointSnapshot, Lateness, RealTime, StopInputSnapshot
from app.ipc.states import Action, RequestRefusal, Source
from app.ipc.streams import NS_PER_MS
from app.motion.follower import Mode
from hal.joints.protocol import Joint, JointArray, JointCommand, JointFeedback
from logs.reason import Quad, Reason, reason
from logs.records import JointStatistics


class LoopStatus(Struct, frozen=True, kw_only=True):
    """What only the loop knows: fields of the snapshot."""

    incarnation: int
    sequence: int
    by_key_only: tuple[Action, ...] = ()
    lateness: Lateness
    real_time: RealTime


def snapshot(state: ControlState, inputs: Inputs, status: LoopStatus) -> ControlSnapshot:
    """Everything that a screen shows of control."""
    gait, running, report = state.gait, state.running, state.streams.report
    allowed, why_not = _allowed(state)
    open_reports = tuple(one for one in (running.report, running.ending) if one is not None) if running else ()
    return ControlSnapshot(
        at_ns=inputs.now_ns,
        state=gait.state,
        effect=state.effect,
        armed=state.armed_ns > 0,
        patient_confirmed=state.patient_confirmed,
        enabled=state.streams.powered,
        damped=state.motion.mode is Mode.DAMPED,
        action=gait.running,
        progress=state.motion.progress,
        pending=Action.WALK_END if gait.closing else None,
        allowed=allowed,
        uncleared=uncleared(inputs.cleared),
        why_not=why_not,
        joints=_joints(state, inputs),
        events=tuple(_event(one) for one in state.events),
        stop_inputs=tuple(
            StopInputSnapshot(name=one.name, role=one.role, open=one.open, pressed_once=one.pressed_once)
            for one in state.stop_inputs
        ),
        reports=(*state.reports, *open_reports),
        refusal=state.refusal,
        refusal_count=state.refusal_count,
        lease=state.lease,
        stop_received_ns=state.stop_received_ns,
        stop_command_ns=state.stop_command_ns,
        stop_lease=state.newest_stop[0],
        stop_sequence=state.newest_stop[1],
        pauses=state.pauses,
        steps=state.steps,
        distance_walked_m=state.distance_walked_m,
        report_age_ms=(inputs.now_ns - (report.captured_ns if report else state.streams.report_ns)) / NS_PER_MS,
        **asdict(status),
    )


def _allowed(state: ControlState) -> tuple[tuple[Action, ...], Reason | None]:
    """The actions that the therapist's keys may start now; without one, why. Events go before the gait table."""
    forbidden = blocker(state.events, Source.THERAPIST)
    if forbidden is not None:
        return (), forbidden.reason
    running = state.gait.running
    if running is None and not state.motion.settled:
        return (), reason(RequestRefusal.COMING_TO_REST)
    allowed = gait_machine.allowed(state.gait)
    return allowed, None if allowed or running is None else reason(RequestRefusal.ACTION_RUNNING, action=running)


def _event(one: RaisedEvent) -> ActiveEvent:
    return ActiveEvent(
        event=one.event,
        detail=one.detail,
        effect=ROW[one.event].effect,
        since_ns=one.since_ns,
        number=one.since_ns,
        present=one.present,
        acknowledged=one.acknowledged or not one.latched,
    )


def _joints(state: ControlState, inputs: Inputs) -> tuple[JointSnapshot, JointSnapshot, JointSnapshot, JointSnapshot]:
    left_hip, left_knee, right_hip, right_knee = (_joint(state, inputs, joint) for joint in Joint)
    return left_hip, left_knee, right_hip, right_knee


def held_rad(command: JointCommand) -> JointArray:
    """Where the joints are commanded to be, (4,); NaN where nothing pulls them there: off, or damped."""
    return np.where(command.stiffness_nm_rad > 0, command.position_rad, nan)


def _joint(state: ControlState, inputs: Inputs, joint: Joint) -> JointSnapshot:
    feedback = inputs.feedback
    fault = feedback.faults[joint]
    angle_rad, target_rad = float(feedback.position_rad[joint]), float(held_rad(state.motion.command)[joint])
    return JointSnapshot(
        angle_rad=angle_rad,
        target_rad=angle_rad if isnan(target_rad) else target_rad,
        speed_rad_s=float(feedback.velocity_rad_s[joint]),
        torque_nm=float(feedback.torque_nm[joint]),
        temperature_c=float(feedback.temperature_c[joint]),
        age_ms=(inputs.now_ns - int(feedback.measured_ns[joint])) / NS_PER_MS,
        faults=tuple(reason(each) for each in fault),
    )


_PER_DECADE = 40  # bins a factor of ten: a percentile is right to 6 %
_LOWEST_NS = 1_000
_DECADES = 8  # to 100 s
_EDGES_NS = _LOWEST_NS * 10.0 ** (np.arange(_PER_DECADE * _DECADES + 1) / _PER_DECADE)


@dataclass(slots=True)
class Histogram:
    """Lateness of a session's ticks; missed ones are counted besides."""

    missed: int = 0
    max_ns: int = 0
    counts: NDArray[np.int64] = field(default_factory=lambda: np.zeros(len(_EDGES_NS) + 1, dtype=np.int64))

    def add(self, late_ns: int, missed: int = 0) -> None:
        """One tick that began this late, after so many that were left out."""
        self.counts[int(_EDGES_NS.searchsorted(late_ns, side="right"))] += 1
        self.missed += missed
        self.max_ns = max(self.max_ns, late_ns)

    def percentile_ms(self, share: float) -> float:
        """The lateness that this share (0 to 1) of the ticks did not exceed; upper edge of its bin."""
        total = int(self.counts.sum())
        if not total:
            return 0.0
        bin_number = int(np.searchsorted(np.cumsum(self.counts), share * total))
        edge_ns = _EDGES_NS[min(bin_number, len(_EDGES_NS) - 1)]
        return min(float(edge_ns), float(self.max_ns)) / 1e6

    def summary(self) -> Lateness:
        """For the screen and the trail."""
        return Lateness(
            ticks=int(self.counts.sum()),
            missed=self.missed,
            p50_ms=self.percentile_ms(0.50),
            p99_ms=self.percentile_ms(0.99),
            p999_ms=self.percentile_ms(0.999),
            max_ms=self.max_ns / 1e6,
        )


class JointStatisticsCollector:
    """Keeps a period's ticks; `take` gives the record and starts anew. In a tick only copies are made."""

    def __init__(self, period_ticks: int) -> None:
        self._period_ticks = period_ticks
        self._kept = np.empty((3, 4, period_ticks))  # angles, torques, targets; ticks side by side
        self._temperature_c = np.full(4, np.nan)
        self._ticks = 0

    @property
    def full(self) -> bool:
        """The period is over."""
        return self._ticks == self._period_ticks

    def add(self, feedback: JointFeedback, command: JointCommand) -> None:
        """One tick."""
        angle_rad, torque_nm, targets_rad = self._kept
        angle_rad[:, self._ticks] = feedback.position_rad
        torque_nm[:, self._ticks] = feedback.torque_nm
        targets_rad[:, self._ticks] = held_rad(command)
        self._temperature_c = feedback.temperature_c
        self._ticks += 1

    def take(self, period_s: float, state: str) -> JointStatistics:
        """The record of what was collected."""
        angle_rad, torque_nm, target_rad = self._kept[:, :, : self._ticks]
        self._ticks = 0
        return JointStatistics(
            period_s=period_s,
            angle_min_rad=quad(angle_rad.min(axis=1)),
            angle_mean_rad=quad(angle_rad.mean(axis=1)),
            angle_max_rad=quad(angle_rad.max(axis=1)),
            target_mean_rad=quad(target_rad.mean(axis=1)),
            torque_min_nm=quad(torque_nm.min(axis=1)),
            torque_mean_nm=quad(torque_nm.mean(axis=1)),
            torque_max_nm=quad(torque_nm.max(axis=1)),
            temperature_c=quad(self._temperature_c),
            tracking_rms_rad=quad(np.sqrt(np.square(angle_rad - target_rad).mean(axis=1))),
            state=state,
        )


def quad(values: JointArray) -> Quad:
    """Plain numbers for the trail; null: not measured."""
    one, two, three, four = (float(value) if isfinite(value) else None for value in values)
    return one, two, three, four
