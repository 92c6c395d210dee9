"""Files that take their name when they are whole, and files that are only locked."""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


@contextmanager
def partial_file(target: Path) -> Iterator[Path]:
    """A name beside the target, gone at the end unless it was moved there. Raises OSError."""
    partial = target.with_name(f".{target.stem}.{os.getpid()}.partial{target.suffix}")
    try:
        partial.unlink(missing_ok=True)  # of a process that was killed, and had this PID
        yield partial
    finally:
        partial.unlink(missing_ok=True)


def write_whole(path: Path, content: bytes) -> None:
    """All of it, or what was there stays, whose mode it keeps; a link's target is replaced. Raises OSError."""
    path = Path(os.path.realpath(path))  # for links in a circle `resolve` raises RuntimeError before Python 3.13
    mode = stat.S_IMODE(path.stat().st_mode) if is_there(path) else None
    with partial_file(path) as partial:
        if mode is not None:
            partial.touch(0o600)  # others may read it once it has the mode of the one that it replaces
        partial.write_bytes(content)
        if mode is not None:
            partial.chmod(mode)
        partial.replace(path)


def is_there(path: Path) -> bool:
    """As `Path.exists`; but what can't be told, as of links in a circle, is no absence. Raises OSError."""
    with suppress(FileNotFoundError):
        path.stat()
        return True
    return False


def open_lock(path: Path, mode: int = 0o600) -> int:
    """Open a file to be locked, made with this mode where there is none, whatever the umask is. Raises OSError.

    Who may read it may lock it. It is open for writing where that is allowed, since NFS locks no other alone
    (flock(2)); for reading on a read-only disk, and where it is another user's.
    """
    with suppress(FileExistsError):  # O_CREAT on another user's file is refused in /tmp (protected_regular, proc(5))
        handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, mode)
        with suppress(PermissionError):  # a file system without modes
            os.fchmod(handle, mode)
        return handle
    try:
        return os.open(path, os.O_RDWR | os.O_NOFOLLOW)
    except OSError as error:
        if error.errno not in {errno.EACCES, errno.EPERM, errno.EROFS}:
            raise
        return os.open(path, os.O_RDONLY | os.O_NOFOLLOW)
