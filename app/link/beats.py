"""One end of the packets: the other clock, the link's quality, and what the other end heard; time is an argument."""

from __future__ import annotations

from dataclasses import dataclass, field

from app.ipc.messages import AuditHealth, LinkHealth
from app.ipc.streams import NS_PER_MS
from app.link.clock import ClockEstimate, RoundTrip, update
from app.link.quality import BEAT_NS, LinkQuality
from app.link.wire import Packet

LOST_NS = 1_230_000_000  # a console's silence until it pauses the legs, and the longest pause: then they are held
WALL_STEP_NS = 500_000_000  # as control's own event of a clock's step


@dataclass(slots=True)
class Beats:
    """State of one direction and back."""

    quality: LinkQuality = field(default_factory=LinkQuality)
    clock: ClockEstimate | None = None
    newest_ns: int = 0  # when the newest packet came; 0: none yet
    steps: int = 0  # of a clock against the other one
    step_ns: int = 0  # the newest
    wall_step_ns: int = 0  # the newest of the other host's wall clock against its monotonic one
    their_loss: float = 1.0
    _number: int = 0
    _sent_ns: int = 0
    _their_sent_ns: int = 0
    _their_wall_ns: int | None = None

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

    def take(self, packet: Packet, now_ns: int) -> bool:
        """A packet came; whether the link is back after it was lost."""
        returned = bool(self.newest_ns) and now_ns - self.newest_ns > LOST_NS
        self.newest_ns, self._their_sent_ns, self.their_loss = now_ns, packet.sent_ns, packet.loss
        self.quality.add(packet.number, now_ns)
        if packet.echo_sent_ns:
            trip = RoundTrip(packet.echo_sent_ns, packet.echo_received_ns, packet.sent_ns, now_ns)
            if trip.plausible:
                self.quality.add_delay(trip.delay_ns)
                self._set_clock(trip)
        self._watch_wall(packet.wall_ns)
        return returned

    def loss(self, now_ns: int) -> float:
        """Of the worse direction."""
        return max(self.quality.loss(now_ns), self.their_loss)

    def lost(self, now_ns: int) -> bool:
        """Whether nothing has come for so long that the legs are held."""
        return not self.newest_ns or now_ns - self.newest_ns > LOST_NS

    def _set_clock(self, trip: RoundTrip) -> None:
        new = update(self.clock, trip)
        self.clock = new.estimate
        if new.step_ns:
            self.steps, self.step_ns = self.steps + 1, new.step_ns

    def _watch_wall(self, wall_ns: int) -> None:
        before, self._their_wall_ns = self._their_wall_ns, wall_ns
        if before is not None and abs(wall_ns - before) > WALL_STEP_NS:
            self.wall_step_ns = wall_ns - before


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
