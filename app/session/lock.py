"""One console a home: two would fight for the camera, the drives and the audit trail."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from enum import Enum

from app.system.errors import AppError
from app.system.paths import Home


class LockFault(Enum):
    """Why a home can't be held."""

    UNUSABLE = "unusable"
    HELD = "held"


@contextmanager
def hold_home(home: Home) -> Iterator[None]:
    """Hold the home's lock while the body runs. Raises AppError when another console holds it.

    The kernel drops the lock with the process, however it ends; the file itself may stay.
    """
    try:
        home.root.mkdir(parents=True, exist_ok=True)
        handle = os.open(home.lock, os.O_RDWR | os.O_CREAT, 0o600)
    except OSError as error:
        raise AppError(LockFault.UNUSABLE, home=home.root, detail=error.strerror) from error
    try:
        _take(handle, home)
        os.ftruncate(handle, 0)
        os.write(handle, f"{os.getpid()}\n".encode())
        yield
    finally:
        os.close(handle)


def _take(handle: int, home: Home) -> None:
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        holder = os.pread(handle, 32, 0).decode(errors="replace").strip() or "?"
        raise AppError(LockFault.HELD, pid=holder, home=home.root) from None
