"""How far apart the monotonic clocks of two hosts are, from round trips alone; pure, every time is an argument.

As NTP does it (RFC 5905, §8): of a packet that was sent at t1, received at t2, answered at t3 and whose answer came at
t4, the other clock is ahead by at most t2 − t1 and by at least t3 − t4, whatever way the delay is shared. Where NTP
takes the middle of the quickest round trip, all bounds are kept here: their intersection holds the truth as long as
both clocks run, each widened by what two clocks drift meanwhile. A bound that contradicts it is a step.

Raw clocks of two hosts are never compared: moments that cross the link are told by the clock of who receives them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeVar

import msgspec
from msgspec.structs import replace

from app.ipc.messages import AuditHealth, GuardianHealth, OperatorCommand, SessionStatus, TriggerReport
from app.ipc.snapshot import ActionReport, ActiveEvent, ControlSnapshot, PauseSummary
from app.ipc.streams import NS_PER_MS
from logs.records.session import DRIFT_PPM

# What contradicts less is followed without a note: chrony's quickest usual slew (`maxslewrate`, 83,333 ppm) moves a
# clock by 1.7 ms from packet to packet, and as much while one waits at the other end.
STEP_NS = 10 * NS_PER_MS


@dataclass(frozen=True, slots=True)
class RoundTrip:
    """Four moments, nanoseconds: sent and answered by our clock (t1, t4), received and answered by the other (t2, t3).

    A packet answers the newest one that came; it may have waited at the other end, which t3 − t2 tells.
    """

    sent_ns: int
    received_ns: int
    answered_ns: int
    returned_ns: int

    @property
    def delay_ns(self) -> int:
        """Both ways together, without the wait at the other end."""
        return self.returned_ns - self.sent_ns - (self.answered_ns - self.received_ns)

    @property
    def plausible(self) -> bool:
        """Whether time went forward at both ends; a forged or restarted one may not."""
        return self.returned_ns >= self.sent_ns and self.answered_ns >= self.received_ns

    @property
    def stood_still(self) -> bool:
        """Whether our clock stood still meanwhile, as of a computer that slept: they waited longer than it all took.

        Then `received_ns − sent_ns` says nothing of the clocks as they are now. A clock that is slewed seems to wait
        longer too, but by less than STEP_NS.
        """
        return self.delay_ns < -max(STEP_NS, _drift_ns(self.returned_ns - self.sent_ns))


@dataclass(frozen=True, slots=True)
class ClockEstimate:
    """The other clock minus ours, between `low_ns` and `high_ns` when ours said `at_ns`."""

    at_ns: int
    low_ns: int
    high_ns: int

    @property
    def offset_ns(self) -> int:
        """The middle."""
        return (self.low_ns + self.high_ns) // 2

    @property
    def uncertainty_ns(self) -> int:
        """The truth is so far away from the middle at most."""
        return self.high_ns - self.offset_ns

    def at(self, now_ns: int) -> ClockEstimate:
        """The same knowledge at another moment: wider by the drift."""
        drift_ns = _drift_ns(now_ns - self.at_ns)
        return ClockEstimate(now_ns, self.low_ns - drift_ns, self.high_ns + drift_ns)

    def local_ns(self, other_ns: int) -> int:
        """A moment of the other clock by ours, never younger than it is; 0, a moment that has not come, stays 0."""
        return other_ns - self.high_ns if other_ns else 0


@dataclass(frozen=True, slots=True)
class ClockUpdate:
    """An estimate after one more round trip, and by how much a clock was stepped, if one was."""

    estimate: ClockEstimate
    step_ns: int = 0


def update(before: ClockEstimate | None, trip: RoundTrip) -> ClockUpdate:
    """The estimate with one more round trip; after a step only that round trip is known."""
    drift_ns = _drift_ns(trip.returned_ns - trip.sent_ns)
    # Inside out where a clock was slewed by more than both ways took.
    low_ns, high_ns = sorted((trip.answered_ns - trip.returned_ns, trip.received_ns - trip.sent_ns))
    new = ClockEstimate(trip.returned_ns, low_ns - drift_ns, high_ns + drift_ns)
    if before is None:
        return ClockUpdate(new)
    known = before.at(trip.returned_ns)
    low_ns, high_ns = max(known.low_ns, new.low_ns), min(known.high_ns, new.high_ns)
    if low_ns > high_ns:
        return ClockUpdate(new, step_ns=new.offset_ns - known.offset_ns)
    return ClockUpdate(ClockEstimate(trip.returned_ns, low_ns, high_ns))


def _drift_ns(elapsed_ns: int) -> int:
    return -(-abs(elapsed_ns) * DRIFT_PPM // 1_000_000)


M = TypeVar("M", bound=msgspec.Struct)

# One row a message: its fields that hold moments, and those that hold messages which do.
MOMENTS: dict[type[msgspec.Struct], tuple[str, ...]] = {
    TriggerReport: (
        "captured_ns",
        "sent_ns",
        "recognised_ns",
        "released_recognised_ns",
        "released_ns",
        "released_pressed_ns",
    ),
    OperatorCommand: ("sent_ns",),
    ControlSnapshot: ("at_ns", "stop_received_ns", "stop_command_ns"),
    ActiveEvent: ("since_ns",),
    ActionReport: ("recognised_ns", "released_ns", "accepted_ns", "first_command_ns", "first_motion_ns", "ended_ns"),
    PauseSummary: ("ended_ns",),
    AuditHealth: ("at_ns",),
    GuardianHealth: ("at_ns",),
    SessionStatus: ("at_ns",),
}
PARTS: dict[type[msgspec.Struct], tuple[str, ...]] = {ControlSnapshot: ("events", "reports", "pauses")}


def localized(message: M, clock: ClockEstimate) -> M:
    """The message with its moments by our clock.

    A moment is shifted by the most that the other clock may be ahead: it may look older than it is, by twice the
    uncertainty, and never younger.
    """
    kind = type(message)
    changes: dict[str, Any] = {name: clock.local_ns(getattr(message, name)) for name in MOMENTS[kind]}
    for name in PARTS.get(kind, ()):
        part = getattr(message, name)
        changes[name] = (
            tuple(localized(one, clock) for one in part) if isinstance(part, tuple) else localized(part, clock)
        )
    return replace(message, **changes)
