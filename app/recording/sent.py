"""Whether every message that control and perception made is in the recording, or counted as lost.

Both say in the trail, at their end, how many they made (`RecordingSent`); the recording process has no part in it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

from app.recording.read import Recording, trail_of
from logs.read import records
from logs.records import ProcessStart, RecordingFile, RecordingSent

SENDERS = ("control", "perception")


@dataclass(frozen=True, slots=True, kw_only=True)
class SentCheck:
    """By topic; only topics whose messages their process counts."""

    made: Mapping[str, int]
    missing: Mapping[str, int]  # neither there nor counted as lost, or there more often than made: below 0
    known: bool  # every process that was started said how many it made


def check_sent(recording: Recording, recorded: RecordingFile | None) -> SentCheck:
    """A recording that was read to its end, beside the trail's counts. Raises AuditError."""
    trail = trail_of(recording.path)
    made: Counter[str] = Counter()
    open_processes: Counter[str] = Counter()
    for record in records(trail) if trail.exists() else ():
        if record.process in SENDERS and isinstance(record.body, ProcessStart):
            open_processes[record.process] += 1
        elif isinstance(record.body, RecordingSent):
            open_processes[record.process] -= 1
            made.update(record.body.messages)
    lost = recorded.lost if recorded is not None else recording.lost
    missing = {topic: count - recording.counts[topic] - lost.get(topic, 0) for topic, count in made.items()}
    known = bool(made) and not any(open_processes.values())
    return SentCheck(made=made, missing={topic: count for topic, count in missing.items() if count}, known=known)
