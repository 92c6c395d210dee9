"""The laptop's commands on their way to control: with this host's numbers and clock, each once, none that is stale."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable

from msgspec.structs import replace

from app.ipc.links import OrderedSender
from app.ipc.messages import STOP_KINDS, OperatorCommand, OperatorKind
from app.ipc.snapshot import ControlSnapshot
from app.link.beats import LOST_NS
from app.link.clock import ClockEstimate, localized
from app.link.order import STOPS_A_PACKET, Inbox
from app.link.wire import LinkNotice, StopMark, mark_of

STOPS_KEPT = 32
# Sent so long ago they are not carried out any more. A stop, and what takes away, always is.
NEVER_STALE = frozenset(
    {*STOP_KINDS, OperatorKind.DISARM, OperatorKind.SHUT_DOWN, OperatorKind.TAKE_OVER, OperatorKind.HEARTBEAT}
)
REFUSED_BY_AGE = frozenset({OperatorKind.ARM, OperatorKind.ACT})  # by control, which shows why


class CommandRelay:
    """Of one session: which console commands, as the laptop and as control number it, and what control was handed."""

    def __init__(self, control: OrderedSender, operator: str, note: Callable[..., None], *, held: bool) -> None:
        """note: into the trail. held: an earlier process of this command handed commands on before."""
        self._control = control
        self._note = note
        self.inbox = Inbox(resumed=held)
        self.stops: tuple[StopMark, ...] = ()  # acknowledged by control, newest last
        self._handed: dict[int, StopMark] = {}  # own sequence → as the laptop knows it
        self._lease = 0 if held else 1  # as control knows it; 0: not known yet
        self._their_lease = 0 if held else 1  # the same console as the laptop numbers it; 0: not known yet
        self._their_operator = operator
        # An earlier process of this command counted from less: what control says of its STOPs is none of ours.
        self._sequence = time.monotonic_ns() if held else 0
        self._heartbeat_ns = self._acknowledged_ns = 0  # by the laptop's clock
        self._must_take_over = held
        self._returned_ns = 0  # when the laptop came back last: what it was given before that is not carried out

    def commanded_by(self, operator: str) -> None:
        """Whose name the laptop's console has, of a session that is resumed."""
        self._their_operator = operator or self._their_operator

    def adopt_lease(self, lease: int) -> None:
        """Of the laptop's packets: an earlier process of this command may have acknowledged a takeover there."""
        self._their_lease = self._their_lease or lease

    def hand(self, commands: Iterable[OperatorCommand], clock: ClockEstimate, now_ns: int) -> None:
        """The console's, in order."""
        for command in commands:
            self._hand(command, clock, now_ns)

    def hand_stops(
        self, stops: Iterable[StopMark], clock: ClockEstimate, now_ns: int, acknowledged_ns: int = 0, lease: int = 0
    ) -> None:
        """STOPs that came by packet: each once, whether its frame came before or comes later.

        acknowledged_ns: when the console of that lease acknowledged last; a STOP may be another console's. That
        precedes the STOPs given after it, or the first of them would count as a second one, and damp.
        """
        for stop in stops:
            command = OperatorCommand(lease=stop.lease, sequence=stop.sequence, kind=stop.kind, sent_ns=stop.sent_ns)
            recent = now_ns - clock.local_ns(acknowledged_ns) <= LOST_NS
            if 0 < acknowledged_ns < stop.sent_ns and recent and stop not in self._handed.values():
                kind = OperatorKind.ACKNOWLEDGE
                self._hand(replace(command, kind=kind, lease=lease, sent_ns=acknowledged_ns), clock, now_ns)
            self._hand(command, clock, now_ns)

    def hand_heartbeat(self, heartbeat_ns: int, lease: int, clock: ClockEstimate) -> None:
        """STOP could be given at that moment; it has no sequence, so that it overtakes no command."""
        if heartbeat_ns > self._heartbeat_ns and lease == self._their_lease and self._lease:
            self._heartbeat_ns = heartbeat_ns
            sent_ns = clock.local_ns(heartbeat_ns)
            self._send(OperatorCommand(sequence=0, lease=self._lease, kind=OperatorKind.HEARTBEAT, sent_ns=sent_ns))

    def hand_return(self, silent_ns: int) -> None:
        """The link is back after it was lost: whoever comes back takes the legs over, held and disarmed."""
        self._note(LinkNotice.LINK_RETURNED, silent_s=silent_ns / 1e9)
        self._must_take_over = True

    def take_over_if_due(self, now_ns: int) -> None:
        """As another console does (`TAKE_OVER`)."""
        if self._must_take_over and self._lease:
            self._must_take_over = False
            self._returned_ns = now_ns
            self._take_over(now_ns, self._their_operator)

    def acknowledge(self, snapshot: ControlSnapshot) -> None:
        """What control has acted on."""
        self._lease = self._lease or snapshot.lease
        done = [mark for own, mark in self._handed.items() if own <= snapshot.stop_sequence]
        self.stops = tuple(done[-STOPS_A_PACKET:])

    def shown(self, snapshot: ControlSnapshot) -> ControlSnapshot:
        """As the laptop's consoles number leases and STOPs."""
        mark = self._handed.get(snapshot.stop_sequence) if snapshot.stop_sequence else None
        return replace(
            snapshot,
            lease=self._their_lease,
            stop_lease=mark.lease if mark else 0,
            stop_sequence=mark.sequence if mark else 0,
        )

    def _hand(self, given: OperatorCommand, clock: ClockEstimate, now_ns: int) -> None:
        """given: by the laptop's clock, as a repeated STOP has it."""
        mark = mark_of(given) if given.kind in STOP_KINDS else None
        if given.kind is OperatorKind.HEARTBEAT or mark in self._handed.values():
            return
        if given.kind is OperatorKind.ACKNOWLEDGE and given.sent_ns == self._acknowledged_ns:
            return  # it came with a packet before its frame
        command = localized(given, clock)
        age_ns = now_ns - command.sent_ns
        if mark is not None and self._precedes_return(command):
            # An earlier process may have handed it on, by another estimate: it must not look like a later press.
            command = replace(command, sent_ns=command.sent_ns - 2 * clock.uncertainty_ns)
        if self._is_stale(command, age_ns):
            self._note(LinkNotice.COMMAND_STALE, command=command.kind.value, age_s=age_ns / 1e9)
            return
        # As adopted, too: a packet with the new lease may have overtaken the command.
        if command.kind is OperatorKind.TAKE_OVER and command.lease >= self._their_lease:
            self._their_lease, self._their_operator = command.lease, command.operator
            if self._lease:  # else the takeover of the resumed session is still due
                self._take_over(command.sent_ns, command.operator)
        elif command.lease == self._their_lease or command.kind in STOP_KINDS:
            if command.kind is OperatorKind.ACKNOWLEDGE:
                self._acknowledged_ns = given.sent_ns
            lease = self._lease if command.lease == self._their_lease else 0
            self._sequence += 1
            if mark is not None:
                self._handed[self._sequence] = mark
                self._handed = dict(list(self._handed.items())[-STOPS_KEPT:])
            self._send(replace(command, lease=lease, sequence=self._sequence))

    def _precedes_return(self, command: OperatorCommand) -> bool:
        """Whether it was given before the takeover of the laptop's return, or that is still due."""
        return self._must_take_over or command.sent_ns < self._returned_ns

    def _is_stale(self, command: OperatorCommand, age_ns: int) -> bool:
        if command.kind in NEVER_STALE:
            return False
        if age_ns > LOST_NS:
            return command.kind not in REFUSED_BY_AGE
        return self._precedes_return(command)

    def _take_over(self, sent_ns: int, operator: str) -> None:
        self._lease += 1
        self._sequence += 1
        self._send(
            OperatorCommand(
                lease=self._lease,
                sequence=self._sequence,
                kind=OperatorKind.TAKE_OVER,
                sent_ns=sent_ns,
                operator=operator,
            )
        )

    def _send(self, command: OperatorCommand) -> None:
        if not self._control.send(command):
            self._note(LinkNotice.COMMANDS_LOST)
