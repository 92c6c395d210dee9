"""One bus seen from the host: sends without waiting, drains what has come, turns every failure into a flag."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence

import can

from hal.joints.can.bus import fault_of, frame_of, meaning_of, message_of
from hal.joints.can.local_bus import LocalBus
from hal.joints.codecs.wire import Frame
from hal.joints.protocol import BusFault

_DRAIN_LIMIT = 64  # frames a tick: a flood must not cost the tick
_RECEIVE_ERRORS = (can.CanError, OSError, ValueError, TypeError)  # python-can raises these for broken input


class BusPort:
    """A python-can bus whose methods never raise; `take_faults` tells what went wrong since it was last asked."""

    def __init__(
        self,
        bus: can.BusABC,
        name: str,
        since_ns: int = 0,
        *,
        clock: Callable[[], int] = time.monotonic_ns,
        wall_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self._bus = bus
        self._local = bus if isinstance(bus, LocalBus) else None  # which takes and gives several frames at once
        self.name = name
        self._clock = clock
        self._wall_ns = wall_ns
        self._faults = BusFault.NONE
        self._detail = ""
        self._empty_ns = since_ns

    def send(self, *frames: Frame) -> bool:
        """Hand frames to the bus; False when it did not take one of them."""
        if self._local is not None:
            return self._hand_over(self._local.send_frames, frames)
        left = [self._hand_over(self._bus.send, message_of(frame), 0) for frame in frames]  # one refused stops no other
        return all(left)

    def send_error(self, bits: int) -> bool:
        """An error frame, where an emulated controller tells one."""
        message = can.Message(is_error_frame=True, is_extended_id=False, arbitration_id=bits, data=bytes(8))
        return self._hand_over(self._bus.send, message, 0)

    def drain(self, now_ns: int) -> Iterator[tuple[Frame, int]]:
        """What has arrived, each with the monotonic time of its arrival.

        Receive stamps are wall-clock time. They are carried over by their age, and held between the last look
        at an empty queue and now, where the arrival must lie: so no step of the wall clock makes old news fresh.
        Both clocks are read here: between the tick's beginning and here the host may have stood still.
        """
        offset_ns = self._wall_ns() - self._clock()
        taken = 0
        while taken < _DRAIN_LIMIT:
            frames = self._take(0)
            if frames is None:
                self._empty_ns = now_ns
                return
            for frame, at_s in frames:
                yield frame, self._arrival(at_s, offset_ns, now_ns)
            taken += max(len(frames), 1)

    def wait(self, timeout_s: float) -> list[Frame] | None:
        """The next frames, waited for, None when there are none; never in a tick."""
        frames = self._take(timeout_s)
        return None if frames is None else [frame for frame, _ in frames]

    def wait_for_arrivals(self, timeout_s: float) -> list[tuple[Frame, int]] | None:
        """As `wait`, each frame with the monotonic time of its arrival; for the life cycle."""
        frames = self._take(timeout_s)
        now_ns = self._clock()
        if frames is None:
            self._empty_ns = now_ns
            return None
        offset_ns = self._wall_ns() - self._clock()
        return [(frame, self._arrival(at_s, offset_ns, now_ns)) for frame, at_s in frames]

    def hear(self, timeout_s: float) -> can.Message | None:
        """The next message of whatever kind, waited for; for who listens only."""
        return self._receive(timeout_s)

    def report(self, fault: BusFault, text: str) -> None:
        """Note something for the next `take_faults`."""
        self._faults |= fault
        self._detail = f"{self.name}: {text}"

    def take_faults(self) -> tuple[BusFault, str]:
        """What went wrong since the last call, and a sentence on the newest."""
        taken = self._faults, self._detail
        self._faults, self._detail = BusFault.NONE, ""
        return taken

    def close(self) -> None:
        """Release the bus."""
        self._bus.shutdown()

    def _hand_over(self, send: Callable[..., None], *what: object) -> bool:
        try:
            send(*what)
        except (can.CanError, OSError) as error:
            self.report(fault_of(error), f"sending failed: {error}")
            return False
        return True

    def _take(self, timeout_s: float) -> list[tuple[Frame, float]] | None:
        """Data frames that came together, each with its stamp; what else came is reported. None: nothing came."""
        if self._local is None:
            message = self._receive(timeout_s)
            return None if message is None else self._data_frames([(message, message.timestamp)])
        try:
            came = self._local.receive_frames(timeout_s)
        except _RECEIVE_ERRORS as error:
            self._report_receiving(error)
            return None
        return None if came is None else self._data_frames(came)

    def _data_frames(self, came: Sequence[tuple[Frame | can.Message, float]]) -> list[tuple[Frame, float]]:
        frames = []
        for what, at_s in came:
            if isinstance(what, Frame):
                frames.append((what, at_s))
            elif what.is_error_frame:
                meaning = meaning_of(what)
                self.report(meaning.fault, meaning.text)
            elif what.is_remote_frame or what.is_fd:
                self.report(BusFault.MALFORMED, f"not a classic data frame: ID {what.arbitration_id:X}")
            else:
                frames.append((frame_of(what), at_s))
        return frames

    def _receive(self, timeout_s: float) -> can.Message | None:
        try:
            return self._bus.recv(timeout_s)
        except _RECEIVE_ERRORS as error:
            self._report_receiving(error)
            return None

    def _report_receiving(self, error: Exception) -> None:
        broken = error.__cause__ is not None and not isinstance(error.__cause__, OSError)
        if broken or isinstance(error, ValueError | TypeError):
            self.report(BusFault.MALFORMED, f"received something that is no CAN frame: {error}")
        else:
            self.report(BusFault.INTERFACE_GONE, f"receiving failed: {error}")

    def _arrival(self, at_s: float, offset_ns: int, now_ns: int) -> int:
        """offset_ns: wall clock less monotonic."""
        return min(max(int(at_s * 1e9) - offset_ns, self._empty_ns), now_ns)
