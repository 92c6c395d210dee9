"""A disk that fails on demand, and small whole trails to be tampered with."""

from __future__ import annotations

import errno
import os
from dataclasses import dataclass
from pathlib import Path

from logs.disk import Disk
from logs.journal import Moment
from logs.keys import ConsoleKey, PublicKey, by_fingerprint
from logs.mirror import CheckpointCopy
from logs.records import Body, Command, EventRaised, Note, SessionStart, Stop, Transition
from logs.writer import SessionWriter

START = SessionStart(versions={"rleex": "0"}, configuration={}, simulated=True)
LAPTOP = SessionStart(versions={}, configuration={"joints": {"host": "exo"}}, simulated=True)  # of two computers
BODIES: tuple[Body, ...] = (
    Command(number=1, action="step", source="gesture", state="standing", gesture="1"),
    Transition(from_state="standing", to_state="right leg forward", action="step", number=1),
    Note(text='a "quoted" note with "signature":"00" in it'),
    EventRaised(event="lost", effect="hold", text="Look."),
    Stop(state="standing", effect="hold"),
    Note(text="ä–語"),
)
WALL_NS = 1_790_000_000_000_000_000


def moment(tick: int) -> Moment:
    """A time at 10 ms a tick on both clocks."""
    return Moment(wall_ns=WALL_NS + tick * 10_000_000, monotonic_ns=1 + tick * 10_000_000, operator="ann")


class Crash(BaseException):
    """The process dies here."""


class FaultyDisk(Disk):
    """Fails its n-th operation: once, for a while, or by the death of the process; keeps what is durable.

    A write that fails has taken half of its bytes, as a full disk does.
    """

    def __init__(self, fail_at: int = -1, *, times: int = 1, error: int = errno.ENOSPC, crash: bool = False) -> None:
        self.operations = 0
        self._fail_from, self._fail_to = fail_at, fail_at + times
        self._error, self._crash = error, crash
        self._durable: dict[int, int] = {}
        self.handles: set[int] = set()

    def _turn(self) -> bool:
        self.operations += 1
        return self._fail_from <= self.operations - 1 < self._fail_to

    def _fail(self) -> None:
        if self._crash:
            raise Crash
        raise OSError(self._error, os.strerror(self._error))

    def create(self, path: Path) -> int:
        if self._turn():
            self._fail()
        return self._opened(super().create(path))

    def open_existing(self, path: Path) -> int:
        if self._turn():
            self._fail()
        return self._opened(super().open_existing(path))

    def _opened(self, handle: int) -> int:
        self.handles.add(handle)
        self._durable[handle] = os.fstat(handle).st_size
        return handle

    def write(self, handle: int, data: bytes, offset: int) -> int:
        if self._turn():
            super().write(handle, data[: len(data) // 2], offset)
            self._fail()
        return super().write(handle, data, offset)

    def sync(self, handle: int) -> None:
        if self._turn():
            self._fail()
        super().sync(handle)
        self._durable[handle] = os.fstat(handle).st_size

    def sync_folder(self, folder: Path) -> None:
        if self._turn():
            self._fail()
        super().sync_folder(folder)

    def rename(self, source: Path, target: Path) -> None:
        if self._turn():
            self._fail()
        super().rename(source, target)

    def close(self, handle: int) -> None:
        self.handles.discard(handle)
        super().close(handle)

    def lose_power(self, kept_share: float) -> None:
        """Only this share of what was written since the last fsync stays; every file is released."""
        for handle in list(self.handles):
            durable, size = self._durable[handle], os.fstat(handle).st_size
            os.ftruncate(handle, durable + int((size - durable) * kept_share))
            self.close(handle)


@dataclass(frozen=True)
class Trail:
    """A console's folder with one closed session in it."""

    folder: Path
    session: Path
    key: ConsoleKey

    @property
    def keys(self) -> dict[str, PublicKey]:
        """As the verifier wants them."""
        return by_fingerprint([self.key.public])

    @property
    def manifest(self) -> Path:
        """The folder's manifest."""
        return self.folder / "manifest.jsonl"


def write_session(
    folder: Path,
    name: str,
    key: ConsoleKey,
    disk: Disk,
    bodies: tuple[Body, ...] = BODIES,
    *,
    start: SessionStart = START,
) -> Path:
    """A session from its first record to its signed end."""
    writer = SessionWriter(folder, name, key, disk, CheckpointCopy(""))
    writer.begin(start, moment(0))
    for tick, body in enumerate(bodies, start=1):
        writer.take(moment(tick).entry(body))
        writer.settle_when_due(moment(tick).monotonic_ns)
    last = moment(len(bodies) + 1)
    writer.end("test", last)
    assert writer.finish(last)
    writer.close()
    return writer.path
