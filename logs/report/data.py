"""The data of a session's report, computed from its records. Pure: records in, values out."""

from __future__ import annotations

import math
import statistics
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from logs import records as r
from logs.read import Outline
from logs.reason import Render, text_of
from logs.records import Record
from logs.report.events import NOTED, B, EventSum, ReportEvent, Timed, events_of, summed
from logs.show import UNKNOWN, record_text

JOINTS = ("Joint.LEFT_HIP", "Joint.LEFT_KNEE", "Joint.RIGHT_HIP", "Joint.RIGHT_KNEE")  # keys of the wording


@dataclass(frozen=True, slots=True, kw_only=True)
class Band:
    """A stretch of time with a label, seconds from the session's beginning."""

    begin_s: float
    end_s: float
    label: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Spread:
    """Milliseconds of a kind of latency over a session; the name is a key of the wording."""

    name: str
    values_ms: tuple[float, ...]

    def share(self, quantile: float) -> float | None:
        """The value up to which that share lies; the mean of the middle two for a half. None: nothing was measured."""
        if not self.values_ms:
            return None
        if quantile == 0.5:
            return statistics.median(self.values_ms)
        return sorted(self.values_ms)[math.ceil(quantile * len(self.values_ms)) - 1]


@dataclass(frozen=True, slots=True, kw_only=True)
class JointTrace:
    """One joint over the session, degrees and seconds."""

    name: str
    at_s: tuple[float, ...]
    low_deg: tuple[float, ...]
    mean_deg: tuple[float, ...]
    high_deg: tuple[float, ...]
    target_deg: tuple[float, ...]
    highest_c: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportData:
    """Everything on the page."""

    outline: Outline
    start: r.SessionStart | None
    states: tuple[Band, ...]
    gestures: tuple[Band, ...]
    presses: tuple[Band, ...]
    time_in_state: tuple[tuple[str, float], ...]  # longest first
    latencies: tuple[Spread, ...]
    joints: tuple[JointTrace, ...]
    refusals: tuple[tuple[str, int], ...]
    cancels: tuple[tuple[str, int], ...]
    events: tuple[ReportEvent, ...]  # that had an effect on the legs or on what is allowed
    kinds_of_events: tuple[EventSum, ...]  # the same, summed up
    remarks: tuple[tuple[str, int], ...]  # events that were only noted
    stops_s: tuple[float, ...]
    pauses: tuple[tuple[float, str], ...]  # when, what
    notes: tuple[tuple[float, str, str], ...]  # when, who, what
    actions: tuple[tuple[str, int, int], ...]  # name, attempts, completed
    lateness: r.TickLateness | None
    real_time: r.RealTimePrivilege | None
    lost_records: int
    heartbeats_lost: tuple[tuple[str, int], ...]


def data_of(outline: Outline, found: Sequence[Record], render: Render) -> ReportData:
    """The data of a session; recorded reasons become text by `render`."""
    timed = Timed(found)
    states = _states(timed, outline.duration_s)
    events = events_of(timed, render)
    effective = tuple(event for event in events if event.effect != NOTED)
    return ReportData(
        outline=outline,
        start=_first(timed.of(r.SessionStart)),
        states=states,
        gestures=_gestures(timed, outline.duration_s),
        presses=_presses(timed, outline.duration_s),
        time_in_state=_time_in(states),
        latencies=_latencies([end for _, end in timed.of(r.ActionEnd)]),
        joints=tuple(_trace(timed.of(r.JointStatistics), joint) for joint in range(len(JOINTS))),
        refusals=_counted(text_of(body.reason, render) for _, body in timed.of(r.Refusal)),
        cancels=_counted(text_of(body.reason, render) for _, body in timed.of(r.Cancel)),
        events=effective,
        kinds_of_events=summed(effective, outline.duration_s),
        remarks=_counted(event.event for event in events if event.effect == NOTED),
        stops_s=tuple(at_s for at_s, _ in timed.of(r.Stop)),
        pauses=tuple((at_s, record_text(body, render)) for at_s, body in timed.of(r.Pause)),
        notes=_notes(timed, render),
        actions=_actions([end for _, end in timed.of(r.ActionEnd)]),
        lateness=_last(timed.of(r.TickLateness)),
        real_time=_first(timed.of(r.RealTimePrivilege)),
        lost_records=sum(body.count for _, body in timed.of(r.RecordsLost)),
        heartbeats_lost=_counted(body.stream for _, body in timed.of(r.HeartbeatLost)),
    )


def _first(found: Sequence[tuple[float, B]]) -> B | None:
    return found[0][1] if found else None


def _last(found: Sequence[tuple[float, B]]) -> B | None:
    return found[-1][1] if found else None


def _counted(texts: Iterable[str]) -> tuple[tuple[str, int], ...]:
    return tuple(Counter(texts).most_common())


def _states(timed: Timed, end_s: float) -> tuple[Band, ...]:
    changes = timed.of(r.Transition)
    if not changes:
        stayed = {body.state for _, body in timed.of(r.JointStatistics) if body.state}
        return tuple(Band(begin_s=0.0, end_s=end_s, label=state) for state in stayed if len(stayed) == 1)
    starts = [0.0, *(at_s for at_s, _ in changes)]
    labels = [changes[0][1].from_state, *(body.to_state for _, body in changes)]
    return _bands(starts, labels, end_s)


def _gestures(timed: Timed, end_s: float) -> tuple[Band, ...]:
    onsets = timed.of(r.GestureOnset)
    bands = _bands([at_s for at_s, _ in onsets], [body.gesture or "" for _, body in onsets], end_s)
    return tuple(band for band in bands if band.label)


def _presses(timed: Timed, end_s: float) -> tuple[Band, ...]:
    marks = [(at_s, body.gesture or UNKNOWN) for at_s, body in timed.of(r.Press)]
    marks += [(at_s, "") for at_s, _ in timed.of(r.Release)] + [(at_s, "") for at_s, _ in timed.of(r.Cancel)]
    marks.sort()
    bands = _bands([at_s for at_s, _ in marks], [label for _, label in marks], end_s)
    return tuple(band for band in bands if band.label)


def _bands(starts: list[float], labels: list[str], end_s: float) -> tuple[Band, ...]:
    ends = [*starts[1:], end_s]
    return tuple(
        Band(begin_s=begin, end_s=max(end, begin), label=label)
        for begin, end, label in zip(starts, ends, labels, strict=False)
    )


def _time_in(bands: Iterable[Band]) -> tuple[tuple[str, float], ...]:
    spent: dict[str, float] = {}
    for band in bands:
        spent[band.label] = spent.get(band.label, 0.0) + band.end_s - band.begin_s
    return tuple(sorted(spent.items(), key=lambda item: -item[1]))


def _latencies(ends: list[r.ActionEnd]) -> tuple[Spread, ...]:
    """From the paper's moments: recognition, release, first changed command, first visible motion (0.5°)."""
    pairs = (
        ("report.release_to_command", "released_ns", "first_command_ns"),
        ("report.recognition_to_command", "recognised_ns", "first_command_ns"),
        ("report.recognition_to_motion", "recognised_ns", "first_motion_ns"),
    )
    return tuple(
        Spread(name=name, values_ms=tuple(value for end in ends if (value := _between(end, begin, until)) is not None))
        for name, begin, until in pairs
    )


def _between(end: r.ActionEnd, begin: str, until: str) -> float | None:
    first, last = getattr(end, begin), getattr(end, until)
    return (last - first) / 1e6 if first and last else None


def _trace(found: list[tuple[float, r.JointStatistics]], joint: int) -> JointTrace:
    whole = [(at_s, body) for at_s, body in found if body.angle_mean_rad[joint] is not None]
    warm = [value for _, body in found if (value := body.temperature_c[joint]) is not None]
    return JointTrace(
        name=JOINTS[joint],
        at_s=tuple(at_s for at_s, _ in whole),
        low_deg=tuple(_degrees(body.angle_min_rad[joint]) for _, body in whole),
        mean_deg=tuple(_degrees(body.angle_mean_rad[joint]) for _, body in whole),
        high_deg=tuple(_degrees(body.angle_max_rad[joint]) for _, body in whole),
        target_deg=tuple(_degrees(_target_rad(body, joint)) for _, body in whole),
        highest_c=max(warm, default=None),
    )


def _target_rad(body: r.JointStatistics, joint: int) -> float | None:
    """A joint that is held nowhere is shown as on the screen: its target is where it is."""
    target_rad = body.target_mean_rad[joint]
    return body.angle_mean_rad[joint] if target_rad is None else target_rad


def _degrees(value: float | None) -> float:
    return math.nan if value is None else math.degrees(value)


def _notes(timed: Timed, render: Render) -> tuple[tuple[float, str, str], ...]:
    def text(body: r.Note | r.Rating) -> str:
        return text_of(body.text, render) if isinstance(body, r.Note) else record_text(body, render)

    return tuple(
        (timed.at_s(record), record.operator, text(record.body))
        for record in timed.records
        if isinstance(record.body, r.Note | r.Rating)
    )


def _actions(ends: list[r.ActionEnd]) -> tuple[tuple[str, int, int], ...]:
    attempts = Counter(end.action for end in ends)
    completed = Counter(end.action for end in ends if end.outcome == "completed")
    return tuple((action, count, completed[action]) for action, count in attempts.most_common())
