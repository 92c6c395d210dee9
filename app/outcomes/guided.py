"""Guided tests in a session: 10-metre walk, 6-minute walk, Timed Up and Go. Pure.

A test observes control's snapshots; it commands nothing and no check of safety knows it. Time is the snapshots' own
clock. Distance is the one that control counts, of completed steps as planned.

- 10-metre walk: from standing; the clock starts with the legs' first motion, the step that completes 10 m ends it.
- 6-minute walk: the same clock, which runs on through rests (American Thoracic Society, American Journal of Respiratory
  and Critical Care Medicine 166, 2002); what was walked after 6 minutes is the distance.
- Timed Up and Go (Podsiadlo and Richardson, Journal of the American Geriatrics Society 39, 1991): from sitting, from
  the start by key until sitting again, after 6 m, which is 3 m there and 3 m back. No action here turns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum, auto

from app.ipc.snapshot import ControlSnapshot
from app.ipc.states import LEVEL_WALKING, Action, Effect, GaitState, Outcome
from logs.reason import Reason, reason
from logs.records import GuidedTestResult

ROUNDING_M = 1e-6  # of sums of steps
# Between two snapshots, of twenty a second. When a step in a longer time ended nobody knows: by the later snapshot a
# walk of 1.4 s had taken 6.2 s.
UNOBSERVED_S = 0.5


class GuidedTest(Enum):
    """The kinds; the value stands in the audit trail."""

    TEN_METRE_WALK = "ten metre walk"
    SIX_MINUTE_WALK = "six minute walk"
    TIMED_UP_AND_GO = "timed up and go"


class GuidedRefusal(Enum):
    """Why a test can't begin now."""

    CONTROL_SILENT = auto()
    HELD = auto()
    LEGS_MOVING = auto()
    NOT_STANDING = auto()
    NOT_SITTING = auto()


class GuidedStop(Enum):
    """Why a test was not completed, where no event of control stopped it."""

    BY_KEY = auto()
    SAT_DOWN_EARLY = auto()  # distance_m, wanted_m
    HELD = auto()
    CONTROL_SILENT = auto()
    CONTROL_RESTARTED = auto()
    NOT_OBSERVED = auto()  # gap_s
    SESSION_ENDED = auto()


@dataclass(frozen=True, slots=True, kw_only=True)
class Procedure:
    """How a test goes."""

    begins_in: GaitState
    refusal: GuidedRefusal  # in any other state
    timed_from_first_motion: bool = True  # else from its start by key
    distance_m: float | None = None  # to walk
    limit_s: float | None = None  # it ends then
    until_seated: bool = False


PROCEDURES = {
    GuidedTest.TEN_METRE_WALK: Procedure(
        begins_in=GaitState.STANDING, refusal=GuidedRefusal.NOT_STANDING, distance_m=10.0
    ),
    GuidedTest.SIX_MINUTE_WALK: Procedure(
        begins_in=GaitState.STANDING, refusal=GuidedRefusal.NOT_STANDING, limit_s=360.0
    ),
    GuidedTest.TIMED_UP_AND_GO: Procedure(
        begins_in=GaitState.SITTING,
        refusal=GuidedRefusal.NOT_SITTING,
        timed_from_first_motion=False,
        distance_m=6.0,
        until_seated=True,
    ),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class GuidedRun:
    """One test from its start by key to its end."""

    test: GuidedTest
    incarnation: int  # of the control that counts
    started_ns: int
    steps_before: int
    distance_before_m: float
    began_ns: int = 0  # when its clock started; 0: waits for the first motion
    at_ns: int  # of what follows
    steps: int = 0
    distance_m: float = 0.0
    outcome: Outcome = Outcome.RUNNING
    stopped_by: Reason | None = None

    @property
    def procedure(self) -> Procedure:
        """How it goes."""
        return PROCEDURES[self.test]

    @property
    def ended(self) -> bool:
        """Whether it has a result."""
        return self.outcome is not Outcome.RUNNING

    @property
    def duration_s(self) -> float:
        """By its own clock; 0 while it waits."""
        return (self.at_ns - self.began_ns) / 1e9 if self.began_ns else 0.0

    @property
    def remaining_m(self) -> float | None:
        """To walk; None: it has no distance."""
        wanted_m = self.procedure.distance_m
        if wanted_m is None:
            return None
        left_m = wanted_m - self.distance_m
        return left_m if left_m > ROUNDING_M else 0.0

    @property
    def remaining_s(self) -> float | None:
        """Until it is over; None: it has no such time."""
        limit_s = self.procedure.limit_s
        return None if limit_s is None else max(0.0, limit_s - self.duration_s)


def refusal_of(test: GuidedTest, now: ControlSnapshot | None, *, fresh: bool) -> GuidedRefusal | None:
    """Why this test can't begin; None: it can."""
    procedure = PROCEDURES[test]
    if now is None or not fresh:
        return GuidedRefusal.CONTROL_SILENT
    if now.effect >= Effect.HOLD:
        return GuidedRefusal.HELD
    if now.action is not None:
        return GuidedRefusal.LEGS_MOVING
    return None if now.state is procedure.begins_in else procedure.refusal


def begin(test: GuidedTest, now: ControlSnapshot, key_ns: int) -> GuidedRun:
    """Start a test that is not refused, by a key at that moment of the host's monotonic clock."""
    return GuidedRun(
        test=test,
        incarnation=now.incarnation,
        started_ns=key_ns,
        steps_before=now.steps,
        distance_before_m=now.distance_walked_m,
        began_ns=0 if PROCEDURES[test].timed_from_first_motion else key_ns,
        at_ns=key_ns,
    )


def advance(run: GuidedRun, now: ControlSnapshot | None, *, fresh: bool) -> GuidedRun:
    """The test after control's newest snapshot; what has ended stays as it is."""
    if run.ended:
        return run
    if now is None or not fresh:
        return stop(run, reason(GuidedStop.CONTROL_SILENT))
    if now.incarnation != run.incarnation:
        return stop(run, reason(GuidedStop.CONTROL_RESTARTED))
    return run if now.at_ns < run.at_ns else _observed(run, now)


def stop(run: GuidedRun, why: Reason) -> GuidedRun:
    """Not completed; what it came to is kept."""
    return run if run.ended else replace(run, outcome=Outcome.STOPPED, stopped_by=why)


def result_of(run: GuidedRun) -> GuidedTestResult:
    """As it stands in the trail. A speed is told where all of the time is walking or rest between steps."""
    walked = run.procedure.timed_from_first_motion and run.duration_s > 0
    return GuidedTestResult(
        test=run.test.value,
        outcome=run.outcome.value,
        reason=run.stopped_by,
        started_ns=run.started_ns,
        began_ns=run.began_ns,
        ended_ns=run.at_ns,
        duration_s=run.duration_s,
        distance_m=run.distance_m,
        steps=run.steps,
        speed_m_s=run.distance_m / run.duration_s if walked else None,
    )


def _observed(run: GuidedRun, now: ControlSnapshot) -> GuidedRun:
    counted = _counted(_timed(run, now), now)
    completed_ns, held = _completed_ns(counted, now), _held(now)
    if held is not None and (completed_ns is None or held[0] < completed_ns):
        return stop(counted, held[1])
    if completed_ns is None:
        return _seated_early(counted, now)
    late = run.procedure.limit_s is not None and now.at_ns > completed_ns  # a step since then does not count
    gap_s = (now.at_ns - run.at_ns) / 1e9
    if gap_s > UNOBSERVED_S and counted.steps > run.steps and (late or completed_ns == now.at_ns):
        return stop(run, reason(GuidedStop.NOT_OBSERVED, gap_s=gap_s))
    figures = run if late else counted
    return replace(figures, began_ns=counted.began_ns, at_ns=completed_ns, outcome=Outcome.COMPLETED)


def _timed(run: GuidedRun, now: ControlSnapshot) -> GuidedRun:
    """With its clock started, if the legs have moved for a walk since the start by key."""
    if run.began_ns:
        return run
    moved = (one.first_motion_ns for one in now.reports if one.action in LEVEL_WALKING)
    return replace(run, began_ns=min((at_ns for at_ns in moved if at_ns >= run.started_ns), default=0))


def _counted(run: GuidedRun, now: ControlSnapshot) -> GuidedRun:
    return replace(
        run,
        at_ns=now.at_ns,
        steps=now.steps - run.steps_before,
        distance_m=now.distance_walked_m - run.distance_before_m,
    )


def _completed_ns(run: GuidedRun, now: ControlSnapshot) -> int | None:
    """When the test was completed; None: not yet."""
    wanted = run.procedure
    if not run.began_ns or run.remaining_m:
        return None
    if wanted.until_seated:
        return _seated_ns(run, now)
    if wanted.limit_s is None:
        return now.at_ns
    over_ns = run.began_ns + round(wanted.limit_s * 1e9)
    return over_ns if now.at_ns >= over_ns else None


def _seated_ns(run: GuidedRun, now: ControlSnapshot) -> int | None:
    ends = (
        one.ended_ns
        for one in now.reports
        if one.action is Action.SIT_DOWN and one.outcome is Outcome.COMPLETED and one.ended_ns > run.started_ns
    )
    return max(ends, default=None)


def _seated_early(run: GuidedRun, now: ControlSnapshot) -> GuidedRun:
    if not run.procedure.until_seated or _seated_ns(run, now) is None:
        return run
    why = reason(GuidedStop.SAT_DOWN_EARLY, distance_m=run.distance_m, wanted_m=run.procedure.distance_m)
    return stop(run, why)


def _held(now: ControlSnapshot) -> tuple[int, Reason] | None:
    """Since when the legs are held or damped, and by which event; None: they are not."""
    if now.effect < Effect.HOLD:
        return None
    events = [event for event in now.events if event.effect >= Effect.HOLD]
    first = min(events, key=lambda event: event.since_ns, default=None)
    return (now.at_ns, reason(GuidedStop.HELD)) if first is None else (first.since_ns, first.reason)


def last_completed(results: Sequence[GuidedTestResult], test: GuidedTest) -> GuidedTestResult | None:
    """The session's last one of this kind that was completed; None: there is none."""
    found = [one for one in results if (one.test, one.outcome) == (test.value, Outcome.COMPLETED.value)]
    return found[-1] if found else None
