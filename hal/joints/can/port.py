"""A CAN bus through python-can whose failures and error frames become faults: nothing that it is asked raises."""

from __future__ import annotations

import errno
import struct
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import NamedTuple

import can

from hal.errors import CanFault, HardwareError
from hal.joints.can.local_bus import LocalBus
from hal.joints.codecs.wire import Frame
from hal.joints.protocol import BusFault

# linux/can/error.h: bits of an error frame's identifier
CAN_ERR_LOSTARB = 0x002
CAN_ERR_CRTL = 0x004
CAN_ERR_PROT = 0x008
CAN_ERR_ACK = 0x020
CAN_ERR_BUSOFF = 0x040
CAN_ERR_BUSERROR = 0x080
CAN_ERR_RESTARTED = 0x100

# Interfaces of python-can let these out too, for a frame that was cut (slcan, serial, seeedstudio).
_MALFORMED_ERRORS = (ValueError, TypeError, LookupError, struct.error)
RECEIVE_ERRORS = (can.CanError, OSError, *_MALFORMED_ERRORS)

_GONE = frozenset({errno.ENETDOWN, errno.ENODEV, errno.ENXIO, errno.EBADF, errno.ENETUNREACH})
_DRAIN_LIMIT = 64  # frames a tick: a flood must not cost the tick


@dataclass(frozen=True, slots=True)
class ErrorFrame:
    """What a bit of an error frame's identifier means."""

    bit: int
    fault: BusFault
    code: CanFault


# The first row that matches names the frame.
ERROR_FRAMES = (
    ErrorFrame(CAN_ERR_BUSOFF, BusFault.BUS_OFF, CanFault.CONTROLLER_OFF),
    ErrorFrame(CAN_ERR_LOSTARB, BusFault.ARBITRATION_LOST, CanFault.ARBITRATION_LOST),
    ErrorFrame(CAN_ERR_ACK, BusFault.ERROR_FRAME, CanFault.NOT_ACKNOWLEDGED),
    ErrorFrame(CAN_ERR_RESTARTED, BusFault.ERROR_FRAME, CanFault.CONTROLLER_RESTARTED),
    ErrorFrame(CAN_ERR_PROT, BusFault.ERROR_FRAME, CanFault.PROTOCOL_VIOLATION),
    ErrorFrame(CAN_ERR_CRTL, BusFault.ERROR_FRAME, CanFault.CONTROLLER_COUNTS_ERRORS),
    ErrorFrame(CAN_ERR_BUSERROR, BusFault.ERROR_FRAME, CanFault.BUS_ERROR),
)
_OTHER_ERROR = ErrorFrame(0, BusFault.ERROR_FRAME, CanFault.ERROR_FRAME)


def meaning_of(message: can.Message) -> ErrorFrame:
    """What a received error frame means."""
    return next((row for row in ERROR_FRAMES if message.arbitration_id & row.bit), _OTHER_ERROR)


def fault_of(error: Exception) -> BusFault:
    """What a failed send or receive means: the interface is gone, or this one time did not work."""
    number = getattr(error, "error_code", None) or getattr(error, "errno", None)
    if number is None and isinstance(error.__cause__, OSError):
        number = error.__cause__.errno
    return BusFault.INTERFACE_GONE if number in _GONE else BusFault.SEND_FAILED


def is_malformed(error: Exception) -> bool:
    """Whether a failed receive means something that was no frame; else the interface is gone."""
    cause = error.__cause__
    return isinstance(error, _MALFORMED_ERRORS) or (cause is not None and not isinstance(cause, OSError))


def message_of(frame: Frame) -> can.Message:
    """A frame as python-can sends it."""
    return can.Message(arbitration_id=frame.arbitration_id, is_extended_id=frame.extended, data=frame.data)


def frame_of(message: can.Message) -> Frame:
    """A received data frame."""
    return Frame(message.arbitration_id, bytes(message.data), message.is_extended_id)


class BusReport(NamedTuple):
    """What is wrong with something received; values: those of the code's message."""

    fault: BusFault
    code: CanFault
    values: Mapping[str, object]


class BusPort:
    """A python-can bus whose methods never raise; `take_faults` returns what went wrong since its last call."""

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
        self._local = bus if isinstance(bus, LocalBus) else None  # which carries several frames at once
        self.name = name
        self._clock = clock
        self._wall_ns = wall_ns
        self._faults = BusFault.NONE
        self._detail: HardwareError | None = None
        self._empty_ns = since_ns

    def send(self, *frames: Frame) -> bool:
        """Hand frames to the bus; False when it refused one of them."""
        if self._local is not None:
            return self._hand_over(self._local.send_frames, frames)
        left = [self._hand_over(self._bus.send, message_of(frame), 0) for frame in frames]  # one refused stops no other
        return all(left)

    def send_error(self, bits: int) -> bool:
        """An error frame, as an emulated controller reports it."""
        message = can.Message(is_error_frame=True, is_extended_id=False, arbitration_id=bits, data=bytes(8))
        return self._hand_over(self._bus.send, message, 0)

    def drain(self, now_ns: int) -> Iterator[tuple[Frame, int]]:
        """What has arrived, each with the monotonic time of its arrival.

        Receive stamps are wall-clock time. They are carried over by their age, and limited to the time between the
        last empty queue and now, where the arrival must lie: no step of the wall clock makes an old frame fresh.
        Both clocks are read here: between the tick's beginning and here the host may have been suspended.
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

    def report(self, fault: BusFault, code: CanFault, **values: object) -> None:
        """Keep a fault for the next `take_faults`."""
        self._faults |= fault
        self._detail = HardwareError(code, bus=self.name, **values)

    def take_faults(self) -> tuple[BusFault, HardwareError | None]:
        """What went wrong since the last call, and what is known of the newest."""
        taken = self._faults, self._detail
        self._faults, self._detail = BusFault.NONE, None
        return taken

    def close(self) -> None:
        """Release the bus. Some adapters are spoken to once more, and may be gone."""
        with suppress(can.CanError, OSError):
            self._bus.shutdown()

    def _hand_over(self, send: Callable[..., None], *what: object) -> bool:
        try:
            send(*what)
        except (can.CanError, OSError) as error:
            self.report(fault_of(error), CanFault.SEND_FAILED, detail=str(error))
            return False
        return True

    def _take(self, timeout_s: float) -> list[tuple[Frame, float]] | None:
        """Data frames that came together, each with its stamp; others are reported. None: nothing came."""
        if self._local is None:
            message = self.receive_message(timeout_s)
            return None if message is None else self._data_frames([(message, message.timestamp)])
        try:
            came = self._local.receive_frames(timeout_s)
        except RECEIVE_ERRORS as error:
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
                self.report(meaning.fault, meaning.code)
            elif what.is_remote_frame or what.is_fd:
                self.report(BusFault.MALFORMED, CanFault.NOT_A_DATA_FRAME, identifier=f"{what.arbitration_id:X}")
            else:
                frames.append((frame_of(what), at_s))
        return frames

    def receive_message(self, timeout_s: float) -> can.Message | None:
        """The next message of whatever kind, waited for; for listeners that send nothing."""
        try:
            return self._bus.recv(timeout_s)
        except RECEIVE_ERRORS as error:
            self._report_receiving(error)
            return None

    def _report_receiving(self, error: Exception) -> None:
        if is_malformed(error):
            self.report(BusFault.MALFORMED, CanFault.NOT_A_CAN_FRAME, detail=str(error))
        else:
            self.report(BusFault.INTERFACE_GONE, CanFault.RECEIVE_FAILED, detail=str(error))

    def _arrival(self, at_s: float, offset_ns: int, now_ns: int) -> int:
        """offset_ns: wall clock less monotonic."""
        return min(max(int(at_s * 1e9) - offset_ns, self._empty_ns), now_ns)
