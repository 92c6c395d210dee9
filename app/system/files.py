"""Files that take their name when they are whole."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
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
    path = path.resolve()
    mode = stat.S_IMODE(path.stat().st_mode) if path.exists() else None
    with partial_file(path) as partial:
        if mode is not None:
            partial.touch(0o600)  # others may read it once it has the mode of the one that it replaces
        partial.write_bytes(content)
        if mode is not None:
            partial.chmod(mode)
        partial.replace(path)
