"""One record as one line: canonical JSON, sealed with its own SHA-256 as the last field.

Canonical means: keys sorted, no white space, UTF-8, shortest decimal that reads back as the same number. The hash
covers those bytes as they stand without `,"hash":"…"`, so that `sed` and `sha256sum` alone can check a line.
"""

from __future__ import annotations

import re
from datetime import UTC, datetime
from functools import lru_cache
from hashlib import sha256

import msgspec

from logs.records import Payload

GENESIS = "0" * 64  # `previous` of a file's first record
MAX_LINE = 1 << 20  # bytes; no record comes near; a reader never loads more at once
SIGNED_KINDS = ("checkpoint", "log-opened", "log-closed", "log-recovered", "comment")

_SEAL = b',"hash":"'
SEAL_LENGTH = len(_SEAL) + 64 + len('"}\n')
_SIGNATURE = re.compile(rb'"signature":"[0-9a-f]*"')


_encode = msgspec.json.Encoder(order="sorted").encode


def canonical(payload: Payload) -> bytes:
    """The bytes that the hash covers."""
    return _encode(payload)


def seal(payload: bytes) -> tuple[bytes, str]:
    """The line with its hash and line end, and the hash."""
    digest = sha256(payload).hexdigest()
    return b"%s%s%s%s" % (payload[:-1], _SEAL, digest.encode(), b'"}\n'), digest


def unseal(line: bytes) -> tuple[bytes, str] | None:
    """The hashed bytes of a complete line and the hash that it claims; None when it has no such shape."""
    cut = len(line) - SEAL_LENGTH
    if cut < 1 or line[cut : cut + len(_SEAL)] != _SEAL or line[-3:] != b'"}\n':
        return None
    return line[:cut] + b"}", line[cut + len(_SEAL) : -3].decode("ascii", "replace")


def is_whole(line: bytes) -> bool:
    """Whether a line is complete and its content matches its hash."""
    parts = unseal(line)
    return parts is not None and sha256(parts[0]).hexdigest() == parts[1]


def signed_message(payload: bytes) -> bytes:
    """What a signature in a record covers: the hashed bytes with the signature itself left empty.

    Quotes within text are escaped in JSON, so nothing but the field itself can match.
    """
    return _SIGNATURE.sub(b'"signature":""', payload, count=1)


def wall_text(wall_ns: int) -> str:
    """UTC as ISO 8601 with microseconds."""
    seconds, rest = divmod(wall_ns, 1_000_000_000)
    return f"{_second(seconds)}.{rest // 1000:06d}Z"


@lru_cache(maxsize=4)
def _second(seconds: int) -> str:
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%dT%H:%M:%S")
