"""Who is there and what runs: session, processes, patient, operators, and what people write."""

from __future__ import annotations

from typing import Annotated, Any

from msgspec import Meta, Struct

from logs.bodies.values import Hex


class SessionStart(Struct, frozen=True, kw_only=True, tag_field="kind", tag="session-start"):
    """First record of a session: what runs, how it is set up, and where the console's history stood."""

    versions: dict[str, str]  # program, Python, operating system, libraries, models' SHA-256
    configuration: dict[str, Any]
    simulated: bool
    role: str = ""
    history_entries: int = 0  # entries of the console's manifest before this session
    history_hash: Hex = ""  # hash of its newest entry


class SessionEnd(Struct, frozen=True, kw_only=True, tag_field="kind", tag="session-end"):
    """The session ends in good order."""

    reason: str = ""


class ProcessStart(Struct, frozen=True, kw_only=True, tag_field="kind", tag="process-start"):
    """A process of the session has started; the envelope names it."""

    pid: int


class ProcessEnd(Struct, frozen=True, kw_only=True, tag_field="kind", tag="process-end"):
    """A process ended, told by itself or by who found it gone."""

    pid: int
    reason: str = ""
    ended: str = ""  # the process, when somebody else tells


class PatientChosen(Struct, frozen=True, kw_only=True, tag_field="kind", tag="patient"):
    """Which patient, by pseudonym alone, and with which profile."""

    patient: str
    profile_sha256: Hex = ""
    parameters: dict[str, Any] = {}  # gait parameters and limits as used; never a name


class PatientConfirmed(Struct, frozen=True, kw_only=True, tag_field="kind", tag="patient-confirmed"):
    """The operator has confirmed who sits in the device."""

    patient: str


class SignIn(Struct, frozen=True, kw_only=True, tag_field="kind", tag="sign-in"):
    """An operator signed in or unlocked the console."""

    name: str
    role: str
    unlocked: bool = False


class SignOut(Struct, frozen=True, kw_only=True, tag_field="kind", tag="sign-out"):
    """An operator signed out, or the console locked itself."""

    name: str
    reason: str = ""


class SignInFailed(Struct, frozen=True, kw_only=True, tag_field="kind", tag="sign-in-failed"):
    """A refused attempt to sign in."""

    name: str
    reason: str
    failures: int
    wait_s: float


class OperatorChanged(Struct, frozen=True, kw_only=True, tag_field="kind", tag="operator-changed"):
    """An operator was added, disabled or given another PIN."""

    name: str
    role: str
    change: str


class Note(Struct, frozen=True, kw_only=True, tag_field="kind", tag="note"):
    """What the therapist wrote."""

    text: str


class Discomfort(Struct, frozen=True, kw_only=True, tag_field="kind", tag="discomfort"):
    """The patient's rating, 0 (none) to 10 (worst)."""

    rating: Annotated[int, Meta(ge=0, le=10)]
    text: str = ""
