"""A recording with its trail: when it began, what happened in it, and for whom.

The trail is the one beside the file, by which `rleex audit explain` goes, else the copy in the file.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable
from enum import Enum, auto
from pathlib import Path
from typing import Any

import msgspec

from app.motion.wearer import Wearer, load_wearer
from app.recording import schemas
from app.recording.index import RecordingIndex
from app.recording.read import RecordingReadFault, session_of, trail_of
from app.system.config import JointsConfig
from app.system.errors import AppError
from app.system.paths import pictures_path
from hal.errors import HardwareError
from logs import records as r
from logs.errors import AuditError
from logs.read import records, understand
from logs.records import Body, Record
from logs.show import kind_of
from profiles.schema import DEMO_PATIENT, Profile

# The field of each kind that names its own moment; the others happened when they were recorded.
_MOMENTS: dict[type, str] = {
    **dict.fromkeys((r.GestureOnset, r.Hint, r.Press, r.Cancel, r.Release), "captured_ns"),
    r.Command: "accepted_ns",
    r.Refusal: "refused_ns",
    r.EventRaised: "raised_ns",
    r.Stop: "seen_ns",
    r.ActionEnd: "ended_ns",
}
CHANGES = (r.Command, r.Refusal, r.GaitChanged, r.EffectChanged)  # of what control says 20 times a second
# Where a jump stops, and what a film tells; notes of what does nothing to the legs are left out.
LANDMARKS = (
    *(r.Press, r.Hint, r.Cancel, r.Release),
    *(r.Command, r.Refusal, r.GuardRefusal, r.ActionEnd, r.Pause),
    *(r.Stop, r.EventRaised, r.EventCleared, r.Acknowledgement, r.Arming),
)


class ReplayFault(Enum):
    """Why a recording is not shown as it was asked for."""

    NO_SUCH_RECORD = auto()  # name, path
    NO_SUCH_TIME = auto()  # path, from_s, to_s, duration_s


class Playback:
    """One recording, open. Times are the host's monotonic clock, in ns; seconds count from the first message."""

    def __init__(self, path: Path) -> None:
        """Raises AppError when the file is none that can be shown."""
        self.path = path
        self.index = RecordingIndex(path)
        self.pictures = _pictures_beside(path)
        self.begin_ns, self.end_ns = self.index.begin_ns, self.index.end_ns
        self.records = self._read_trail()
        self.landmarks = InTime(one for one in self.records if is_landmark(one.body))
        self.changes = InTime(one for one in self.records if isinstance(one.body, CHANGES))
        self.cameras = InTime(one for one in self.records if isinstance(one.body, r.Camera))
        self.commands = InTime(one for one in self.records if isinstance(one.body, r.Command))
        self._raised = _by_event(self.records, r.EventRaised)
        self._cleared = _by_event(self.records, r.EventCleared)

    @property
    def name(self) -> str:
        """The session's."""
        return session_of(self.path)

    @property
    def duration_s(self) -> float:
        """From the first message to the last."""
        return (self.end_ns - self.begin_ns) / 1e9

    def seconds(self, at_ns: int) -> float:
        """Since the beginning."""
        return (at_ns - self.begin_ns) / 1e9

    def at(self, seconds: float) -> int:
        """The moment so many seconds after the beginning, within the recording."""
        return min(max(self.begin_ns + round(seconds * 1e9), self.begin_ns), self.end_ns)

    def raised(self, event: str, at_ns: int) -> Record | None:
        """The newest record that raised this event."""
        return self._raised[event].newest(at_ns) if event in self._raised else None

    def is_over(self, event: str, raised: Record, at_ns: int) -> bool:
        """Whether its condition has ended since this record raised it."""
        cleared = self._cleared[event].newest(at_ns) if event in self._cleared else None
        return cleared is not None and cleared.sequence > raised.sequence

    def find(self, named: str) -> Record:
        """A record by its number, or the first of an event or of a kind by name. Raises AppError."""
        for one in self.records:
            event = getattr(one.body, "event", "") if isinstance(one.body, r.EventRaised) else ""
            if named in (str(one.sequence), event, kind_of(one.body)):
                return one
        raise AppError(ReplayFault.NO_SUCH_RECORD, name=named, path=self.path)

    def profile(self) -> Profile:
        """The patient as the trail has it; the demo patient where it names none that this version understands."""
        chosen = next((one.body for one in self.records if isinstance(one.body, r.PatientChosen)), None)
        if chosen is None:
            return DEMO_PATIENT
        values: dict[str, Any] = {**chosen.parameters, "identifier": chosen.patient}
        try:
            return msgspec.convert(values, Profile)
        except msgspec.ValidationError:
            return msgspec.structs.replace(DEMO_PATIENT, identifier=chosen.patient)

    def wearer(self) -> Wearer:
        """What a figure needs; the built-in device where the session's own is not on this machine."""
        started = next((one.body for one in self.records if isinstance(one.body, r.SessionStart)), None)
        try:
            joints = msgspec.convert(started.configuration["joints"] if started else {}, JointsConfig)
            return load_wearer(self.profile(), joints)
        except (KeyError, msgspec.ValidationError, HardwareError, AppError):
            return load_wearer(self.profile(), JointsConfig())

    def camera_width_px(self, at_ns: int) -> int:
        """Of the images that the keypoints lie on then; 0: the trail has no camera."""
        found = self.cameras.newest(at_ns) or self.cameras.next_after(at_ns)  # the first is recorded after its image
        return found.body.width_px if found is not None and isinstance(found.body, r.Camera) else 0

    def close(self) -> None:
        """Release the files."""
        self.index.close()
        if self.pictures is not None:
            self.pictures.close()

    def _read_trail(self) -> list[Record]:
        beside = trail_of(self.path)
        try:
            if beside.exists():
                return records(beside)
        except AuditError:
            pass  # the copy is there
        lines = self.index.between(schemas.TRAIL, self.begin_ns - 1, self.end_ns)
        copied = (understand(one.data, number) for number, one in enumerate(lines, start=1))
        return sorted((one for one in copied if isinstance(one, Record)), key=lambda one: one.sequence)


def _pictures_beside(path: Path) -> RecordingIndex | None:
    """The camera's pictures of the same session, where the patient agreed to them."""
    beside = pictures_path(path.parent, session_of(path))
    if not beside.exists():
        return None
    try:
        return RecordingIndex(beside)
    except AppError as error:
        if error.code is RecordingReadFault.EMPTY:  # cut before its first chunk
            return None
        raise


class InTime:
    """Records in the order of their moments.

    One that names no moment happened no later than the next one of its process: it was recorded at its tick's end,
    while the next may name the tick's beginning.
    """

    def __init__(self, found: Iterable[Record]) -> None:
        placed: list[tuple[int, int, Record]] = []
        next_ns: dict[str, int] = {}
        for one in sorted(found, key=lambda one: one.sequence, reverse=True):
            at_ns = moment_ns(one)
            if at_ns == one.monotonic_ns:
                at_ns = min(at_ns, next_ns.get(one.process, at_ns))
            next_ns[one.process] = at_ns
            placed.append((at_ns, one.sequence, one))
        placed.sort(key=lambda one: one[:2])
        self._times = [at_ns for at_ns, _, _ in placed]
        self._records = [one for _, _, one in placed]

    def between(self, after_ns: int, until_ns: int) -> list[Record]:
        """Those after a moment up to another."""
        return self._records[bisect_right(self._times, after_ns) : bisect_right(self._times, until_ns)]

    def newest(self, at_ns: int) -> Record | None:
        """The last one up to this moment."""
        place = bisect_right(self._times, at_ns) - 1
        return self._records[place] if place >= 0 else None

    def next_after(self, at_ns: int) -> Record | None:
        """The first one after this moment."""
        place = bisect_right(self._times, at_ns)
        return self._records[place] if place < len(self._records) else None


def _by_event(found: list[Record], kind: type[r.EventRaised] | type[r.EventCleared]) -> dict[str, InTime]:
    named: dict[str, list[Record]] = {}
    for one in found:
        if isinstance(one.body, kind):
            named.setdefault(one.body.event, []).append(one)
    return {event: InTime(records_of) for event, records_of in named.items()}


def moment_ns(record: Record) -> int:
    """When it happened: the moment that it names itself, else when it was recorded."""
    field = _MOMENTS.get(type(record.body), "")
    return getattr(record.body, field, 0) or record.monotonic_ns


def is_landmark(body: Body) -> bool:
    """Whether it is one of those that a jump stops at."""
    return isinstance(body, LANDMARKS) and getattr(body, "effect", "") != "note"
