"""A session's trail as it is written: when it must be on the disk, when it is signed, what enters the manifest."""

from __future__ import annotations

from pathlib import Path

from msgspec.structs import replace

from logs import records as r
from logs.disk import Disk
from logs.journal import Moment
from logs.keys import ConsoleKey
from logs.manifest import Manifest
from logs.mirror import CheckpointCopy
from logs.reason import Cause, Reason
from logs.records import Entry, TrailEnd
from logs.trail import Chain, Trail, open_logger

# On the medium before anything else is taken from the queue; all others within BATCH_NS.
AT_ONCE = (
    r.SessionStart,
    r.SessionEnd,
    r.Command,
    r.Transition,
    r.EventRaised,
    r.LogRecovered,
    r.EventCleared,
    r.EffectChanged,
    r.Acknowledgement,
    r.Stop,
    r.StopInput,
    r.Refusal,
    r.Press,
    r.Cancel,
    r.Release,
    r.ActionEnd,
    r.HeartbeatLost,
    r.Arming,
    r.SignIn,
    r.SignInFailed,
    r.RecordsLost,
    r.Checkpoint,
)
BATCH_NS = 50_000_000
RETRY_NS = 100_000_000  # after the disk refused
CHECKPOINT_RECORDS = 500  # at most so many records unsigned
CHECKPOINT_NS = 30_000_000_000  # or so long
CLOCK_STEP_NS = 100_000_000  # reading two clocks one after the other differs by far less


class SessionWriter:
    """Takes entries, chains them, and settles them on the disk by the policy above. Knows no clock."""

    def __init__(self, folder: Path, session: str, key: ConsoleKey, disk: Disk, copy: CheckpointCopy) -> None:
        self.path = _free_name(folder, session)
        self._folder = folder
        self._key = key
        self._disk = disk
        self._copy = copy
        self._manifest: Manifest | None = None
        self._trail = Trail(self.path, disk)
        self._chain = Chain(key)
        self._logger = open_logger(self._trail, self._chain, session)
        self._urgent = False
        self._oldest_ns = 0  # monotonic, of what waits
        self._tried_ns = 0
        self._checkpoint_at = 0  # sequence of the newest checkpoint
        self._checkpoint_ns = 0
        self._clock_offset_ns: int | None = None
        self._entered_close = False
        self.newest: TrailEnd | None = None  # on the medium; one object, so that another thread may read it
        self._session = session
        self._unsent: list[bytes] = []  # checkpoints for the mirror, once they have settled

    @property
    def fault(self) -> Reason | None:
        """Why the disk refuses, while it does."""
        return self._trail.fault or (self._manifest.fault if self._manifest else None)

    @property
    def copy_fault(self) -> Reason | None:
        """Why the mirror can't be reached, while it can't."""
        return self._copy.fault

    @property
    def written(self) -> int:
        """Records on the medium."""
        return self._trail.settled_records

    @property
    def waiting(self) -> int:
        """Records queued and not on the medium."""
        return self._trail.waiting_records

    @property
    def is_full(self) -> bool:
        """Whether nothing more should be handed over until the disk answers."""
        return self._trail.is_full

    def begin(self, start: r.SessionStart, now: Moment) -> list[r.LogRecovered]:
        """Create the file, enter it in the manifest, write the first record. Returns what was found of earlier crashes.

        Raises OSError when an earlier file can't even be read; a disk that can't be written becomes `fault`.
        """
        self._manifest = Manifest(self._folder, self._key, self._disk, now)
        found = self._manifest.recover(now)
        self._manifest.opened(self.path.name, now)
        history = {"history_entries": self._manifest.entries, "history_hash": self._manifest.head}
        self._append(now.entry(replace(start, **history)))
        self.settle(now.monotonic_ns)
        return found

    def take(self, entry: Entry) -> None:
        """Chain one entry and queue it; a stepped clock and a due checkpoint are recorded beside it."""
        self._watch_clock(entry)
        self._append(entry)
        due = self._chain.sequence - self._checkpoint_at >= CHECKPOINT_RECORDS
        late = entry.monotonic_ns - self._checkpoint_ns >= CHECKPOINT_NS
        if due or late or isinstance(entry.body, r.Stop):
            self._checkpoint(_moment(entry))

    def settle_when_due(self, monotonic_ns: int) -> bool:
        """Settle if the policy says now; False while the disk refuses."""
        if self.fault:
            return monotonic_ns - self._tried_ns < RETRY_NS or self.settle(monotonic_ns)
        if self.waiting and (self._urgent or monotonic_ns - self._oldest_ns >= BATCH_NS):
            return self.settle(monotonic_ns)
        return True

    def settle(self, monotonic_ns: int) -> bool:
        """Bring everything to the medium now; False when the disk refuses."""
        self._tried_ns = monotonic_ns
        # The file exists before the manifest names it, and is named before it holds anything: a crash between
        # any two leaves a state that differs from a file removed or added.
        named = self._manifest is None or (self._trail.create() and self._manifest.settle())
        good = named and self._trail.settle()
        if good:
            self._urgent = False
            self.newest = self._end_of_chain()
            for line in self._unsent:
                self._copy.put(self.path.name, line)
            self._unsent.clear()
        return good

    def end(self, cause: Cause, now: Moment) -> bool:
        """Write the last record and sign all; False when the disk refuses: call `finish` again then."""
        self._append(now.entry(r.SessionEnd(reason=cause)))
        self._checkpoint(now, closing=True)
        return self.settle(now.monotonic_ns)

    def finish(self, now: Moment) -> bool:
        """Once everything has settled, enter in the manifest that the file is whole. False while the disk refuses."""
        if self._manifest is None or not self.settle(now.monotonic_ns):
            return False
        if not self._entered_close:
            self._manifest.closed(self.path.name, self._chain.sequence, self._chain.previous, now)
            self._entered_close = True
        return self._manifest.settle()

    def close(self) -> None:
        """Release the files."""
        self._trail.close()
        if self._manifest is not None:
            self._manifest.close()
        self._copy.close()

    def _end_of_chain(self) -> TrailEnd | None:
        chain = self._chain
        if not chain.sequence:
            return None
        return TrailEnd(
            session=self._session,
            key=self._key.public.fingerprint,
            first_hash=chain.first,
            sequence=chain.sequence - 1,
            hash=chain.previous,
        )

    def _append(self, entry: Entry) -> None:
        if not self.waiting:
            self._oldest_ns = entry.monotonic_ns
        self._urgent = self._urgent or isinstance(entry.body, AT_ONCE)
        self._logger.record(entry)

    def _checkpoint(self, now: Moment, *, closing: bool = False) -> None:
        key = self._key.public.fingerprint
        self._append(now.entry(r.Checkpoint(records=self._chain.sequence, closing=closing, key=key)))
        self._unsent.append(self._trail.newest_line)
        self._checkpoint_at = self._chain.sequence
        self._checkpoint_ns = now.monotonic_ns

    def _watch_clock(self, entry: Entry) -> None:
        offset = entry.wall_ns - entry.monotonic_ns
        before, self._clock_offset_ns = self._clock_offset_ns, offset
        if before is not None and abs(offset - before) > CLOCK_STEP_NS:
            self._append(_moment(entry).entry(r.ClockStep(step_s=(offset - before) / 1e9)))


def _moment(entry: Entry) -> Moment:
    return Moment(wall_ns=entry.wall_ns, monotonic_ns=entry.monotonic_ns, operator=entry.operator)


def _free_name(folder: Path, session: str) -> Path:
    """A session whose audit process had to be started again goes on in a file of its own."""
    path, part = folder / f"{session}.jsonl", 1
    while path.exists():
        part += 1
        path = folder / f"{session}-{part}.jsonl"
    return path
