"""Files that people name: regular ones within a size, no device, pipe, socket or folder."""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import BinaryIO

from logs.reading.errors import InputError, InputFault

MAX_TEXT = 16 << 20  # bytes of a table or a list of JSON lines
MAX_IMAGE = 64 << 20


def path_named(text: str | Path) -> Path:
    """The path that a person typed. `~` of a user who does not exist stays: `Path.expanduser` raises RuntimeError."""
    return Path(os.path.expanduser(text))  # noqa: PTH111


def open_regular(path: Path, limit_bytes: int | None = None) -> BinaryIO:
    """A regular file, open for reading. Raises OSError; InputError when it is none, or larger than the limit."""
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC)  # a pipe without writer blocks
    except ValueError as error:  # NUL in the path
        raise InputError(InputFault.MALFORMED, detail=str(error)) from error
    try:
        status = os.fstat(handle)
        if not stat.S_ISREG(status.st_mode):
            raise InputError(InputFault.NOT_REGULAR)
        if limit_bytes is not None and status.st_size > limit_bytes:
            raise InputError(InputFault.TOO_LARGE, limit_bytes=limit_bytes)
        return os.fdopen(handle, "rb")
    except OSError:
        os.close(handle)
        raise


def read_bytes(path: Path, limit_bytes: int) -> bytes:
    """All of a regular file. Raises OSError, InputError."""
    with open_regular(path, limit_bytes) as file:
        data = file.read(limit_bytes + 1)  # files of /proc have no size
    if len(data) > limit_bytes:
        raise InputError(InputFault.TOO_LARGE, limit_bytes=limit_bytes)
    return data


def read_text(path: Path, limit_bytes: int = MAX_TEXT) -> str:
    """All of a regular file as UTF-8, without a byte order mark, lines ended by LF. Raises OSError, InputError."""
    return text_of(read_bytes(path, limit_bytes))


def text_of(data: bytes) -> str:
    """Bytes as strict UTF-8. Raises InputError for another encoding and for NUL."""
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(InputFault.NOT_UTF8, byte=error.start) from error
    if "\0" in text:
        raise InputError(InputFault.HAS_NUL, line=text[: text.index("\0")].count("\n") + 1)
    return text.replace("\r\n", "\n")
