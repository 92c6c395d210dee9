"""Changes of operators, each by an authority that may make it and on record before it is made; and scripts' tokens."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from enum import Enum
from hashlib import sha256
from pathlib import Path
from typing import Any

import msgspec
from msgspec import Struct

from app.system.authority import Authority, Proof, Subject, of_operator
from app.system.errors import AppError
from app.system.operators import (
    Operator,
    OperatorFault,
    OperatorStore,
    Permission,
    Role,
    add_operator,
    change_pin,
    disable_operator,
    load_store,
    save_store,
    store_held,
)
from app.system.paths import Home
from logs.line import wall_text
from logs.reading.errors import cause_of
from logs.reading.formats import decode_json
from logs.reading.regular import open_regular
from logs.reason import reason


class OperatorChange(Enum):
    """What was done to an operator."""

    ADDED = "added"
    DISABLED = "disabled"
    PIN_CHANGED = "pin_changed"
    TOKEN_ISSUED = "token_issued"


def enrol_first(home: Home, name: str, pin: str) -> Authority:
    """The first operator of a home, an engineer, signed in by that. Raises AppError where there is one already."""
    with store_held(home.keys):
        if load_store(home.keys).operators:
            raise AppError(OperatorFault.FIRST_EXISTS)
        changed = add_operator(OperatorStore(), name, Role.ENGINEER, pin)
        first = of_operator(home, changed.operators[-1], Proof.PIN)
        _record(first, changed.operators[-1], OperatorChange.ADDED, role=(None, Role.ENGINEER.value))
        save_store(home.keys, changed)
    return first


def enrol(by: Authority, name: str, role: Role, pin: str) -> None:
    """One more operator. Raises AppError."""
    roles = (None, role.value)
    _change(by, name, lambda store: add_operator(store, name, role, pin), OperatorChange.ADDED, role=roles)


def disable(by: Authority, name: str) -> None:
    """Nobody can sign in by that name any more. Raises AppError."""
    values = (True, False)
    _change(by, name, lambda store: disable_operator(store, name), OperatorChange.DISABLED, enabled=values)


def give_pin(by: Authority, name: str, pin: str) -> None:
    """Another PIN, which enables and unlocks. Raises AppError."""
    values = ("…", "…")
    _change(by, name, lambda store: change_pin(store, name, pin), OperatorChange.PIN_CHANGED, pin=values)


def _change(
    by: Authority,
    name: str,
    make: Callable[[OperatorStore], OperatorStore],
    what: OperatorChange,
    **values: tuple[Any, Any],
) -> None:
    by.require(Permission.MANAGE_OPERATORS)
    with store_held(by.home.keys):
        changed = make(load_store(by.home.keys))
        operator = changed.find(name)
        assert operator is not None
        _record(by, operator, what, **values)
        save_store(by.home.keys, changed)


def _record(by: Authority, operator: Operator, what: OperatorChange, **values: tuple[Any, Any]) -> None:
    by.change(Permission.MANAGE_OPERATORS, Subject.OPERATOR, operator.name, values, reason(what))


class TokenFault(Enum):
    """Why a script's token is refused. Each names its path."""

    UNREADABLE = "unreadable"  # path, detail
    EXPOSED = "exposed"  # path
    NOT_OURS = "not ours"  # path
    EXPIRED = "expired"  # path, at
    REVOKED = "revoked"  # path, name


LONGEST_HOURS = 30 * 24
NEVER_BY_TOKEN = frozenset({Permission.MANAGE_OPERATORS})
_MAX_TOKEN = 1 << 14  # bytes


class Token(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a script may do in an operator's name until it expires; void with that operator's PIN."""

    operator: str
    permissions: tuple[Permission, ...]
    expires_s: float  # wall clock
    pin_sha256: str  # of the PIN's hash
    signature: str = ""  # the console's


def issue_token(by: Authority, permissions: frozenset[Permission], hours: float) -> bytes:
    """A token for a script of the one who is signed in by PIN. Raises AppError."""
    if by.proof is not Proof.PIN:
        raise AppError(OperatorFault.PIN_NEEDED)
    for permission in permissions & NEVER_BY_TOKEN:
        raise AppError(OperatorFault.NEVER_BY_TOKEN, permission=permission)
    for permission in permissions:
        by.require(permission)
    operator = load_store(by.home.keys).find(by.name)
    if operator is None:
        raise AppError(OperatorFault.UNKNOWN, name=by.name)
    expires_s = time.time() + min(hours, LONGEST_HOURS) * 3600
    names = tuple(sorted(permissions, key=lambda one: one.value))
    from logs.keys import load_or_make_key  # brings cryptography

    token = Token(operator=operator.name, permissions=names, expires_s=expires_s, pin_sha256=_mark(operator))
    token = msgspec.structs.replace(token, signature=load_or_make_key(by.home.keys).sign(_message(token)))
    expires = wall_text(int(expires_s) * 10**9)
    values = {"token": (None, expires), "permissions": (None, [one.value for one in names])}
    by.record_own(Subject.OPERATOR, operator.name, values, reason(OperatorChange.TOKEN_ISSUED))
    return msgspec.json.encode(token)


def by_token(home: Home, path: Path, now_s: float | None = None) -> Authority:
    """Who a token file stands for. Raises AppError when it is not this console's, too old, or open to others."""
    from logs.keys import PUBLIC_FILE, load_public_key  # brings cryptography

    token = _read(path)
    if not load_public_key(home.keys / PUBLIC_FILE).verifies(token.signature, _message(token)):
        raise AppError(TokenFault.NOT_OURS, path=path)
    if (time.time() if now_s is None else now_s) >= token.expires_s:
        raise AppError(TokenFault.EXPIRED, path=path, at=wall_text(int(token.expires_s) * 10**9)[:16])
    operator = load_store(home.keys).find(token.operator)
    if operator is None or not operator.enabled or _mark(operator) != token.pin_sha256:
        raise AppError(TokenFault.REVOKED, path=path, name=token.operator)
    return of_operator(home, operator, Proof.TOKEN, frozenset(token.permissions) - NEVER_BY_TOKEN)


def _read(path: Path) -> Token:
    try:
        with open_regular(path) as file:
            if os.fstat(file.fileno()).st_mode & 0o077:
                raise AppError(TokenFault.EXPOSED, path=path)
            return decode_json(file.read(_MAX_TOKEN), Token)
    except OSError as error:
        raise AppError(TokenFault.UNREADABLE, path=path, detail=cause_of(error)) from error


def _message(token: Token) -> bytes:
    return b"rleex token " + msgspec.json.encode(msgspec.structs.replace(token, signature=""), order="sorted")


def _mark(operator: Operator) -> str:
    return sha256(operator.pin_hash.encode()).hexdigest()
