"""A CAN bus between the programs of one machine, for kernels without vcan: SocketCAN's own 16-byte frames in UDP.

Interface `local`, channel a UDP port. python-can's `udp_multicast` does the same for several machines, but packs every
frame into a dictionary, gives senders their own frames back, and refuses bursts (EAGAIN).
Frames go to a multicast group on the loopback device; the kernel drops a sender's own and stamps what arrives.
"""

from __future__ import annotations

import ctypes
import select
import socket
import struct

import can

GROUP = "239.74.163.2"  # administratively scoped (RFC 2365)
_LOOPBACK = "127.0.0.1"
_FRAME = struct.Struct("=IB3x8s")  # struct can_frame, linux/can.h
_STAMP = struct.Struct("@ll")  # struct timespec
_SO_TIMESTAMPNS = 35  # asm-generic/socket.h
_SO_ATTACH_FILTER = 26
_ANCILLARY = socket.CMSG_SPACE(_STAMP.size)
_EXTENDED, _REMOTE, _ERROR = 0x8000_0000, 0x4000_0000, 0x2000_0000  # linux/can.h
_IDENTIFIER = 0x1FFF_FFFF


class LocalBus(can.BusABC):
    """One program's end of the bus."""

    def __init__(self, channel: str, **_options: object) -> None:
        """Raises ValueError when the channel is no port, OSError when the sockets can't be made."""
        port = int(channel)
        if not 1024 <= port <= 65_535:
            raise ValueError(f"channel {channel} is no UDP port from 1024 to 65535")
        super().__init__(channel)
        self.channel_info = f"local:{port}"
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
        """Hand a classic frame to everybody else. Raises CanOperationError when the kernel does not take it."""
        if msg.is_fd:
            raise can.CanOperationError("the local bus carries classic frames only")
        identifier = msg.arbitration_id
        if msg.is_extended_id:
            identifier |= _EXTENDED
        if msg.is_error_frame:
            identifier |= _ERROR
        elif msg.is_remote_frame:
            identifier |= _REMOTE
        try:
            self._out.send(_FRAME.pack(identifier, msg.dlc, msg.data))
        except OSError as error:
            raise can.CanOperationError(f"the local bus does not take the frame: {error}", error.errno) from error

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        """Raises CanOperationError for a datagram that is no frame, and when the socket is gone."""
        try:
            if timeout != 0 and not self._poll.poll(None if timeout is None else timeout * 1e3):
                return None, True
            data, ancillary, _, _ = self._in.recvmsg(64, _ANCILLARY)
        except BlockingIOError:
            return None, True
        except OSError as error:
            raise can.CanOperationError(f"the local bus can't be read: {error}", error.errno) from error
        if len(data) != _FRAME.size or data[4] > 8:
            raise can.CanOperationError("a datagram that is no CAN frame") from ValueError(data)
        seconds, nanoseconds = _STAMP.unpack(ancillary[0][2])
        return _message_of(data, seconds + nanoseconds * 1e-9), True

    def fileno(self) -> int:
        """Of the receiving socket."""
        return self._in.fileno()

    def shutdown(self) -> None:
        """Leave the bus."""
        super().shutdown()
        self._in.close()
        self._out.close()


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
