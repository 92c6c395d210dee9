"""One end of the packets: the other clock, the link's quality, and what the other end heard; time is an argument.

Quality comes from counters and round trips: figures for people, and what the limits for arming are compared with.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

from msgspec.structs import replace

from app.audit.sink import PERIOD_NS, other_trail
from app.ipc.messages import AuditHealth, LinkHealth
from app.ipc.states import Event
from app.ipc.streams import AUDIT_HEALTH, NS_PER_MS
from app.link.clock import STEP_NS, ClockEstimate, RoundTrip, update
from app.link.wire import LinkNotice, Packet
from logs.reason import reason
from logs.records import OtherTrail

BEAT_NS = 20 * NS_PER_MS  # a packet of the link's own socket in each direction; STOP travels on every one
WINDOW_BEATS = 250  # five seconds: loss is told to 0.4 %
_ROUND_TRIPS = 100  # two seconds
LOST_NS = 1_230_000_000  # a console's silence until it pauses the legs, and the longest pause: then they are held
WALL_STEP_NS = 500_000_000  # as control's own event of a clock's step


@dataclass(slots=True)
class LinkQuality:
    """What arrives of packets that are numbered one by one and sent every BEAT_NS."""

    jitter_ns: float = 0.0  # RFC 3550, §6.4.1: the mean change of the delay from packet to packet
    _delays_ns: deque[int] = field(default_factory=lambda: deque(maxlen=_ROUND_TRIPS))
    _arrived: deque[int] = field(default_factory=lambda: deque(maxlen=WINDOW_BEATS))
    _newest_ns: int = 0

    def add(self, number: int, now_ns: int) -> None:
        """One packet came; older ones than the newest do not."""
        self._arrived.append(number)
        self._newest_ns = now_ns

    def add_delay(self, delay_ns: int) -> None:
        """One round trip, without the wait at the other end."""
        if self._delays_ns:
            self.jitter_ns += (abs(delay_ns - self._delays_ns[-1]) - self.jitter_ns) / 16
        self._delays_ns.append(delay_ns)

    @property
    def round_trip_ns(self) -> int:
        """The median of the last two seconds; 0 before the first."""
        return sorted(self._delays_ns)[len(self._delays_ns) // 2] if self._delays_ns else 0

    def loss(self, now_ns: int) -> float:
        """The share of the last five seconds' packets that did not come, those that are overdue among them; 0 to 1."""
        if not self._arrived:
            return 1.0
        newest = self._arrived[-1]
        overdue = max(0, (now_ns - self._newest_ns) // BEAT_NS - 1)
        first = max(self._arrived[0], newest + overdue - WINDOW_BEATS + 1)
        sent = newest + overdue - first + 1
        came = sum(number >= first for number in self._arrived)
        return max(0.0, 1.0 - came / max(1, sent))


@dataclass(slots=True)
class Beats:
    """State of one direction and back."""

    quality: LinkQuality = field(default_factory=LinkQuality)
    clock: ClockEstimate | None = None  # None: not known yet, or not after it stood still
    newest_ns: int = 0  # when the newest packet came; 0: none yet
    steps: int = 0  # of a clock against the other one
    their_loss: float = 1.0
    _before: ClockEstimate | None = None  # what was known before our clock stood still
    _number: int = 0
    _sent_ns: int = 0
    _their_sent_ns: int = 0
    _their_wall_ns: int | None = None
    _step_ns: int = 0  # the newest that is not noted yet
    _wall_step_ns: int = 0  # the same, of the other host's wall clock against its monotonic one
    _trail_ns: int = 0

    def due(self, now_ns: int) -> bool:
        """Whether it is time for the next packet."""
        return now_ns - self._sent_ns >= BEAT_NS

    def next(self, now_ns: int, wall_ns: int) -> Packet:
        """The next packet, without what it carries."""
        self._number += 1
        late_ns = now_ns - self._sent_ns - BEAT_NS
        self._sent_ns = now_ns if late_ns > BEAT_NS else self._sent_ns + BEAT_NS  # punctual on average
        return Packet(
            number=self._number,
            sent_ns=now_ns,
            echo_sent_ns=self._their_sent_ns,
            echo_received_ns=self.newest_ns,
            wall_ns=wall_ns - now_ns,
            loss=self.quality.loss(now_ns),
        )

    def take(self, packet: Packet, now_ns: int) -> int:
        """A packet came; for how long none had, where the link was lost meanwhile, else 0."""
        silent_ns = now_ns - self.newest_ns if self.newest_ns else 0
        self.newest_ns, self._their_sent_ns, self.their_loss = now_ns, packet.sent_ns, packet.loss
        self.quality.add(packet.number, now_ns)
        if packet.echo_sent_ns:
            trip = RoundTrip(packet.echo_sent_ns, packet.echo_received_ns, packet.sent_ns, now_ns)
            if trip.plausible:
                self._set_clock(trip)
        self._watch_wall(packet.wall_ns)
        return silent_ns if silent_ns > LOST_NS else 0

    def new_steps(self) -> list[tuple[LinkNotice, float]]:
        """Of clocks since the last call, each with its seconds, for the trail."""
        steps = ((LinkNotice.CLOCK_STEPPED, self._step_ns), (LinkNotice.OTHER_CLOCK_STEPPED, self._wall_step_ns))
        self._step_ns = self._wall_step_ns = 0
        return [(notice, step_ns / 1e9) for notice, step_ns in steps if step_ns]

    def stop_clock(self, now_ns: int) -> ClockEstimate | None:
        """What STOP is told by, which waits for no round trip after our clock stood still.

        Then it was given, at the latest, when its packet left, and that counts as when it came: it is younger by the
        packet's way at most.
        """
        if self.clock is None and self._before is not None:
            ahead_ns = self._their_sent_ns - self.newest_ns
            return ClockEstimate(self.newest_ns, ahead_ns, ahead_ns)
        return None if self.clock is None else self.clock.at(now_ns)

    def loss(self, now_ns: int) -> float:
        """Of the worse direction."""
        return max(self.quality.loss(now_ns), self.their_loss)

    def lost(self, now_ns: int) -> bool:
        """Whether nothing has come for so long that the legs are held."""
        return not self.newest_ns or now_ns - self.newest_ns > LOST_NS

    def other_trail(self, audit: AuditHealth | None, now_ns: int) -> OtherTrail | None:
        """The record of the other computer's trail, once in PERIOD_NS; audit: the health that it sent."""
        if audit is None or self.clock is None or now_ns - self._trail_ns < PERIOD_NS:
            return None
        self._trail_ns, clock = now_ns, self.clock.at(now_ns)
        return other_trail(audit, clock.offset_ns, clock.uncertainty_ns)

    def _set_clock(self, trip: RoundTrip) -> None:
        if trip.stood_still:
            self._before = self.clock or self._before
            self.clock = None
            return
        self.quality.add_delay(max(0, trip.delay_ns))  # negative where a clock was slewed
        new = update(self.clock or self._before, trip)
        self.clock, self._before = new.estimate, None
        if abs(new.step_ns) >= STEP_NS:
            self.steps, self._step_ns = self.steps + 1, new.step_ns

    def _watch_wall(self, wall_ns: int) -> None:
        before, self._their_wall_ns = self._their_wall_ns, wall_ns
        if before is not None and abs(wall_ns - before) > WALL_STEP_NS:
            self._wall_step_ns = wall_ns - before


def trail_health(audit: AuditHealth | None, came_ns: int, now_ns: int) -> AuditHealth | None:
    """The health of this host's trail, for the other one: a fault when the audit process tells nothing any more.

    came_ns: when the newest came; before the first, when it began to be awaited.
    """
    if now_ns - came_ns <= AUDIT_HEALTH.stale_ms * NS_PER_MS:
        return audit
    audit = audit or AuditHealth(at_ns=came_ns, written=0, waiting=0)
    return replace(audit, fault=audit.fault or reason(Event.AUDIT_TIMEOUT))


def health_of(beats: Beats, host: str, now_ns: int, foreign: int, audit: AuditHealth | None) -> LinkHealth:
    """What one end knows of the link."""
    clock = None if beats.clock is None else beats.clock.at(now_ns)
    return LinkHealth(
        at_ns=now_ns,
        host=host,
        connected=not beats.lost(now_ns),
        round_trip_ms=beats.quality.round_trip_ns / NS_PER_MS,
        jitter_ms=beats.quality.jitter_ns / NS_PER_MS,
        loss=beats.loss(now_ns),
        offset_ns=clock.offset_ns if clock else 0,
        uncertainty_ns=clock.uncertainty_ns if clock else None,
        steps=beats.steps,
        audit=audit,
        foreign_peers=foreign,
    )
