"""The profiles of one home: a TOML file a patient, every change kept beside it, nothing ever deleted."""

from __future__ import annotations

import fcntl
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import Enum
from pathlib import Path
from typing import Any, Protocol

import msgspec
from msgspec import Struct

from logs.reading.errors import cause_of
from logs.reading.formats import read_json_lines
from profiles.errors import ProfileError, ProfileFault
from profiles.fields import IDENTIFIER, changed, check, flat, to_file
from profiles.files import decode, encode, read_text, replace_files
from profiles.schema import DEMO_PATIENT, Profile

SUFFIX = ".toml"
MAX_HISTORY = 64 << 20  # bytes
Check = Callable[[Profile], None]
# Fields and groups (as in files) that shape no motion: they change in a profile that fits the device no longer, too.
WITHOUT_MOTION = frozenset(
    {
        "archived",
        "calibrations",
        "distance_source",
        "dose",
        "evidence",
        "hand",
        "note",
        "palm",
        "press_threshold_cm",
        "vocabulary",
    }
)


class ChangeCause(Enum):
    """Why the program itself changes a profile; the history keeps the code where people would write their reason."""

    NEW = "new"
    ARCHIVED = "archived"
    RESTORED = "restored"
    IMPORTED = "imported"
    CALIBRATED = "calibrated"
    PRESS_ZONE = "press zone"
    ENROLLED = "enrolled"  # the vocabulary
    DISTANCE = "distance"  # chosen at the start of a session
    TARGETS = "targets after a session"

    @property
    def key(self) -> str:
        """As the history and the catalogues name it."""
        return f"{type(self).__name__}.{self.name}"


class Change(Struct, frozen=True, kw_only=True):
    """One save: when, by whom, and each field (as in files) with what it was and what it is; None: absent.

    why: what the person wrote, or a `ChangeCause`'s key; older histories have English text.
    """

    at: str  # ISO 8601, UTC
    by: str
    changes: dict[str, tuple[Any, Any]]
    why: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Listing:
    """What a home holds. broken: file name and what is wrong with it."""

    profiles: tuple[Profile, ...]
    broken: tuple[tuple[str, ProfileError], ...] = ()


class Author(Protocol):
    """Whose change it is: what signing in gives (`app/system/authority.py`)."""

    @property
    def name(self) -> str:
        """The name for the history."""

    def change_profile(self, patient: str, change: Change) -> None:
        """Return when the change may be made and is on record; raise otherwise."""


class ProfileStore:
    """Profiles in a folder. Every method may raise ProfileError; those that change ask the author first."""

    def __init__(self, folder: Path, checks: tuple[Check, ...] = ()) -> None:
        """folder: made when first written to. checks: more that a change which shapes motion must pass."""
        self._folder = folder
        self._checks = checks

    def load(self, identifier: str) -> Profile:
        """One patient; the demo patient ships with the program and needs no file."""
        path = self._path(identifier)
        if not path.exists():
            if identifier == DEMO_PATIENT.identifier:
                return DEMO_PATIENT
            known = ", ".join(profile.identifier for profile in self.list().profiles)
            raise ProfileError(ProfileFault.UNKNOWN_PATIENT, identifier=identifier, path=self._folder, known=known)
        profile = decode(read_text(path), str(path))
        if profile.identifier != identifier:
            raise ProfileError(ProfileFault.OTHER_PATIENT, path=path, identifier=profile.identifier)
        return profile

    def list(self, *, archived: bool = False) -> Listing:
        """All patients by identifier, the archived ones only on request; broken files are listed, not skipped."""
        profiles: dict[str, Profile] = {DEMO_PATIENT.identifier: DEMO_PATIENT}
        broken: list[tuple[str, ProfileError]] = []
        for path in sorted(self._folder.glob(f"[!.]*{SUFFIX}")):
            try:
                profiles[path.stem] = self.load(path.stem)
            except ProfileError as error:
                profiles.pop(path.stem, None)
                broken.append((path.name, error))
        wanted = (profiles[name] for name in sorted(profiles) if archived or not profiles[name].archived)
        return Listing(profiles=tuple(wanted), broken=tuple(broken))

    def create(self, profile: Profile, *, by: Author, at: datetime) -> None:
        """A new patient; an identifier that exists is refused."""
        with self._locked():
            if self._taken(profile.identifier):
                raise ProfileError(ProfileFault.PATIENT_EXISTS, identifier=profile.identifier)
            self._write(profile, None, by=by, at=at, why=ChangeCause.NEW.key)

    def save(self, profile: Profile, *, by: Author, at: datetime, why: str = "") -> Change | None:
        """Keep a profile as it is now, and what changed. None: nothing did."""
        with self._locked():
            known = self._path(profile.identifier).exists() or profile.identifier == DEMO_PATIENT.identifier
            if not known and self._taken(profile.identifier):
                raise ProfileError(ProfileFault.PATIENT_EXISTS, identifier=profile.identifier)
            before = self.load(profile.identifier) if known else None
            return self._write(profile, before, by=by, at=at, why=why)

    def archive(self, identifier: str, *, by: Author, at: datetime, archived: bool = True) -> None:
        """Take a patient out of the list, or back into it; nothing is deleted."""
        profile = msgspec.structs.replace(self.load(identifier), archived=archived)
        self.save(profile, by=by, at=at, why=(ChangeCause.ARCHIVED if archived else ChangeCause.RESTORED).key)

    def history(self, identifier: str) -> tuple[Change, ...]:
        """Every change, oldest first."""
        path = self._history_path(identifier)
        if not path.exists():
            return ()
        try:
            return read_json_lines(path, Change)
        except OSError as error:
            raise ProfileError(ProfileFault.HISTORY_UNREADABLE, path=path, detail=cause_of(error)) from error

    def export(self, identifier: str, path: Path) -> None:
        """A copy as a file of its own, with the comments that the file here has."""
        profile = self.load(identifier)
        own = self._path(identifier)
        replace_files({path: read_text(own) if own.exists() else encode(profile)})

    def import_file(self, path: Path, *, by: Author, at: datetime) -> Profile:
        """Take in an exported profile as a new patient, or as a change of the one with its identifier."""
        profile = decode(read_text(path), str(path))
        self.save(profile, by=by, at=at, why=ChangeCause.IMPORTED.key)
        return profile

    def _write(self, profile: Profile, before: Profile | None, *, by: Author, at: datetime, why: str) -> Change | None:
        check(profile)
        changes = differences(before, profile)
        if not changes:
            return None
        if not {field.partition(".")[0] for field in changes} <= WITHOUT_MOTION:
            for one in self._checks:
                one(profile)
        change = Change(at=at.astimezone(UTC).isoformat(timespec="seconds"), by=by.name, changes=changes, why=why)
        by.change_profile(profile.identifier, change)
        path, history = self._path(profile.identifier), self._history_path(profile.identifier)
        kept = read_text(history, MAX_HISTORY) if history.exists() else ""
        replace_files(
            {
                history: kept + msgspec.json.encode(change).decode() + "\n",
                path: encode(profile, read_text(path) if path.exists() else ""),
            }
        )
        return change

    def _path(self, identifier: str) -> Path:
        if not IDENTIFIER.fullmatch(identifier):
            raise ProfileError(ProfileFault.IDENTIFIER, identifier=identifier)
        return self._folder / f"{identifier}{SUFFIX}"

    def _history_path(self, identifier: str) -> Path:
        return self._folder / "history" / f"{self._path(identifier).stem}.jsonl"

    def _taken(self, identifier: str) -> bool:
        """Whether the name is in use, upper and lower case being the same to people and to some disks."""
        path = self._path(identifier)
        names = {one.stem.lower() for one in self._folder.glob(f"[!.]*{SUFFIX}")} | {DEMO_PATIENT.identifier}
        return path.stem.lower() in names

    @contextmanager
    def _locked(self) -> Iterator[None]:
        """One writer at a time: the console and the command line may be open together."""
        try:
            self._folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            with (self._folder / ".lock").open("w") as lock:
                fcntl.flock(lock, fcntl.LOCK_EX)
                yield
        except OSError as error:
            raise ProfileError(ProfileFault.FOLDER_READ_ONLY, path=self._folder, detail=error.strerror) from error


def differences(before: Profile | None, after: Profile) -> dict[str, tuple[Any, Any]]:
    """Each field (dotted, as in files) that differs, with both values; None: absent."""
    old, new = flat(to_file(before)) if before else {}, flat(to_file(after))
    return changed(old, new, new | old)
