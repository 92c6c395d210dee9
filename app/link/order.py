"""Commands over a connection that may be lost: each arrives once, in order; pure counts.

The sender repeats what was not acknowledged in every frame, the receiver takes what it has not counted yet.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field

from msgspec.structs import replace

from app.ipc.messages import STOP_KINDS, OperatorCommand, OperatorKind
from app.link.wire import COMMANDS_A_FRAME, FRAMES_IN_FLIGHT, Packet, StopMark, mark_of

MOST_WAITING = 256  # commands; hands press a few a second
STOPS_A_PACKET = 8


@dataclass(slots=True)
class Outbox:
    """Commands that the other computer has not acknowledged yet."""

    acknowledged: int = 0
    _waiting: deque[OperatorCommand] = field(default_factory=deque)

    def add(self, command: OperatorCommand) -> bool:
        """Queue one; False when the queue is full: the caller must tell."""
        if len(self._waiting) >= MOST_WAITING:
            return False
        self._waiting.append(command)
        return True

    def acknowledge(self, count: int) -> None:
        """The other computer has so many, since the session's start."""
        while self.acknowledged < count and self._waiting:
            self._waiting.popleft()
            self.acknowledged += 1

    @property
    def first(self) -> int:
        """The count of the oldest waiting command."""
        return self.acknowledged + 1

    @property
    def next(self) -> tuple[OperatorCommand, ...]:
        """What the next frame carries."""
        return tuple(self._waiting)[:COMMANDS_A_FRAME]


@dataclass(slots=True)
class Inbox:
    """How many commands came."""

    count: int = 0
    resumed: bool = False  # an earlier process took what came before: the first frame tells how many it acknowledged

    def take(self, first: int, commands: Iterable[OperatorCommand]) -> list[OperatorCommand]:
        """The new ones of a frame; a frame that leaves a gap brings none."""
        new: list[OperatorCommand] = []
        if self.resumed:
            self.count, self.resumed = max(0, first - 1), False
        if first > self.count + 1:
            return new
        for number, command in enumerate(commands, first):
            if number == self.count + 1:
                self.count = number
                new.append(command)
        return new


@dataclass(slots=True)
class WaitingStops:
    """STOPs that control has not acknowledged yet, repeated on every packet."""

    acknowledged: StopMark = field(default_factory=lambda: StopMark(0, 0, 0))  # the newest that control acts on
    _waiting: list[StopMark] = field(default_factory=list)

    def add(self, stop: StopMark) -> None:
        """One more was given."""
        self._waiting.append(stop)

    def acknowledge(self, stops: Iterable[StopMark]) -> bool:
        """Control acts on these; whether that is new.

        Those sent before them with the same lease are done with: not all are named, and frames bring them as well.
        Sequences don't tell which: consoles that have not taken over yet share a lease.
        """
        new = False
        for stop in stops:
            left = [one for one in self._waiting if one.lease != stop.lease or one.sent_ns > stop.sent_ns]
            if len(left) < len(self._waiting):
                self._waiting, self.acknowledged, new = left, stop, True
        return new

    @property
    def next(self) -> tuple[StopMark, ...]:
        """What the next packet carries."""
        return tuple(self._waiting[-STOPS_A_PACKET:])


@dataclass(slots=True)
class ConsoleCommands:
    """What the laptop's consoles command: in frames, and what must not wait for one on every packet."""

    outbox: Outbox = field(default_factory=Outbox)
    stops: WaitingStops = field(default_factory=WaitingStops)
    heartbeat_ns: int = 0  # the newest of the console that commands
    _lease: int = 0  # of that console
    _acknowledged_ns: int = 0  # when it acknowledged events last

    def add(self, command: OperatorCommand) -> bool:
        """One more was given; False when the queue is full: the caller must tell."""
        if command.kind is OperatorKind.TAKE_OVER and command.lease > self._lease:
            self._lease, self._acknowledged_ns = command.lease, 0
        if command.kind is OperatorKind.HEARTBEAT:
            self._lease = self._lease or command.lease
            if command.lease == self._lease:
                self.heartbeat_ns = command.sent_ns
            return True
        if command.kind is OperatorKind.ACKNOWLEDGE and command.lease == self._lease:
            self._acknowledged_ns = command.sent_ns
        if command.kind in STOP_KINDS:
            self.stops.add(mark_of(command))
        return self.outbox.add(command)

    def on(self, packet: Packet) -> Packet:
        """The packet with what it carries of them."""
        return replace(
            packet,
            stops=self.stops.next,
            acknowledged_ns=self._acknowledged_ns,
            heartbeat_ns=self.heartbeat_ns,
            lease=self._lease,
        )


@dataclass(slots=True)
class Flight:
    """How many frames are under way: a lost connection must not fill with old ones."""

    sent: int = 0
    acknowledged: int = 0
    received: int = 0
    waiting_since_ns: int = 0  # since the oldest unacknowledged frame left or the last acknowledgement; 0: none waits

    @property
    def is_open(self) -> bool:
        """Whether another frame may leave."""
        return self.sent - self.acknowledged < FRAMES_IN_FLIGHT

    def send(self, now_ns: int) -> int:
        """The number of the next frame."""
        if not self.waiting_since_ns:
            self.waiting_since_ns = now_ns
        self.sent += 1
        return self.sent

    def receive(self, number: int, acknowledged: int, now_ns: int) -> None:
        """A frame came."""
        self.received = max(self.received, number)
        if self.acknowledged < acknowledged <= self.sent:
            self.acknowledged = acknowledged
            self.waiting_since_ns = now_ns if self.sent > acknowledged else 0

    def waits_ns(self, now_ns: int) -> int:
        """For how long nothing has been acknowledged."""
        return now_ns - self.waiting_since_ns if self.waiting_since_ns else 0
