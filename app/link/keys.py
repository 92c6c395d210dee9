"""This computer's key for the link and the computers that it is paired with, in `keys/link` of the home, 0600."""

from __future__ import annotations

import hashlib
import platform
from pathlib import Path
from typing import TypeVar

import msgspec
import zmq
from msgspec import Struct

from app.link.wire import LinkFault, split_address
from app.system.errors import AppError
from app.system.paths import Home
from logs.disk import Disk
from logs.keys import replace_file
from logs.reading.errors import InputError
from logs.reading.formats import read_json

_S = TypeVar("_S", bound=Struct)
_KEY, PEERS = "key.json", "peers.json"


class KeyPair(Struct, frozen=True, kw_only=True):
    """A CURVE key pair, Z85; never printed."""

    public: str
    secret: str

    def __repr__(self) -> str:
        return f"KeyPair({self.public})"


class Peer(Struct, frozen=True, kw_only=True):
    """A computer that this one is paired with."""

    name: str
    public: str  # its CURVE key, Z85
    paired_at: str  # ISO 8601, UTC
    host: str = ""  # where it answers; empty: a laptop, which asks

    @property
    def fingerprint(self) -> str:
        """Of its key, hexadecimal: it tells computers of one name apart, and any shell takes it as it is typed."""
        return hashlib.sha256(self.public.encode()).hexdigest()[:8]


class _Peers(Struct, frozen=True, kw_only=True):
    peers: tuple[Peer, ...] = ()


def own_name() -> str:
    """As the other computer lists this one."""
    return platform.node()[:64] or "?"


def own_key(home: Home) -> KeyPair:
    """This computer's key pair, made at the first call. Raises AppError."""
    path = home.link_keys / _KEY
    if not path.exists():
        public, secret = zmq.curve_keypair()
        write_private(path, KeyPair(public=public.decode(), secret=secret.decode()))
    return _read(path, KeyPair)


def peers_of(home: Home) -> tuple[Peer, ...]:
    """Every computer that this one is paired with. Raises AppError."""
    path = home.link_keys / PEERS
    return _read(path, _Peers).peers if path.exists() else ()


def joints_at(home: Home, host: str) -> Peer | None:
    """The paired exoskeleton's computer at this address. Raises AppError."""
    return next((peer for peer in peers_of(home) if _is_at(peer, host)), None)


def add_peer(home: Home, peer: Peer) -> None:
    """Keep it, in place of an earlier pairing with the same computer. Raises AppError."""
    others = tuple(
        one for one in peers_of(home) if one.public != peer.public and not (peer.host and _is_at(one, peer.host))
    )
    write_private(home.link_keys / PEERS, _Peers(peers=(*others, peer)))


def forget_peer(home: Home, name: str) -> Peer:
    """Forget a computer by name, address or its key's fingerprint: its next connection is refused. Raises AppError."""
    known = peers_of(home)
    found = [one for one in known if name in {one.name, one.host, one.fingerprint}]
    if len(found) != 1:
        raise AppError(LinkFault.AMBIGUOUS_PEER if found else LinkFault.NO_SUCH_PEER, name=name)
    (gone,) = found
    write_private(home.link_keys / PEERS, _Peers(peers=tuple(one for one in known if one is not gone)))
    return gone


def _is_at(peer: Peer, host: str) -> bool:
    """Whether both are one address, however they are written; a laptop has none."""
    return bool(peer.host) and split_address(peer.host) == split_address(host)


def write_private(path: Path, value: Struct) -> None:
    """Put a value in the place of an older one, 0600; its folder and the one above are made 0700. Raises OSError."""
    for folder in (path.parent.parent, path.parent):  # `parents` gives the mode to the last one alone
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    replace_file(path, msgspec.json.encode(value), Disk())


def _read(path: Path, kind: type[_S]) -> _S:
    try:
        if path.stat().st_mode & 0o077:
            path.chmod(0o600)
        return read_json(path, kind)
    except (OSError, InputError) as error:
        raise AppError(LinkFault.KEYS_DAMAGED, path=path) from error
