"""The data directory: one home, chosen by --home, RLEEX_HOME, or the platform's; its lock lets in one console.

Two consoles would fight for the camera, the drives and the audit trail.
"""

from __future__ import annotations

import fcntl
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

import platformdirs

from app.system.errors import AppError
from app.system.files import open_lock
from logs.reading.errors import cause_of
from logs.reading.regular import path_named, text_of

RECORDING_SUFFIX = ".mcap"
PICTURES_SUFFIX = ".pictures.mcap"


@dataclass(frozen=True, slots=True)
class Home:
    """The data directory and what lies in it."""

    root: Path

    @property
    def config(self) -> Path:
        """The configuration file."""
        return self.root / "config.toml"

    @property
    def cameras(self) -> Path:
        """Measured intrinsics, by camera."""
        return self.root / "cameras.toml"

    @property
    def profiles(self) -> Path:
        """Patient profiles, one TOML each."""
        return self.root / "profiles"

    @property
    def logs(self) -> Path:
        """Audit trails, one JSON Lines file a session, and the manifest that chains them."""
        return self.root / "logs"

    @property
    def outcomes(self) -> Path:
        """Outcome measures of sessions as they were measured last; may be deleted."""
        return self.root / "outcomes"

    @property
    def models(self) -> Path:
        """The hand model."""
        return self.root / "models"

    @property
    def keys(self) -> Path:
        """Signing key, operators; 0700."""
        return self.root / "keys"

    @property
    def link_keys(self) -> Path:
        """This computer's key for the link, and the computers that it is paired with; 0700."""
        return self.keys / "link"

    @property
    def lock(self) -> Path:
        """Held by the one console of this home."""
        return self.root / "console.lock"

    @property
    def session_file(self) -> Path:
        """Where other terminals find the running session; 0600."""
        return self.root / "session.msgpack"

    @property
    def legs_lock(self) -> Path:
        """Held by every process that may command or damp the legs (`app/system/legs_lock.py`)."""
        return self.root / "legs.lock"


def recording_path(folder: Path, session: str) -> Path:
    """Where a session's recording lies: beside its trail."""
    return folder / f"{session}{RECORDING_SUFFIX}"


def pictures_path(folder: Path, session: str) -> Path:
    """Where the camera's pictures of a session lie, if the patient agreed to them."""
    return folder / f"{session}{PICTURES_SUFFIX}"


def find_home(given: Path | None = None) -> Home:
    """The home: the one given, else RLEEX_HOME, else the platform's data directory. Makes nothing.

    Raises AppError when it is there and no folder, or its name is not UTF-8: sessions are told it as text.
    """
    chosen = given or os.environ.get("RLEEX_HOME") or platformdirs.user_data_dir("rleex")
    try:
        root = path_named(chosen)
        text_of(os.fsencode(root))
        is_folder = stat.S_ISDIR(root.stat().st_mode)
    except FileNotFoundError:
        is_folder = True  # it is made when first written to
    except (OSError, ValueError, RuntimeError) as error:  # not allowed, NUL in the name, no such user
        raise AppError(LockFault.UNUSABLE, home=chosen, detail=cause_of(error)) from error
    if not is_folder:
        raise AppError(LockFault.NO_FOLDER, home=root)
    return Home(root)


class LockFault(Enum):
    """Why a home can't be held."""

    UNUSABLE = "unusable"
    HELD = "held"
    LEGS_HELD = "legs held"
    NO_FOLDER = "no folder"


@contextmanager
def hold_home(home: Home) -> Iterator[None]:
    """Hold the home's lock while the body runs. Raises AppError when another console holds it.

    The kernel drops the lock with the process, however it ends; the file itself may stay.
    """
    try:
        home.root.mkdir(parents=True, exist_ok=True)
        handle = open_lock(home.lock)
    except OSError as error:
        raise AppError(LockFault.UNUSABLE, home=home.root, detail=error.strerror) from error
    try:
        _take(handle, home)
        with suppress(OSError):  # only told to the next one: a disk that takes no byte keeps nobody from held legs
            os.ftruncate(handle, os.write(handle, f"{os.getpid()}\n".encode()))
        yield
    finally:
        os.close(handle)


def is_held(home: Home) -> bool:
    """Whether another process holds the home's lock. Raises AppError where the lock can't be used."""
    try:
        with hold_home(home):
            return False
    except AppError as error:
        if error.code is LockFault.HELD:
            return True
        raise


def _take(handle: int, home: Home) -> None:
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        holder = os.pread(handle, 32, 0).decode(errors="replace").strip() or "?"
        raise AppError(LockFault.HELD, pid=holder, home=home.root) from None
    except OSError as error:
        raise AppError(LockFault.UNUSABLE, home=home.root, detail=error.strerror) from error
