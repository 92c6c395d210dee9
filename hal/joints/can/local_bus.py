"""A CAN bus between the programs of one machine, for kernels without vcan: SocketCAN's own 16-byte frames in UDP.

Interface `local`, channel a UDP port. python-can's `udp_multicast` does the same for several machines, but packs every
frame into a dictionary, gives senders their own frames back, and refuses bursts (EAGAIN).
Frames go to a multicast group on the loopback device; the kernel drops a sender's own and stamps what arrives. One
datagram carries one frame or several: a tick's frames sent together wake each receiver once.
"""

from __future__ import annotations

import ctypes
import select
import socket
import struct
from collections import deque
from collections.abc import Sequence

import can

from hal.joints.codecs.wire import Frame

GROUP = "239.74.163.2"  # administratively scoped (RFC 2365)
_LOOPBACK = "127.0.0.1"
_FRAME = struct.Struct("=IB3x8s")  # struct can_frame, linux/can.h
_LENGTH = 4  # where in the frame its payload's length stands
_STAMP = struct.Struct("@ll")  # struct timespec
_SO_TIMESTAMPNS = 35  # asm-generic/socket.h
_SO_ATTACH_FILTER = 26
_ANCILLARY = socket.CMSG_SPACE(_STAMP.size)
_EXTENDED, _REMOTE, _ERROR = 0x8000_0000, 0x4000_0000, 0x2000_0000  # linux/can.h
_IDENTIFIER = 0x1FFF_FFFF
_FRAMES_AT_MOST = 64  # in a datagram


class LocalBus(can.BusABC):
    """One program's end of the bus."""

    def __init__(self, channel: str, **_options: object) -> None:
        """Raises ValueError when the channel is no port, OSError when the sockets can't be made."""
        port = int(channel)
        if not 1024 <= port <= 65_535:
            raise ValueError(f"channel {channel} is no UDP port from 1024 to 65535")
        super().__init__(channel)
        self.channel_info = f"local:{port}"
        self._arrived: deque[tuple[bytes, float]] = deque()  # frames of a datagram that `recv` gives one by one
        self._out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._in = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._join(port)
        except OSError:
            self.shutdown()
            raise
        self._poll = select.poll()
        self._poll.register(self._in, select.POLLIN)

    def _join(self, port: int) -> None:
        here = socket.inet_aton(_LOOPBACK)
        self._out.bind((_LOOPBACK, 0))
        self._out.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, here)
        self._out.connect((GROUP, port))
        self._out.setblocking(False)
        self._in.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._in.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
        _refuse_from(self._in, self._out.getsockname()[1])
        self._in.bind((GROUP, port))
        self._in.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, socket.inet_aton(GROUP) + here)
        self._in.setblocking(False)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:  # noqa: ARG002 (UDP never waits)
        """Hand a classic frame to all others. Raises CanOperationError when the kernel does not take it."""
        if msg.is_fd:
            raise can.CanOperationError("the local bus carries classic frames only")
        identifier = msg.arbitration_id
        if msg.is_extended_id:
            identifier |= _EXTENDED
        if msg.is_error_frame:
            identifier |= _ERROR
        elif msg.is_remote_frame:
            identifier |= _REMOTE
        self._put(_FRAME.pack(identifier, msg.dlc, msg.data))

    def send_frames(self, frames: Sequence[Frame]) -> None:
        """Hand data frames to all others, together. Raises CanOperationError when the kernel does not take them."""
        for first in range(0, len(frames), _FRAMES_AT_MOST):
            self._put(b"".join(map(_pack, frames[first : first + _FRAMES_AT_MOST])))

    def receive_frames(self, timeout_s: float) -> list[tuple[Frame | can.Message, float]] | None:
        """What came together, each frame with its time of arrival (wall clock, s); None when nothing came in time.

        Data frames as such, others as messages. Raises CanOperationError as `recv` does.
        """
        if not self._arrived and not self._fetch(timeout_s):
            return None
        frames = [(_frame_of(raw, at_s), at_s) for raw, at_s in self._arrived]
        self._arrived.clear()
        return frames

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        """Raises CanOperationError for a datagram that is no frame, and when the socket is gone."""
        if not self._arrived and not self._fetch(timeout):
            return None, True
        return _message_of(*self._arrived.popleft()), True

    def _put(self, data: bytes) -> None:
        try:
            self._out.send(data)
        except OSError as error:
            raise can.CanOperationError(f"the local bus does not take the frame: {error}", error.errno) from error

    def _fetch(self, timeout: float | None) -> bool:
        """Take in the next datagram; whether one came."""
        try:
            if timeout != 0 and not self._poll.poll(None if timeout is None else timeout * 1e3):
                return False
            data, ancillary, flags, _ = self._in.recvmsg(_FRAMES_AT_MOST * _FRAME.size, _ANCILLARY)
        except BlockingIOError:
            return False
        except OSError as error:
            raise can.CanOperationError(f"the local bus can't be read: {error}", error.errno) from error
        whole = data and len(data) % _FRAME.size == 0 and not flags & socket.MSG_TRUNC
        if not whole or max(data[_LENGTH :: _FRAME.size]) > 8:
            raise can.CanOperationError("a datagram that is no CAN frame") from ValueError(data)
        seconds, nanoseconds = _STAMP.unpack(ancillary[0][2])
        at_s = seconds + nanoseconds * 1e-9
        self._arrived.extend((data[at : at + _FRAME.size], at_s) for at in range(0, len(data), _FRAME.size))
        return True

    def fileno(self) -> int:
        """Of the receiving socket."""
        return self._in.fileno()

    def shutdown(self) -> None:
        """Leave the bus."""
        super().shutdown()
        self._in.close()
        self._out.close()


def _pack(frame: Frame) -> bytes:
    identifier, data, extended = frame
    return _FRAME.pack(identifier | _EXTENDED if extended else identifier, len(data), data)


def _frame_of(raw: bytes, at_s: float) -> Frame | can.Message:
    identifier, length, payload = _FRAME.unpack(raw)
    if identifier & (_REMOTE | _ERROR):
        return _message_of(raw, at_s)
    return Frame(identifier & _IDENTIFIER, payload[:length], bool(identifier & _EXTENDED))


def _message_of(data: bytes, at_s: float) -> can.Message:
    identifier, length, payload = _FRAME.unpack(data)
    remote = bool(identifier & _REMOTE)
    return can.Message(
        at_s,
        identifier & _IDENTIFIER,
        bool(identifier & _EXTENDED),
        remote,
        bool(identifier & _ERROR),
        dlc=length,
        data=None if remote else payload[:length],
    )


def _refuse_from(receiver: socket.socket, source_port: int) -> None:
    """A kernel filter that drops what comes from this port: a sender needs no echo (linux/filter.h, classic BPF)."""
    load_half, equal, end = 0x28, 0x15, 0x06  # BPF_LD|BPF_H|BPF_ABS, BPF_JMP|BPF_JEQ|BPF_K, BPF_RET|BPF_K
    steps = ((load_half, 0, 0, 0), (equal, 0, 1, source_port), (end, 0, 0, 0), (end, 0, 0, 0xFFFF))
    program = ctypes.create_string_buffer(b"".join(struct.pack("=HBBI", *step) for step in steps))
    receiver.setsockopt(socket.SOL_SOCKET, _SO_ATTACH_FILTER, struct.pack("@HP", len(steps), ctypes.addressof(program)))
