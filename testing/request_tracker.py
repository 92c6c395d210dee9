"""What becomes of a drive's commands, for benchmarks: answered, late or missed.

Replies carry no number, so each belongs to the oldest command that waits. A lost one would then shift all that follow
by a tick for ever: where in a whole window more commands stay waiting than this drive ever left, the surplus is missed.
"""

from __future__ import annotations

import time
from collections import deque

from hal.joints.can.drive import Drive
from hal.joints.codecs.wire import Frame, Reply
from hal.joints.device import JointDevice
from hal.joints.motors import MotorModel
from hal.joints.protocol import Joint

MISSED_AFTER_NS = 20_000_000
_WINDOW_COMMANDS = 8  # with fewer in a window, what usually waits is unknown


class RequestTracker:
    """Sent, answered, late and missed add up: `sent == answered + late + missed + under_way`."""

    def __init__(self) -> None:
        self.sent = self.answered = self.late = self.overdue = 0
        self.round_trips_ns: deque[int] = deque(maxlen=65_536)
        self._pending: deque[int] = deque()  # when they were sent
        self._usual: int | None = None  # how many wait at the best moment of a window
        self._least = 0
        self._window_ns = self._window_sent = 0
        self._steady = False  # the window before was full of commands too: what waits now is usual

    @property
    def missed(self) -> int:
        """Commands that were never answered."""
        return self.overdue - self.late

    @property
    def in_flight(self) -> int:
        """Commands whose time is not over yet."""
        return len(self._pending)

    def send(self, now_ns: int) -> None:
        """A command leaves."""
        self.sent += 1
        self._window_sent += 1
        self._pending.append(now_ns)

    def receive(self, measured_ns: int) -> None:
        """A reply has come."""
        if self._pending:
            self.round_trips_ns.append(measured_ns - self._pending.popleft())
            self._least = min(self._least, len(self._pending))
            self.answered += 1
        elif self.missed:
            self.late += 1

    def poll(self, now_ns: int) -> None:
        """Give up what has waited for too long, and what a lost reply has left behind."""
        while self._pending and now_ns - self._pending[0] > MISSED_AFTER_NS:
            self._give_up()
        if now_ns - self._window_ns >= MISSED_AFTER_NS:
            self._close_window(now_ns)

    def _close_window(self, now_ns: int) -> None:
        full = self._window_sent >= _WINDOW_COMMANDS
        if full and self._steady:
            self._usual = self._least if self._usual is None else min(self._usual, self._least)
            for _ in range(min(self._least - self._usual, len(self._pending))):
                self._give_up()
        self._least = len(self._pending)
        self._window_ns, self._window_sent, self._steady = now_ns, 0, full

    def _give_up(self) -> None:
        self._pending.popleft()
        self._least = min(self._least, len(self._pending))
        self.overdue += 1


class TrackedDrive(Drive):
    """A drive whose commands and replies are tracked."""

    def __init__(self, joint: Joint, device: JointDevice, model: MotorModel) -> None:
        super().__init__(joint, device, model)
        self.requests = RequestTracker()

    def ask(self, frame: Frame) -> Frame:
        """Tracked."""
        self.requests.send(time.monotonic_ns())
        return super().ask(frame)

    def take(self, reply: Reply, measured_ns: int) -> bool:
        """Tracked."""
        self.requests.receive(measured_ns)
        return super().take(reply, measured_ns)
