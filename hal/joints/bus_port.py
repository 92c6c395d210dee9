"""One bus seen from the host: sends without waiting, drains what has come, turns every failure into a flag."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import can

from hal.joints.bus import fault_of, meaning_of
from hal.joints.joints import BusFault

_DRAIN_LIMIT = 64  # frames a tick: a flood must not cost the tick
_RECEIVE_ERRORS = (can.CanError, OSError, ValueError, TypeError)  # python-can raises these for broken input


class BusPort:
    """A python-can bus whose methods never raise; `take_faults` tells what went wrong since it was last asked."""

    def __init__(
        self, bus: can.BusABC, name: str, since_ns: int = 0, wall_ns: Callable[[], int] = time.time_ns
    ) -> None:
        self._bus = bus
        self.name = name
        self._wall_ns = wall_ns
        self._faults = BusFault.NONE
        self._detail = ""
        self._empty_ns = since_ns

    def send(self, message: can.Message) -> bool:
        """Hand a frame to the bus; False when it did not take it."""
        try:
            self._bus.send(message, 0)
        except (can.CanError, OSError) as error:
            self.report(fault_of(error), f"sending failed: {error}")
            return False
        return True

    def drain(self, now_ns: int) -> Iterator[tuple[can.Message, int]]:
        """What has arrived, each with the monotonic time of its arrival.

        Receive stamps are wall-clock time. They are carried over by their age, and held between the last look
        at an empty queue and now, where the arrival must lie: so no step of the wall clock makes old news fresh.
        """
        wall_ns = self._wall_ns()
        for _ in range(_DRAIN_LIMIT):
            message = self._receive(0)
            if message is None:
                self._empty_ns = now_ns
                return
            yield message, self._arrival(message, now_ns, wall_ns)

    def wait(self, timeout_s: float) -> can.Message | None:
        """The next frame, waited for; only for the life cycle, never in a tick."""
        return self._receive(timeout_s)

    def report(self, fault: BusFault, text: str) -> None:
        """Note something for the next `take_faults`."""
        self._faults |= fault
        self._detail = f"{self.name}: {text}"

    def report_error_frame(self, message: can.Message) -> None:
        """Note an error frame."""
        meaning = meaning_of(message)
        self.report(meaning.fault, meaning.text)

    def take_faults(self) -> tuple[BusFault, str]:
        """What went wrong since the last call, and a sentence on the newest."""
        taken = self._faults, self._detail
        self._faults, self._detail = BusFault.NONE, ""
        return taken

    def close(self) -> None:
        """Release the bus."""
        self._bus.shutdown()

    def _receive(self, timeout_s: float) -> can.Message | None:
        try:
            return self._bus.recv(timeout_s)
        except _RECEIVE_ERRORS as error:
            broken = error.__cause__ is not None and not isinstance(error.__cause__, OSError)
            if broken or isinstance(error, ValueError | TypeError):
                self.report(BusFault.MALFORMED, f"received something that is no CAN frame: {error}")
            else:
                self.report(BusFault.INTERFACE_GONE, f"receiving failed: {error}")
            return None

    def _arrival(self, message: can.Message, now_ns: int, wall_ns: int) -> int:
        age_ns = wall_ns - int(message.timestamp * 1e9)
        return min(max(now_ns - age_ns, self._empty_ns), now_ns)
