"""A guardian's checks, heartbeats and adapters in the hands of a test."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import can

from app.ipc.messages import GuardianHealth, Heartbeat
from app.session.guardian import RETRY_NS, Guardian
from app.session.heartbeat_check import GuardianAction
from hal.errors import CanFault, HardwareError
from hal.joints.can.port import frame_of, message_of
from hal.joints.codecs.wire import Frame
from hal.joints.emulator.firmware import EmulatedDrive
from logs.records import Note

MS = 1_000_000
CHECK = 4 * MS


class Adapter(can.BusABC):
    """A bus whose adapter may be pulled out; what is plugged in again is another one. Its drives answer at once."""

    def __init__(self, drives: Sequence[EmulatedDrive]) -> None:
        super().__init__(channel=0)
        self.plugged = True
        self.open = True
        self.sent = 0
        self._drives = drives
        self._replies: list[Frame] = []

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        self._touch()
        self.sent += 1
        for drive in self._drives:
            if drive.accepts(frame_of(msg)):
                self._replies += drive.receive(frame_of(msg), self.sent)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        self._touch()
        return (message_of(self._replies.pop(0)), False) if self._replies else (None, False)

    def shutdown(self) -> None:
        super().shutdown()
        self.open = False
        self._touch()

    def _touch(self) -> None:
        if not self.plugged:
            raise can.CanOperationError("no such device", 19)


@dataclass
class Watch:
    """A guardian whose checks, heartbeats and adapters are the test's."""

    adapters: list[Adapter] = field(default_factory=list)
    there: bool = True  # an adapter is plugged in
    waiting: list[Frame] = field(default_factory=list)  # frames that a bus has received before the guardian reads it
    strangers: int = 0  # foreign peers since the last question
    drives: tuple[EmulatedDrive, ...] = ()
    health: list[GuardianHealth] = field(default_factory=list)
    records: list[Any] = field(default_factory=list)
    beat: Heartbeat | None = None
    now_ns: int = 1_000 * MS
    step_ns: int = CHECK

    def open_bus(self, _: object) -> Adapter:
        if not self.there:
            raise HardwareError(CanFault.NO_INTERFACE, bus="can0", command="")
        self.adapters.append(Adapter(self.drives))
        self.adapters[-1]._replies += self.waiting
        return self.adapters[-1]

    def pull_out(self) -> None:
        self.there = self.adapters[-1].plugged = False

    def receive(self) -> Heartbeat | None:
        beat, self.beat = self.beat, None
        return beat

    def foreign_peers(self) -> int:
        new, self.strangers = self.strangers, 0
        return new

    def check(self, guardian: Guardian, for_ns: int, *, enabled: bool | None = True) -> None:
        """Checks for so long, each with a heartbeat; None: without."""
        for _ in range(for_ns // self.step_ns):
            self.now_ns += self.step_ns
            if enabled is not None:
                self.beat = Heartbeat(at_ns=self.now_ns, enabled=enabled)
            guardian.check(self.now_ns)

    def end_unconfirmed(self, guardian: Guardian, *, killed: bool = False) -> tuple[list[GuardianAction], float]:
        """Control and session end with a drive that has not confirmed: what is done then, and for how long (ms).

        killed: control ends without another heartbeat.
        """
        self.check(guardian, RETRY_NS)
        self.check(guardian, 300 * MS, enabled=False)
        guardian.end()
        ended_ns = self.now_ns
        self.beat = Heartbeat(at_ns=ended_ns, enabled=False, last=not killed, unconfirmed=True)
        actions = []
        while self.now_ns == ended_ns or not guardian.done(self.now_ns):
            assert self.now_ns - ended_ns < 10_000 * MS, "it does not end"
            self.check(guardian, self.step_ns, enabled=None)
            actions.append(guardian._state.action)
        return actions, (self.now_ns - ended_ns) / MS

    def notes(self) -> list[Note]:
        """What the guardian wrote to the trail."""
        return [one for one in self.records if isinstance(one, Note)]
