"""The mirror: copies of checkpoints in a directory or the system's log, out of reach of who can rewrite the trail.

A slow or absent mirror never delays the trail: a thread of its own copies, and a failure is reported as a code.
"""

from __future__ import annotations

import logging
import os
import queue
import threading
import time
from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from enum import Enum, auto
from logging.handlers import SysLogHandler
from pathlib import Path

from logs.line import unseal
from logs.reading.regular import open_regular, path_named, read_bytes
from logs.reason import Reason, reason
from logs.scan import Head, head_of

MAX_COPY = 256 << 20  # bytes of a mirror of checkpoints

SYSLOG = "syslog"
SYSLOG_SOCKET = "/dev/log"
SUFFIX = ".checkpoints"
_WAITING = 1000  # checkpoints; hours of a session


class MirrorFault(Enum):
    """Why checkpoints don't reach the mirror."""

    BEHIND = auto()  # target
    NOT_COPIED = auto()  # target, detail


class CheckpointCopy:
    """Copies checkpoint lines to `target`: "" for nowhere, "syslog", or a directory."""

    def __init__(self, target: str) -> None:
        self.fault: Reason | None = None  # while the mirror can't be reached
        self._target = target
        self._queue: queue.Queue[tuple[str, bytes] | None] = queue.Queue(_WAITING)
        self._thread: threading.Thread | None = None
        if target:
            self._thread = threading.Thread(target=self._run, name="checkpoint-copy", daemon=True)
            self._thread.start()

    def put(self, file: str, line: bytes) -> None:
        """Copy one line of `file` when there is time; never blocks."""
        if self._thread is None:
            return
        try:
            self._queue.put_nowait((file, line))
        except queue.Full:
            self.fault = reason(MirrorFault.BEHIND, target=self._target)

    def close(self, patience_s: float = 2.0) -> None:
        """Finish copying, for up to `patience_s`; a mirror that hangs is left behind."""
        if self._thread is not None:
            until_s = time.monotonic() + patience_s
            with suppress(queue.Full):
                self._queue.put(None, timeout=patience_s)
            self._thread.join(max(0.0, until_s - time.monotonic()))
            self._thread = None

    def _run(self) -> None:
        while (item := self._queue.get()) is not None:
            try:
                self._copy(*item)
                self.fault = None
            except OSError as error:
                self.fault = reason(MirrorFault.NOT_COPIED, target=self._target, detail=error.strerror or str(error))

    def _copy(self, file: str, line: bytes) -> None:
        if self._target == SYSLOG:
            _to_syslog(file, line)
        else:
            _append(path_named(self._target) / (file + SUFFIX), line)


def _append(path: Path, line: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o600)
    try:
        if os.fstat(handle).st_size and _last_byte(path) != b"\n":
            line = b"\n" + line  # a copy that was cut off stays on a line of its own
        while line:
            line = line[os.write(handle, line) :]
        os.fsync(handle)
    finally:
        os.close(handle)


def _last_byte(path: Path) -> bytes:
    with open_regular(path) as file:
        file.seek(-1, os.SEEK_END)
        return file.read(1)


class _SyslogHandler(SysLogHandler):
    """Lets an error out: the library's own prints it and goes on."""

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: ARG002, N802
        raise  # noqa: PLE0704 - the one that `emit` has caught


def _to_syslog(file: str, line: bytes) -> None:
    handler = _SyslogHandler(SYSLOG_SOCKET)
    try:
        handler.ident = "rleex: "
        text = f"{file} {line.decode().strip()}"
        handler.emit(logging.LogRecord("rleex", logging.INFO, "", 0, text, None, None))
    finally:
        handler.close()


def copied(copy: Path) -> dict[str, dict[int, str]]:
    """Key → sequence → hash of the copied checkpoints; a torn line is left out.

    Two computers' trails of a session have one name, and may have one mirror.
    """
    found: dict[str, dict[int, str]] = {}
    for head, digest in _checkpoints(copy):
        found.setdefault(head.body.key, {})[head.sequence] = digest
    return found


def differing(path: Path, expected: Mapping[int, str]) -> int | None:
    """The first record of a file whose hash is not the expected one, by sequence; None when all agree."""
    with open_regular(path) as file:
        for number, line in enumerate(file):
            if number in expected and ((parts := unseal(line)) is None or parts[1] != expected[number]):
                return number
    return None


def copied_files(copies: Path | None, keys: Collection[str]) -> list[str]:
    """Files of which the mirror holds a checkpoint by one of these keys; other consoles may use it, too."""
    found = copies.glob("*" + SUFFIX) if copies is not None else ()
    return [
        copy.name.removesuffix(SUFFIX) for copy in found if any(head.body.key in keys for head, _ in _checkpoints(copy))
    ]


def _checkpoints(copy: Path) -> Iterator[tuple[Head, str]]:
    for line in read_bytes(copy, MAX_COPY).splitlines(keepends=True):
        parts, head = unseal(line), head_of(line)
        if parts is not None and head is not None:
            yield head, parts[1]
