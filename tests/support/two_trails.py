"""The trails of two computers that name each other, on simulated clocks; and what the owner of one can do to it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

from msgspec import structs

from logs.disk import Disk
from logs.journal import Moment
from logs.keys import ConsoleKey, load_or_make_key
from logs.mirror import CheckpointCopy
from logs.read import records
from logs.records import Entry, Note, OtherTrail, Record
from logs.trail import Chain, Trail, open_logger
from logs.writer import SessionWriter
from tests.support.audit_trails import START, WALL_NS

MS = 1_000_000
SECOND = 1_000 * MS
HOUR = 3_600 * SECOND


class UnsyncedDisk(Disk):
    """No test here loses power: hundreds of settled records would wait for the medium for nothing."""

    def sync(self, handle: int) -> None: ...

    def sync_folder(self, folder: Path) -> None: ...


@dataclass
class Host:
    """One computer: its home, its clock (so far ahead of the true time, and so much quicker), its trail."""

    home: Path
    session: str
    ahead_ns: int = 0
    drift_ppm: int = 0
    writer: SessionWriter = field(init=False)
    key: ConsoleKey = field(init=False)

    def __post_init__(self) -> None:
        (self.home / "logs").mkdir(parents=True)
        self.key = load_or_make_key(self.home / "keys")
        self.writer = SessionWriter(self.home / "logs", self.session, self.key, UnsyncedDisk(), CheckpointCopy(""))
        self.writer.begin(START, self.at(0))

    @property
    def path(self) -> Path:
        """Of its trail."""
        return self.writer.path

    def clock_ns(self, true_ns: int) -> int:
        return HOUR + self.ahead_ns + true_ns + true_ns * self.drift_ppm // 1_000_000

    def at(self, true_ns: int) -> Moment:
        return Moment(wall_ns=WALL_NS + true_ns, monotonic_ns=self.clock_ns(true_ns))

    def note(self, true_ns: int) -> None:
        """A record whose text is the true time."""
        self.writer.take(self.at(true_ns).entry(Note(text=str(true_ns))))
        self.writer.settle(self.clock_ns(true_ns))

    def name(self, other: Host, true_ns: int, *, error_ns: int = 0, uncertainty_ns: int = 0) -> None:
        """The other's newest record; the offset is wrong by `error_ns`."""
        offset_ns = other.clock_ns(true_ns) - self.clock_ns(true_ns) + error_ns
        newest = other.writer.newest
        assert newest is not None
        body = OtherTrail(**structs.asdict(newest), offset_ns=offset_ns, uncertainty_ns=uncertainty_ns)
        self.writer.take(self.at(true_ns).entry(body))
        self.writer.settle(self.clock_ns(true_ns))

    def end(self, true_ns: int) -> None:
        self.writer.end(None, self.at(true_ns))
        assert self.writer.finish(self.at(true_ns))
        self.writer.close()


def two_hosts(root: Path, *, seconds: int = 5, ahead_ns: int = HOUR, drift_ppm: int = 0) -> tuple[Host, Host]:
    """A whole session of both: each notes something ten times a second, and names the other once a second."""
    console, joints = Host(root / "console", "s1"), Host(root / "joints", "j1", ahead_ns, drift_ppm)
    for tenth in range(1, seconds * 10 + 1):
        now_ns = tenth * 100 * MS
        console.note(now_ns)
        joints.note(now_ns + 50 * MS)
        if tenth % 10 == 0:
            console.name(joints, now_ns + 60 * MS, uncertainty_ns=MS)
            joints.name(console, now_ns + 70 * MS, uncertainty_ns=MS)
    console.end(seconds * SECOND + 80 * MS)
    joints.end(seconds * SECOND + 90 * MS)
    return console, joints


def sign_again(path: Path, key: ConsoleKey, change: Callable[[list[Record]], Iterable[Record]]) -> None:
    """Write the whole trail anew from changed records, chained and signed with this key: what its owner can do."""
    changed = list(change(records(path)))
    path.unlink()
    trail, chain = Trail(path, UnsyncedDisk()), Chain(key)
    logger = open_logger(trail, chain, changed[0].session)
    for record in changed:
        body = record.body
        if hasattr(body, "signature"):
            body = structs.replace(body, key=key.public.fingerprint, signature="")
        logger.record(
            Entry(
                process=record.process,
                operator=record.operator,
                wall_ns=int(datetime.fromisoformat(record.wall).timestamp() * 1e6) * 1000,
                monotonic_ns=record.monotonic_ns,
                body=body,
            )
        )
    assert trail.settle()
    trail.close()
