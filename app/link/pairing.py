"""Pairing by a short code: SPAKE2 (RFC 9382), so that a guess costs an exchange and an eavesdropper learns nothing.

The exoskeleton's computer shows the code, the laptop's user types it. It is good for one pairing, three exchanges and
five minutes. Each side then knows the other's CURVE key.
"""

from __future__ import annotations

import secrets
from contextlib import closing
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import msgspec
from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import ChaCha20Poly1305
from msgspec import Struct
from spake2 import SPAKE2_A, SPAKE2_B, SPAKEError
from spake2.ed25519_basic import NotOnCurve

from app.link.keys import Peer, add_peer, own_key, own_name, write_private
from app.link.questions import Asking, PairAnswer, PairBegin, PairConfirm, PairDone, PairRefused
from app.link.wire import LinkFault
from app.system.diagnostics_log import get_logger
from app.system.errors import AppError
from app.system.paths import Home
from logs.reading.errors import UNDECODABLE, CodedError, InputError
from logs.reading.formats import read_json

_log = get_logger("link")

CODE_DIGITS = 8
LASTS_S = 300.0
CONFIRM_S = 3.0  # an exchange ends within it
EXCHANGES = 3  # a guess succeeds once in 33 million codes
_LAPTOP, _JOINTS = b"rleex laptop", b"rleex joints"
_MALFORMED = (SPAKEError, NotOnCurve, AssertionError, ValueError)  # whatever spake2 finds wrong with the other half
_FROM_LAPTOP, _FROM_JOINTS = bytes(12), bytes(11) + b"\1"  # nonces: the key is used once in each direction


class Offer(Struct, frozen=True, kw_only=True):
    """A code that is good for one pairing. Its file is the exoskeleton's computer's, 0600."""

    code: str
    expires_s: float  # wall clock: it may be shown by another process than the one that answers
    left: int = EXCHANGES


class _Identity(Struct, frozen=True, kw_only=True):
    name: str
    public: str


def new_code() -> str:
    """Eight digits, shown as 1234-5678."""
    digits = f"{secrets.randbelow(10**CODE_DIGITS):0{CODE_DIGITS}d}"
    return f"{digits[:4]}-{digits[4:]}"


def normalized(code: str) -> str:
    """The digits of a code as typed. Raises AppError when it can't be one."""
    digits = code.replace("-", "").replace(" ", "")
    if len(digits) != CODE_DIGITS or not (digits.isascii() and digits.isdigit()):
        raise AppError(LinkFault.CODE_MALFORMED)
    return digits


def offer_path(home: Home) -> Path:
    """Where the offer lies while it is good."""
    return home.link_keys / "offer.json"


def write_offer(home: Home, offer: Offer) -> None:
    """Show it to the process that answers."""
    write_private(offer_path(home), offer)


def read_offer(home: Home, now_s: float) -> Offer | None:
    """The offer that is good now."""
    try:
        offer = read_json(offer_path(home), Offer)
    except (OSError, InputError):
        return None
    return offer if now_s < offer.expires_s else None


@dataclass(slots=True)
class _Exchange:
    begin: PairBegin
    answer: PairAnswer
    key: bytes
    end: PairDone | PairRefused | None = None


class PairingDesk:
    """The exoskeleton's computer's side; it keeps the newest exchange, since its packets may come twice."""

    def __init__(self, home: Home) -> None:
        self._home = home
        self._newest: _Exchange | None = None

    def answer(self, question: PairBegin | PairConfirm, now_s: float) -> PairAnswer | PairDone | PairRefused:
        """A refusal, too, where keys or offer can't be read or kept: no reason to end a session."""
        try:
            return self.begin(question, now_s) if isinstance(question, PairBegin) else self.confirm(question, now_s)
        except (CodedError, OSError) as error:
            _log.warning("pairing failed", why=str(error))
            return PairRefused(exchange=question.exchange, left=None)

    def begin(self, question: PairBegin, now_s: float) -> PairAnswer | PairRefused:
        """Every exchange costs one of the code's, whatever becomes of it."""
        known = self._newest
        if known is not None and known.begin == question:
            return known.answer
        offer = read_offer(self._home, now_s)
        if offer is None or offer.left <= 0:
            return PairRefused(exchange=question.exchange, left=None if offer is None else 0)
        write_offer(self._home, msgspec.structs.replace(offer, left=offer.left - 1))
        side = SPAKE2_B(normalized(offer.code).encode(), idA=_LAPTOP, idB=_JOINTS)
        try:
            answer = PairAnswer(exchange=question.exchange, message=side.start())
            key = side.finish(question.message)
        except _MALFORMED:
            return PairRefused(exchange=question.exchange, left=offer.left - 1)
        self._newest = _Exchange(question, answer, key)
        return answer

    def confirm(self, question: PairConfirm, now_s: float) -> PairDone | PairRefused:
        """The laptop shows that it knows the code; then, and not before, it learns that we do."""
        known = self._newest
        if known is None or known.begin.exchange != question.exchange:
            return PairRefused(exchange=question.exchange, left=None)
        if known.end is None:
            known.end = self._end(known, question, now_s)
        return known.end

    def _end(self, known: _Exchange, question: PairConfirm, now_s: float) -> PairDone | PairRefused:
        offer = read_offer(self._home, now_s)
        if offer is None:
            return PairRefused(exchange=question.exchange, left=None)
        laptop = _opened(known.key, _FROM_LAPTOP, question.sealed, question.exchange)
        if laptop is None:
            return PairRefused(exchange=question.exchange, left=offer.left)
        add_peer(self._home, Peer(name=laptop.name, public=laptop.public, paired_at=_stamp(now_s)))
        offer_path(self._home).unlink(missing_ok=True)
        us = _Identity(name=own_name(), public=own_key(self._home).public)
        return PairDone(exchange=question.exchange, sealed=_sealed(known.key, _FROM_JOINTS, us, question.exchange))


def pair(home: Home, host: str, code: str, now_s: float) -> Peer:
    """The laptop's side, to its end. Raises AppError: nobody answers, no code is shown, a wrong or used-up one."""
    side = SPAKE2_A(normalized(code).encode(), idA=_LAPTOP, idB=_JOINTS)
    exchange = secrets.token_bytes(16)
    with closing(Asking(host)) as asking:
        answer = asking.ask(PairBegin(exchange=exchange, message=side.start()))
        if not isinstance(answer, PairAnswer):
            raise _refusal(host, answer)
        key = _key(side, answer.message)
        us = _Identity(name=own_name(), public=own_key(home).public)
        done = asking.ask(PairConfirm(exchange=exchange, sealed=_sealed(key, _FROM_LAPTOP, us, exchange)))
    joints = _opened(key, _FROM_JOINTS, done.sealed, exchange) if isinstance(done, PairDone) else None
    if joints is None:
        raise _refusal(host, done)
    peer = Peer(name=joints.name, public=joints.public, paired_at=_stamp(now_s), host=host)
    add_peer(home, peer)
    return peer


def _key(side: SPAKE2_A, message: bytes) -> bytes:
    try:
        return bytes(side.finish(message))
    except _MALFORMED as error:
        raise AppError(LinkFault.CODE_USED_UP) from error


def _refusal(host: str, answer: object) -> AppError:
    if isinstance(answer, PairRefused) and answer.left is None:
        return AppError(LinkFault.NO_CODE, host=host)
    left = answer.left if isinstance(answer, PairRefused) else 0
    return AppError(LinkFault.CODE_WRONG, left=left) if left else AppError(LinkFault.CODE_USED_UP)


def _sealed(key: bytes, nonce: bytes, identity: _Identity, exchange: bytes) -> bytes:
    return ChaCha20Poly1305(key).encrypt(nonce, msgspec.msgpack.encode(identity), exchange)


def _opened(key: bytes, nonce: bytes, sealed: bytes, exchange: bytes) -> _Identity | None:
    try:
        return msgspec.msgpack.decode(ChaCha20Poly1305(key).decrypt(nonce, sealed, exchange), type=_Identity)
    except (InvalidTag, *UNDECODABLE):
        return None


def _stamp(now_s: float) -> str:
    return datetime.fromtimestamp(now_s, UTC).isoformat(timespec="seconds")
