"""What control hands to the session's recording: every tick's joints, copied into one array and sent 20 times a second.

In a tick it costs eight copies of four numbers; what a full queue refuses is counted and never waited for.
"""

from __future__ import annotations

from collections import Counter

import numpy as np

from app.control.inputs import Inputs, StreamState
from app.control.telemetry import held_rad
from app.ipc.messages import OperatorCommand, OperatorKind
from app.ipc.recording import BATCH_TICKS, QUANTITIES, Contact, LinkAges, TickBatch
from app.ipc.snapshot import ControlSnapshot
from app.ipc.streams import NS_PER_MS, RECORDING, LinkDirectory
from app.recording import schemas
from app.recording.sink import RecordingSink
from hal.joints.protocol import JointCommand
from logs.records import RecordingSent


class TickRecorder:
    """Collects ticks, and sends them on."""

    def __init__(self, links: LinkDirectory) -> None:
        self._sink = RecordingSink(links, RECORDING)
        self._at_ns = np.zeros(BATCH_TICKS, dtype=np.int64)
        self._values = np.zeros((BATCH_TICKS, len(QUANTITIES), 4))
        self._contacts: list[Contact] = []
        self._commands: list[OperatorCommand] = []
        self._first_tick = 0
        self._ticks = 0
        self._made: Counter[str] = Counter()
        self._lost: Counter[str] = Counter()  # of those

    @property
    def full(self) -> bool:
        """A batch is complete."""
        return self._ticks == BATCH_TICKS

    def add(self, inputs: Inputs, command: JointCommand) -> None:
        """One tick: what was read, and the command that was made of it."""
        feedback, values = inputs.feedback, self._values[self._ticks]
        self._at_ns[self._ticks] = inputs.now_ns
        values[0], values[1], values[2] = feedback.position_rad, feedback.velocity_rad_s, feedback.torque_nm
        values[3], values[4], values[5] = held_rad(command), command.velocity_rad_s, command.torque_nm
        values[6], values[7] = command.stiffness_nm_rad, command.damping_nm_s_rad
        self._ticks += 1
        if inputs.commands:
            self._commands += [one for one in inputs.commands if one.kind is not OperatorKind.HEARTBEAT]

    def add_contact(self, at_ns: int, force_n: tuple[float, float] | None) -> None:
        """The force on both feet, where it is known."""
        if force_n is not None:
            self._contacts.append(Contact(at_ns=at_ns, left_n=force_n[0], right_n=force_n[1]))

    def send(self, streams: StreamState, snapshot: ControlSnapshot) -> None:
        """Send what was collected; begin the next batch, whether it was taken or not."""
        ticks = self._ticks
        sent = self._sink.send(
            TickBatch(
                first_tick=self._first_tick,
                lost=dict(self._lost),
                at_ns=self._at_ns[:ticks].tobytes(),
                values=self._values[:ticks].tobytes(),
                contacts=tuple(self._contacts),
                commands=tuple(self._commands),
                ages=_ages(streams, int(self._at_ns[ticks - 1])),
                snapshot=snapshot,
            )
        )
        made = self._messages()
        self._made.update(made)
        if not sent:
            self._lost.update(made)
        self._first_tick += ticks
        self._ticks = 0
        self._contacts.clear()
        self._commands.clear()

    def close(self, streams: StreamState, snapshot: ControlSnapshot) -> None:
        """The last ticks, too."""
        if self._ticks:
            self.send(streams, snapshot)
        self._sink.close()

    @property
    def made(self) -> RecordingSent:
        """How many messages were made, by topic: the ticks that were sent, refused or not."""
        return RecordingSent(messages=dict(self._made))

    def _messages(self) -> dict[str, int]:
        """How many the recording makes of this batch, by topic."""
        return {
            **dict.fromkeys((schemas.JOINT_STATE, schemas.JOINT_SETPOINT), self._ticks),
            **dict.fromkeys((schemas.JOINT_HEALTH, schemas.GAIT, schemas.LINKS), 1),
            schemas.CONTACT: len(self._contacts),
            schemas.OPERATOR: len(self._commands),
        }


def _ages(streams: StreamState, now_ns: int) -> LinkAges:
    return LinkAges(
        report_ms=(now_ns - streams.report_ns) / NS_PER_MS,
        console_ms=(now_ns - streams.console_ns) / NS_PER_MS,
        audit_ms=(now_ns - streams.audit_ns) / NS_PER_MS,
        guardian_ms=(now_ns - streams.guardian_ns) / NS_PER_MS,
        audit_waiting=streams.audit.waiting if streams.audit else 0,
    )
