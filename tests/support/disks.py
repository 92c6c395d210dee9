"""Disks that take nothing more."""

from __future__ import annotations

import errno
import os
import resource
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest


@contextmanager
def full_disk(at_bytes: int = 0) -> Iterator[None]:
    """No file can grow beyond that size.

    Nothing imported meanwhile is cached: CPython up to 3.13 keeps a cut .pyc, and no later import gets past it.
    """
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "dont_write_bytecode", True)
        resource.setrlimit(resource.RLIMIT_FSIZE, (at_bytes, limits[1]))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)


@contextmanager
def read_only_disk() -> Iterator[None]:
    """Files are opened for reading only, as after a remount by `errors=remount-ro`."""
    real = os.open

    def opened(path: os.PathLike[str], flags: int, mode: int = 0o777) -> int:
        exists = os.path.lexists(path)
        if flags & os.O_EXCL and exists:
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), path)
        if flags & os.O_ACCMODE != os.O_RDONLY or not exists:
            raise OSError(errno.EROFS, os.strerror(errno.EROFS), path)
        return real(path, flags, mode)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "open", opened)
        yield
