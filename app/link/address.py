"""Where the exoskeleton's computer is: a name or an IPv4 address, and the one port."""

from __future__ import annotations

import re
import socket

from app.link.faults import LinkFault
from app.link.wire import PORT
from app.system.errors import AppError

_FORM = re.compile(r"(?P<host>[A-Za-z0-9]([A-Za-z0-9.-]{0,251}[A-Za-z0-9])?)(:(?P<port>[0-9]{1,5}))?")


def split_address(text: str) -> tuple[str, int]:
    """Host and port of `exo.local:7447`; without a port the usual one. Raises AppError."""
    match = _FORM.fullmatch(text)
    port = int(match["port"] or PORT) if match else 0
    if match is None or not 0 < port < 65536:
        raise AppError(LinkFault.BAD_ADDRESS, address=text)
    return match["host"], port


def resolve(text: str) -> tuple[str, int]:
    """The same with the host's IPv4 address. Raises AppError."""
    host, port = split_address(text)
    try:
        found = socket.getaddrinfo(host, port, socket.AF_INET, socket.SOCK_DGRAM)
    except OSError as error:
        raise AppError(LinkFault.UNKNOWN_HOST, host=host, detail=error.strerror or str(error)) from error
    return str(found[0][4][0]), port
