"""What leaves the house without a date or a person's words: a patient's dates are shifted, all by the same days.

So the time between two sessions of a patient stays what it was. The days follow from a secret of this home; without
it nobody gets the dates back. Joints, hand and gait stay; the trail and what operators did go, as they hold their
names, comments and dates. Of a reason its code and numbers stay, its texts go: a path names a session and a user, an
error is anybody's words. Pictures are never exported. The pseudonym stays. Every time is the shifted UTC: the host's
monotonic clock counts from its start, whose true date a system log or another patient's file tells.
"""

from __future__ import annotations

import hmac
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

import msgspec
from msgspec import Struct
from msgspec.structs import replace

from app.recording import schemas
from app.recording.read import STAMP, Recording, RecordingReadFault, Sample, messages
from app.recording.schemas import JointStates, time_of
from app.system.errors import AppError
from logs.read import understand
from logs.reason import Reason, Value
from logs.records import PatientChosen, Record

KEY_FILE = "deidentify.key"
MOST_DAYS = 365  # into the past
REMOVED = "…"  # in the place of a text, as the wording of a reason needs each of its values
DAY_NS = 86_400 * 10**9
_PERSONAL = frozenset({schemas.TRAIL, schemas.LOG, schemas.OPERATOR})
KEPT_TOPICS = tuple(topic for topic in schemas.TOPICS if topic.name not in _PERSONAL)
_DATED = frozenset({schemas.JOINT_STATE, schemas.JOINT_SETPOINT})  # their messages hold a date
_decode = msgspec.json.Decoder(JointStates).decode
_REASONED: dict[str, tuple[type[Struct], tuple[str, ...]]] = {  # by topic, the fields of its messages that are reasons
    schemas.GAIT: (schemas.Gait, ("refusal", "why_not")),
    schemas.VERDICT: (schemas.Verdict, ("explanation", "refusal")),
}
_encode = msgspec.json.Encoder().encode


@dataclass(frozen=True, slots=True)
class Deidentified:
    """A session's name by its shifted date, and what is added to every wall time."""

    name: str
    shift_ns: int

    def samples(self, recording: Recording, found: Iterator[Sample]) -> Iterator[Sample]:
        """What is kept of a recording's messages, at the shifted UTC. The recording's clock is still the true one."""
        for one in found:
            at_ns = one.at_ns + recording.clock_offset_ns + self.shift_ns
            if one.topic in _DATED:
                yield Sample(one.topic, at_ns, _encode(replace(_decode(one.data), timestamp=time_of(at_ns))))
            elif one.topic in _REASONED:
                yield Sample(one.topic, at_ns, _without_texts(one))
            elif one.topic not in _PERSONAL:
                yield Sample(one.topic, at_ns, one.data)


def _without_texts(one: Sample) -> bytes:
    kind, fields = _REASONED[one.topic]
    message = msgspec.json.decode(one.data, type=kind)
    found: dict[str, Reason | None] = {field: getattr(message, field) for field in fields}
    if not any(found.values()):
        return one.data
    return _encode(replace(message, **{field: why and _wordless(why) for field, why in found.items()}))


def _wordless(why: Reason) -> Reason:
    """Its code, numbers and codes; a value that is a member of an Enum is a code, and every text is free text."""
    return Reason(why.code, {name: _wordless_value(value) for name, value in why.values.items()})


def _wordless_value(value: Value) -> Value:
    if isinstance(value, str):
        return REMOVED
    if isinstance(value, Reason):
        return _wordless(value)
    return tuple(map(_wordless, value)) if isinstance(value, tuple) else value


def deidentify(patient: str, began: str, key: bytes) -> Deidentified:
    """For a session that began then (UTC, ISO 8601); the same key and patient give the same shift, of whole days."""
    digest = hmac.digest(key, patient.encode(), "sha256")
    days = 1 + int.from_bytes(digest[:8], "big") % MOST_DAYS
    shifted = datetime.fromisoformat(began) - timedelta(days=days)
    return Deidentified(f"{patient}-{shifted.strftime(STAMP)}", -days * DAY_NS)


def deidentify_recording(path: Path, key: bytes) -> Deidentified:
    """By the patient and the beginning that its trail names. Raises AppError."""
    began = ""
    for number, one in enumerate(messages(Recording(path=path), schemas.TRAIL), start=1):
        found = understand(one.data, number)
        if isinstance(found, Record):
            began = began or found.wall
            if isinstance(found.body, PatientChosen):
                return deidentify(found.body.patient, began, key)
    raise AppError(RecordingReadFault.NO_PATIENT, path=path)
