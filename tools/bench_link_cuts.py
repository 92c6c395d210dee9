"""Cuts of the link in every gait state and movement, judged by the table in docs/safety.md, "What a lost link does".

Part of `bench_two_hosts.py cuts`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from app.ipc.messages import OperatorKind
from app.ipc.snapshot import ControlSnapshot
from app.ipc.states import Action, Effect, Event, Outcome
from app.ipc.streams import OPERATOR
from app.link.beats import LOST_NS
from testing.network import Air
from testing.two_hosts import TwoHosts
from tools.bench_stop import MIDDLE, SITUATIONS, InterlockError, Situation, go, reach, stand

CUTS_S = (0.1, 0.5, 1.0, 2.0, 10.0)
LOST_S = LOST_NS / 1e9
PAUSED_S = OPERATOR.stale_ms / 1000  # a console's silence until it pauses the legs
WATCH_S = 0.5  # after the link is back
STILL_RAD = 0.03  # 1.7°: simulated joints under their weight, and their noise
UNPOWERED, BETWEEN = "unpowered", "between"
WALK_END, POWER_ON = Situation(during=Action.WALK_END), Situation(during=Action.INITIALISE)
STALLS = frozenset({Event.CONTROL_LATE, Event.CONTROL_STALLED, Event.GUARDIAN_ACTED, Event.GUARDIAN_TIMEOUT})
ARM_TRIES = 60
TRIES = 5  # a busy host may hold the legs before the cut, or stall control meanwhile


@dataclass(frozen=True, slots=True)
class Found:
    """What one cut did."""

    moving: bool
    held: bool
    armed: bool
    paused: bool
    begun: int  # actions that nobody asked for
    moved_rad: float  # after the return of the link, or, at rest, since before the cut
    outcome: Outcome | None
    stalled: bool  # by the host

    def as_said(self, cut_s: float) -> bool:
        """Whether it is what the table says."""
        if self.begun or (self.moved_rad > STILL_RAD and (self.held or not self.moving)):
            return False
        if cut_s > LOST_S:
            return self.held and not self.armed
        if self.held or not self.armed:
            return False
        paused = not self.moving or cut_s < PAUSED_S or self.paused
        return paused and (not self.moving or self.outcome in {Outcome.COMPLETED, Outcome.RUNNING})


def measure_cuts(session: TwoHosts, air: Air, only: str) -> bool:
    """A line for each situation and cut; whether all ended as the table says."""
    print(f"{'legs':28} cut      held  armed  paused  action     moved   host stalled  as the table says")
    good = count = 0
    session.send(OperatorKind.CONFIRM_PATIENT)
    session.until(lambda now: now.patient_confirmed and bool(now.allowed), "readiness")
    for name, situation in _situations():
        if not re.search(only, name):
            continue
        for cut_s in CUTS_S:
            found = _found(session, air, name, situation, cut_s)
            said = found.as_said(cut_s)
            good, count = good + said, count + 1
            outcome = found.outcome.value if found.outcome else "-"
            print(
                f"{name:28} {cut_s:4.1f} s   {_yes(found.held)}   {_yes(found.armed)}    {_yes(found.paused)}     "
                f"{outcome:9}  {found.moved_rad:.3f}   {_yes(found.stalled)}           {_yes(said)}",
                flush=True,
            )
    print(f"{good} of {count}")
    return good == count


def _situations() -> Iterator[tuple[str, Situation | None]]:
    yield UNPOWERED, None
    yield POWER_ON.name, POWER_ON
    yield BETWEEN, Situation(during=Action.STEP_RIGHT_FIRST)
    for situation in (*SITUATIONS, WALK_END):
        yield situation.name, situation


def _found(session: TwoHosts, air: Air, name: str, situation: Situation | None, cut_s: float) -> Found:
    """Bring the legs there, and cut; again where the host stalled control."""
    for _ in range(TRIES):
        try:
            _bring(session, name, situation)
        except InterlockError:
            continue
        found = _cut(session, air, cut_s)
        if not found.stalled:
            break
    return found


def _bring(session: TwoHosts, name: str, situation: Situation | None) -> None:
    """The legs into the situation, armed. Raises InterlockError."""
    _end_walk(session)
    if situation is POWER_ON or situation is None:
        session.settle()
        if session.now.enabled:
            _power_off(session)
    else:
        stand(session)
    _arm(session)
    if situation is None:
        return
    if situation is WALK_END:
        go(session, Situation(during=Action.WALK))
        session.send(OperatorKind.ACT, Action.WALK_END)
        reach(session, lambda now: Action.WALK_END in {now.action, now.pending}, "the walk's end")
    elif situation is POWER_ON:
        reach(session, lambda now: Action.INITIALISE in now.allowed, "legs at rest")
        session.send(OperatorKind.ACT, Action.INITIALISE)
        reach(session, lambda now: now.action is Action.INITIALISE and now.progress > MIDDLE, "the way to standing")
    else:
        go(session, situation)
    if name == BETWEEN:
        session.send(OperatorKind.STOP)
        session.until(lambda now: now.effect >= Effect.HOLD and now.action is None, "hold")
        session.settle()
        _arm(session)


def _end_walk(session: TwoHosts) -> None:
    """A walk outlives a short cut."""
    if session.now.action is Action.WALK:
        session.send(OperatorKind.ACT, Action.WALK_END)
        session.until(lambda now: now.action is None, "the walk's end")


def _power_off(session: TwoHosts) -> None:
    for _ in range(2):
        session.send(OperatorKind.STOP)
    session.until(lambda now: now.effect is Effect.DAMP, "damping")
    session.send(OperatorKind.TORQUE_OFF)
    session.until(lambda now: not now.enabled, "torque off")
    session.settle()


def _arm(session: TwoHosts) -> None:
    """Refused as long as the link's figures still hold the last cut."""
    for _ in range(ARM_TRIES):
        session.send(OperatorKind.ARM)
        session.go_on(0.5)
        if session.now.armed:
            return
    raise TimeoutError(f"not armed: {session.now}")


def _cut(session: TwoHosts, air: Air, cut_s: float) -> Found:
    before = session.now
    moving = before.action is not None
    air.cut = True
    session.go_on(cut_s)
    air.cut = False
    back = session.until(lambda now: now.at_ns > before.at_ns + cut_s * 1e9 and _told(now, cut_s), "the link")
    if cut_s <= LOST_S and moving:  # it goes on by itself: a walk until it is ended, all others to their end
        back = session.until(lambda now: _gone_on(now, before), "the movement's end")
    session.go_on(WATCH_S)
    now = session.now
    held = now.effect >= Effect.HOLD
    since = back if moving else before
    angles = zip(now.joints, since.joints, strict=True)
    still = before.enabled and (held or not moving)
    report = next(
        (one for one in now.reports if moving and before.reports and one.number == before.reports[-1].number), None
    )
    return Found(
        moving=moving,
        held=held,
        armed=now.armed,
        paused=now.pauses.count > before.pauses.count,
        begun=len(_numbers(now) - _numbers(before)),
        moved_rad=max(abs(one.angle_rad - other.angle_rad) for one, other in angles) if still else 0.0,
        outcome=report.outcome if report else None,
        stalled=any(one.event in STALLS for one in now.events),
    )


def _numbers(now: ControlSnapshot) -> set[int]:
    return {one.number for one in now.reports}


def _told(now: ControlSnapshot, cut_s: float) -> bool:
    """Whether the return of a lost link has reached control."""
    return cut_s <= LOST_S or (now.effect >= Effect.HOLD and now.action is None)


def _gone_on(now: ControlSnapshot, before: ControlSnapshot) -> bool:
    walks = before.action is Action.WALK and before.pending is None
    return now.effect >= Effect.HOLD or (now.steps > before.steps + 1 if walks else now.action is None)


def _yes(value: bool) -> str:
    return "yes" if value else "no "
