"""What leaves the house without a date or a person's words: a patient's dates are shifted, all by the same days.

So the time between two sessions of a patient stays what it was. The days follow from a secret of this home; without
it nobody gets the dates back. Joints, hand and gait stay; the trail and what operators did go, as they hold their
names, comments and dates. Pictures are never exported. The pseudonym stays.
"""

from __future__ import annotations

import hmac
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

import msgspec
from msgspec.structs import replace

from app.recording import schemas
from app.recording.read import STAMP, Recording, RecordingReadFault, Sample, messages
from app.recording.schemas import JointStates, time_of
from app.system.errors import AppError
from logs.read import understand
from logs.records import PatientChosen, Record

KEY_FILE = "deidentify.key"
MOST_DAYS = 365  # into the past
DAY_NS = 86_400 * 10**9
_PERSONAL = frozenset({schemas.TRAIL, schemas.LOG, schemas.OPERATOR})
KEPT_TOPICS = tuple(topic for topic in schemas.TOPICS if topic.name not in _PERSONAL)
_DATED = frozenset({schemas.JOINT_STATE, schemas.JOINT_SETPOINT})  # their messages hold a date
_decode = msgspec.json.Decoder(JointStates).decode
_encode = msgspec.json.Encoder().encode


@dataclass(frozen=True, slots=True)
class Deidentified:
    """A session's name by its shifted date, and what is added to every wall time."""

    name: str
    shift_ns: int

    def samples(self, recording: Recording, found: Iterator[Sample]) -> Iterator[Sample]:
        """What is kept of a recording's messages. The recording's clock is still the true one."""
        for one in found:
            if one.topic in _DATED:
                when = time_of(one.at_ns + recording.clock_offset_ns + self.shift_ns)
                yield Sample(one.topic, one.at_ns, _encode(replace(_decode(one.data), timestamp=when)))
            elif one.topic not in _PERSONAL:
                yield one


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
