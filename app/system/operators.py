"""Who may use the console: names, roles and PINs, and the one table of what each role may do.

Pure: a store goes in, a changed store comes out. Only `load_store`, `save_store` and `store_held` touch the disk. There
is no default PIN; the first operator of a home is an engineer whom the first run sets up. Simulation and training need
no sign-in.
"""

from __future__ import annotations

import fcntl
import os
import unicodedata
from collections.abc import Iterator
from contextlib import contextmanager
from enum import Enum
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
from msgspec import Struct
from msgspec.structs import replace

from app.system.config import Config
from app.system.errors import AppError
from app.system.files import open_lock
from logs.reading.errors import cause_of
from logs.reading.formats import read_json

if TYPE_CHECKING:
    import argon2

STORE_FILE = "operators.json"
LOCK_FILE = "operators.lock"


class Role(Enum):
    """What an operator is to the device."""

    THERAPIST = "therapist"
    ENGINEER = "engineer"
    REVIEWER = "reviewer"


class Permission(Enum):
    """What can be allowed."""

    OPERATE = "operate"  # move a patient: arm, act, acknowledge, torque off
    EDIT_PATIENTS = "edit patients"  # create and change patients
    CALIBRATE = "calibrate"  # camera and palm
    CONFIGURE = "configure"  # change the configuration, scan and zero the drives
    MANAGE_OPERATORS = "manage operators"  # add and disable operators
    REVIEW = "review"  # read, comment and export audit trails
    WRITE_NOTES = "write notes"  # notes and ratings in a session


class OperatorFault(Enum):
    """Why an operator can't sign in, or can't be added, changed or kept."""

    WRONG_NAME_OR_PIN = "wrong name or PIN"
    TOO_MANY_ATTEMPTS = "too many attempts"
    LOCKED = "locked"
    NAME_TAKEN = "name taken"
    FIRST_NOT_ENGINEER = "first not an engineer"
    FIRST_EXISTS = "first exists"
    PIN_NEEDED = "PIN needed"
    NEVER_BY_TOKEN = "never by token"
    LAST_ENGINEER = "last engineer"
    UNKNOWN = "unknown"
    BAD_NAME = "bad name"
    BAD_PIN = "bad PIN"
    GUESSABLE_PIN = "guessable PIN"
    STORE_UNREADABLE = "store unreadable"
    STORE_NOT_SAVED = "store not saved"


# STOP stands in no table: everybody may always stop.
PERMISSIONS: dict[Role, frozenset[Permission]] = {
    Role.THERAPIST: frozenset(
        {Permission.OPERATE, Permission.EDIT_PATIENTS, Permission.CALIBRATE, Permission.WRITE_NOTES, Permission.REVIEW}
    ),
    Role.ENGINEER: frozenset(
        {
            Permission.OPERATE,
            Permission.CALIBRATE,
            Permission.CONFIGURE,
            Permission.MANAGE_OPERATORS,
            Permission.WRITE_NOTES,
            Permission.REVIEW,
        }
    ),
    Role.REVIEWER: frozenset({Permission.REVIEW}),
}


class Operator(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One person; the PIN only as its argon2 hash."""

    name: str
    role: Role
    pin_hash: str
    enabled: bool = True
    failures: int = 0  # wrong PINs since the last right one
    wait_until_s: float = 0.0  # wall clock, so that a restart shortens no wait


class OperatorStore(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Everybody, and the attempts under names that don't exist."""

    schema: int = 1
    operators: tuple[Operator, ...] = ()
    stranger_failures: int = 0
    stranger_wait_until_s: float = 0.0

    def find(self, name: str) -> Operator | None:
        """By name, whatever its case."""
        wanted = _key(name)
        return next((operator for operator in self.operators if _key(operator.name) == wanted), None)

    def replacing(self, changed: Operator) -> OperatorStore:
        """With this one in the place of who has the same name."""
        operators = tuple(changed if _key(each.name) == _key(changed.name) else each for each in self.operators)
        return replace(self, operators=operators)

    def is_last_engineer(self, operator: Operator) -> bool:
        """Whether nobody else could manage operators."""
        engineers = {_key(one.name) for one in self.operators if one.enabled and one.role is Role.ENGINEER}
        return operator.role is Role.ENGINEER and engineers <= {_key(operator.name)}


MIN_DIGITS, MAX_DIGITS = 6, 12
MAX_NAME = 60


@cache
def _hasher() -> argon2.PasswordHasher:
    """The library's defaults, RFC 9106's second recommendation. Imported when first needed, not before first paint."""
    import argon2

    return argon2.PasswordHasher()


def pin_matches(pin_hash: str, pin: str) -> bool:
    """Whether it is the hash of this PIN."""
    import argon2

    try:
        return _hasher().verify(pin_hash, pin.encode("utf-8", "replace"))
    except (argon2.exceptions.VerificationError, argon2.exceptions.InvalidHashError):
        return False


def needs_sign_in(config: Config) -> bool:
    """Whether an operator must sign in: only where drives can move."""
    return config.joints.kind != "simulated" or bool(config.joints.host)


def may_take_over(operator: Operator, owner: str) -> bool:
    """Whether they may take over the session that `owner` operates: the same person, or any therapist."""
    may_operate = Permission.OPERATE in PERMISSIONS[operator.role]
    return may_operate and (operator.name == owner or operator.role is Role.THERAPIST)


def add_operator(store: OperatorStore, name: str, role: Role, pin: str) -> OperatorStore:
    """A store with one more. Raises AppError on an unusable name or PIN, or when the first is no engineer."""
    name = _checked_name(name)
    if store.find(name) is not None:
        raise AppError(OperatorFault.NAME_TAKEN, name=name)
    if not store.operators and role is not Role.ENGINEER:
        raise AppError(OperatorFault.FIRST_NOT_ENGINEER)
    added = Operator(name=name, role=role, pin_hash=_hasher().hash(_checked_pin(pin)))
    return replace(store, operators=(*store.operators, added))


def disable_operator(store: OperatorStore, name: str) -> OperatorStore:
    """A store in which nobody can sign in by that name. Raises AppError for strangers and the last engineer."""
    operator = _existing(store, name)
    if store.is_last_engineer(operator):
        raise AppError(OperatorFault.LAST_ENGINEER, name=operator.name)
    return store.replacing(replace(operator, enabled=False))


def change_pin(store: OperatorStore, name: str, pin: str) -> OperatorStore:
    """A store with another PIN for an operator, who is enabled by it. Raises AppError."""
    operator = _existing(store, name)
    pin_hash = _hasher().hash(_checked_pin(pin))
    return store.replacing(replace(operator, pin_hash=pin_hash, enabled=True, failures=0, wait_until_s=0.0))


@contextmanager
def store_held(folder: Path) -> Iterator[None]:
    """One at a time: PINs tried side by side would all count as one. Raises AppError."""
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        handle = open_lock(folder / LOCK_FILE)
    except OSError as error:
        raise AppError(OperatorFault.STORE_NOT_SAVED, path=folder, detail=cause_of(error)) from error
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def load_store(folder: Path) -> OperatorStore:
    """The operators kept in a home's key folder; an empty store before the first run. Raises AppError."""
    path = folder / STORE_FILE
    try:
        return read_json(path, OperatorStore)
    except FileNotFoundError:
        return OperatorStore()
    except OSError as error:
        raise AppError(OperatorFault.STORE_UNREADABLE, path=path, detail=cause_of(error)) from error


def save_store(folder: Path, store: OperatorStore) -> None:
    """Replace the kept operators at once, readable by the owner alone. Raises AppError; the old ones then stay."""
    from logs.disk import Disk
    from logs.keys import replace_file  # brings cryptography

    path = folder / STORE_FILE
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        replace_file(path, msgspec.json.encode(store), Disk())
    except OSError as error:
        raise AppError(OperatorFault.STORE_NOT_SAVED, path=path, detail=error.strerror) from error


def _existing(store: OperatorStore, name: str) -> Operator:
    operator = store.find(name)
    if operator is None:
        raise AppError(OperatorFault.UNKNOWN, name=name.strip())
    return operator


def _key(name: str) -> str:
    return unicodedata.normalize("NFKC", name).strip().casefold()


def _checked_name(name: str) -> str:
    name = unicodedata.normalize("NFC", name).strip()
    if not name or len(name) > MAX_NAME or not name.isprintable():
        raise AppError(OperatorFault.BAD_NAME, longest=MAX_NAME, name=repr(name[:80]))
    return name


def _checked_pin(pin: str) -> str:
    if not (pin.isascii() and pin.isdigit() and MIN_DIGITS <= len(pin) <= MAX_DIGITS):
        raise AppError(OperatorFault.BAD_PIN, least=MIN_DIGITS, most=MAX_DIGITS)
    steps = {int(after) - int(before) for before, after in pairwise(pin)}
    if len(steps) == 1 and steps <= {-1, 0, 1}:
        raise AppError(OperatorFault.GUESSABLE_PIN)
    return pin
