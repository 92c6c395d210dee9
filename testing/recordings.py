"""What a recording says beside what others say of the same session: control's own statistics, the trail's own lines."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.control.telemetry import quad
from app.recording import schemas
from app.recording.read import HashCheck, Recording, check_sent, messages, proof_of, survey, trail_of
from app.recording.samples import read_samples
from hal.joints.protocol import TICK_HZ
from logs.read import records
from logs.reason import Quad
from logs.records import JointStatistics, TickLateness

QUANTITIES = ("angle_{}_rad", "torque_{}_nm")  # of the feedback alone
COMPARED = tuple(name.format(kind) for name in QUANTITIES for kind in ("min", "mean", "max"))


def contradictions(path: Path) -> list[str]:
    """Where a whole recording and the rest of its session disagree; empty: nowhere. Raises AppError, AuditError."""
    found, (proof, recorded) = survey(path), proof_of(path)
    sent = check_sent(found, recorded)
    checks = {
        f"the file: whole {found.whole}, damage {found.damage!r}": found.whole and not found.damage,
        f"hash: {proof.name}": proof is HashCheck.SAME,
        "counts of the recording process": recorded is not None and recorded.messages == found.counts,
        f"lost: {found.lost}": not found.lost,
        f"made and missing: {sent}": sent.known and not sent.missing,
        "ticks that control counted": found.counts[schemas.JOINT_STATE] == ticks_of(trail_of(path)),
        "frames in a row": frames_are_in_a_row(path),
        "the trail's lines": lines_are_the_trails(path),
        "control's statistics of the joints": joints_are_controls(path) > 0,
    }
    return [what for what, holds in checks.items() if not holds]


def ticks_of(trail: Path) -> int:
    """How many ticks control ran, by its own count at its end."""
    return [one.body.ticks for one in records(trail) if isinstance(one.body, TickLateness)][-1]


def frames_are_in_a_row(path: Path) -> bool:
    """Each topic of the hand has every frame's number once, from the first on."""
    numbers: dict[str, list[int]] = {topic: [] for topic in schemas.HAND_TOPICS}
    for one in messages(Recording(path=path), *numbers):
        numbers[one.topic].append(one.value["frame"])
    return all(found == list(range(1, len(found) + 1)) for found in numbers.values())


def lines_are_the_trails(path: Path) -> bool:
    """The copy in the file is the trail from its beginning, byte by byte."""
    lines = trail_of(path).read_bytes().splitlines()
    copied = [one.data for one in messages(Recording(path=path), schemas.TRAIL)]
    return bool(copied) and copied == lines[: len(copied)]


def joints_are_controls(path: Path) -> int:
    """Seconds whose lowest, mean and highest angle and torque are those that control recorded; 0: one differs.

    Control makes them in each tick of what it read, before anything is handed to the recording; both count their ticks
    from the first.
    """
    samples = read_samples(path)
    said = [one.body for one in records(trail_of(path)) if isinstance(one.body, JointStatistics)]
    ends = [(number + 1) * TICK_HZ for number in range(len(said))]
    if ends and ends[-1] > len(samples.at_ns):
        return 0
    made = [statistics_of(samples.values[end - TICK_HZ : end]) for end in ends]
    return len(made) if made == [tuple(getattr(one, name) for name in COMPARED) for one in said] else 0


def statistics_of(ticks: NDArray[np.float64]) -> tuple[Quad, ...]:
    """COMPARED of some ticks (n, 6, 4), in the order of `export.QUANTITIES`."""
    rows = (np.ascontiguousarray(ticks[:, number].T) for number in (0, 2))  # means depend on the order in memory
    return tuple(quad(make(row, axis=1)) for row in rows for make in (np.min, np.mean, np.max))
