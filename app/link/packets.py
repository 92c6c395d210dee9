"""Packets of the link's own socket (UDP): sealed with the session's key, each number once, nothing else gets through.

A packet is a kind, the connection, its number, and the sealed rest (ChaCha20-Poly1305, RFC 8439): the number and the
direction are the nonce, and the head is authenticated. Others than sealed ones are those of `questions`.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field

import msgspec
from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import ChaCha20Poly1305

from app.link.wire import Packet
from logs.reading.errors import UNDECODABLE

SEALED = 1
MAX_BYTES = 1200  # one Ethernet frame with room for tunnels
_HEAD = struct.Struct("!BIQ")
_TO_JOINTS, _TO_LAPTOP = b"\0\0\0\1", b"\0\0\0\2"


def new_packet_key() -> bytes:
    """32 bytes."""
    return ChaCha20Poly1305.generate_key()


@dataclass(slots=True)
class PacketSeal:
    """One end of a session's packets."""

    connection: int
    key: bytes
    at_joints: bool
    newest: int = 0  # number that came
    _cipher: ChaCha20Poly1305 = field(init=False)
    _encode: msgspec.msgpack.Encoder = field(default_factory=msgspec.msgpack.Encoder)
    _decode: msgspec.msgpack.Decoder[Packet] = field(default_factory=lambda: msgspec.msgpack.Decoder(Packet))

    def __post_init__(self) -> None:
        self._cipher = ChaCha20Poly1305(self.key)

    def seal(self, packet: Packet) -> bytes:
        """As it is sent; a number must never be used twice."""
        head = _HEAD.pack(SEALED, self.connection, packet.number)
        nonce = (_TO_LAPTOP if self.at_joints else _TO_JOINTS) + head[-8:]
        return head + self._cipher.encrypt(nonce, self._encode.encode(packet), head)

    def open(self, datagram: bytes) -> Packet | None:
        """The packet, once; None for everything else: another connection, an older or repeated number, a forged one."""
        if len(datagram) <= _HEAD.size or len(datagram) > MAX_BYTES:
            return None
        kind, connection, number = _HEAD.unpack_from(datagram)
        if kind != SEALED or connection != self.connection or number <= self.newest:
            return None
        head = datagram[: _HEAD.size]
        nonce = (_TO_JOINTS if self.at_joints else _TO_LAPTOP) + head[-8:]
        try:
            packet = self._decode.decode(self._cipher.decrypt(nonce, datagram[_HEAD.size :], head))
        except (InvalidTag, *UNDECODABLE):
            return None
        if packet.number != number:
            return None
        self.newest = number
        return packet

    def is_late(self, datagram: bytes) -> bool:
        """Whether a packet that was not taken may be one that others have overtaken: no sign of a foreign peer."""
        if len(datagram) <= _HEAD.size:
            return False
        kind, connection, number = _HEAD.unpack_from(datagram)
        return bool(kind == SEALED and connection == self.connection and number <= self.newest)
