"""The few operations by which a trail reaches the disk, in one class, so that tests can make each of them fail."""

from __future__ import annotations

import errno
import fcntl
import os
import time
from pathlib import Path

FLOOR_BYTES = 512 << 20  # of the disk stay free of recordings: a trail that can't be written stops the legs
PROBE_S = 0.05  # longer than a reader's lock in `is_being_written`


class Disk:
    """Files by descriptor; every method raises OSError when the disk does."""

    def create(self, path: Path) -> int:
        """A new file, readable by its owner alone, held under a lock while open; fails when it exists."""
        return _locked(os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600))

    def open_existing(self, path: Path) -> int:
        """An existing file for writing, held under the same lock."""
        return _locked(os.open(path, os.O_RDWR | os.O_CLOEXEC))

    def check_linked(self, handle: int) -> None:
        """A deleted file goes on taking writes, and is gone with its last descriptor: no write into it is one."""
        if not os.fstat(handle).st_nlink:
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT))

    def write(self, handle: int, data: bytes, offset: int) -> int:
        """Write at an offset; returns how many bytes were taken."""
        return os.pwrite(handle, data, offset)

    def sync(self, handle: int) -> None:
        """Return when the file's data is on the medium."""
        os.fsync(handle)

    def sync_folder(self, folder: Path) -> None:
        """Return when the folder's entries are on the medium."""
        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)

    def rename(self, source: Path, target: Path) -> None:
        """Put a file in another's place at once."""
        source.replace(target)

    def close(self, handle: int) -> None:
        """Release the file and its lock."""
        os.close(handle)


def _locked(handle: int) -> int:
    """The handle with its lock; a reader that probes for a writer holds it for a moment, which is waited for."""
    until_s = time.monotonic() + PROBE_S
    while True:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            if not isinstance(error, BlockingIOError) or time.monotonic() > until_s:
                os.close(handle)
                raise
            time.sleep(PROBE_S / 50)
        else:
            return handle


def append_line(path: Path, line: bytes) -> None:
    """The whole line or none, on the medium: a full disk takes part of one, which would spoil what is appended later.

    What a loss of power has cut off stays on a line of its own.
    """
    with path.open("a+b", buffering=0) as file:
        before = file.seek(0, os.SEEK_END)
        if before and os.pread(file.fileno(), 1, before - 1) != b"\n":
            line = b"\n" + line
        try:
            whole = file.write(line) == len(line)
            os.fsync(file.fileno())
        except OSError:
            file.truncate(before)
            raise
        if not whole:
            file.truncate(before)
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def is_being_written(path: Path) -> bool:
    """Whether a writer holds the file's lock: the session is still running."""
    handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(handle)
    return False
