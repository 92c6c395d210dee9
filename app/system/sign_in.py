"""Signing in by name and PIN: attempts cost time after wrong ones, and too many lock a name.

Pure but for `try_pin`: a store goes in, a changed store comes out, time is an argument.
"""

from __future__ import annotations

from contextlib import nullcontext, suppress
from pathlib import Path

from msgspec import Struct
from msgspec.structs import replace

from app.system.errors import AppError
from app.system.operators import Operator, OperatorFault, OperatorStore, load_store, pin_matches, save_store, store_held

FREE_FAILURES = 2  # typing errors
LONGEST_WAIT_S = 300.0
LOCKS_AFTER = 12  # wrong PINs in a row; with the waits that is more than half an hour of trying
# Hashed with the same cost as everybody's, so that a stranger's name is not betrayed by a quick answer.
_STRANGER_HASH = "$argon2id$v=19$m=65536,t=3,p=4$AAAAAAAAAAAAAAAAAAAAAA$AAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA"


class SignInResult(Struct, frozen=True, kw_only=True):
    """What a sign-in gave; `store` is to be saved where it differs."""

    store: OperatorStore
    operator: Operator | None
    fault: OperatorFault | None = None  # why it was refused
    failures: int = 0
    wait_s: float = 0.0  # until the next attempt is checked


def sign_in(store: OperatorStore, name: str, pin: str, now_s: float) -> SignInResult:
    """Try a name and a PIN at a wall-clock time in seconds. A name that doesn't exist costs the same time.

    Too many wrong PINs lock a name (`is_locked`); names that don't exist only wait, since nobody could open them.
    """
    operator = store.find(name)
    wait_s = (operator.wait_until_s if operator else store.stranger_wait_until_s) - now_s
    if wait_s > LONGEST_WAIT_S:  # never given: the clock has been set back, which must lock nobody out for years
        wait_s = 0.0
    failures = operator.failures if operator else store.stranger_failures
    if operator is not None and is_locked(store, operator):
        return SignInResult(store=store, operator=None, fault=OperatorFault.LOCKED, failures=failures)
    if wait_s > 0:
        fault = OperatorFault.TOO_MANY_ATTEMPTS
        return SignInResult(store=store, operator=None, fault=fault, failures=failures, wait_s=wait_s)
    right = pin_matches(operator.pin_hash if operator else _STRANGER_HASH, pin)
    if operator is not None and operator.enabled and right:
        fresh = replace(operator, failures=0, wait_until_s=0.0)
        store = replace(store, stranger_failures=0, stranger_wait_until_s=0.0)
        return SignInResult(store=store.replacing(fresh), operator=fresh)
    return _failed(store, operator, failures + 1, now_s)


def is_locked(store: OperatorStore, operator: Operator) -> bool:
    """Whether it takes another PIN, given by an engineer, to let them in again; the last engineer only waits."""
    return operator.failures >= LOCKS_AFTER and not store.is_last_engineer(operator)


def wait_after(failures: int) -> float:
    """Seconds before the next attempt: none for typing errors, then doubling to five minutes."""
    return 0.0 if failures <= FREE_FAILURES else min(2.0 ** min(failures - FREE_FAILURES, 20), LONGEST_WAIT_S)


def try_pin(folder: Path, name: str, pin: str, now_s: float) -> SignInResult:
    """`sign_in` with the operators kept in a key folder, and the outcome kept: wrong PINs count over restarts.

    Raises AppError when they can't be read, or a wrong PIN can't be counted. The right one needs no disk: a full one
    must keep nobody from legs that are held. What it forgets of earlier failures is then forgotten another time.
    """
    with store_held(folder):
        before = load_store(folder)
        result = sign_in(before, name, pin, now_s)
        if result.store != before:
            with suppress(AppError) if result.operator else nullcontext():
                save_store(folder, result.store)
    return result


def _failed(store: OperatorStore, operator: Operator | None, failures: int, now_s: float) -> SignInResult:
    wait_s = wait_after(failures)
    until_s = now_s + wait_s if wait_s else 0.0
    if operator is None:
        changed = replace(store, stranger_failures=failures, stranger_wait_until_s=until_s)
    else:
        changed = store.replacing(replace(operator, failures=failures, wait_until_s=until_s))
    return SignInResult(
        store=changed, operator=None, fault=OperatorFault.WRONG_NAME_OR_PIN, failures=failures, wait_s=wait_s
    )
