"""What a session came to of what it aimed at, and how the patient rated it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import msgspec
from msgspec import Struct

from app.outcomes.measures import Measures
from logs.records import Rating, Record
from profiles.schema import DoseTargets


class Dose(Struct, frozen=True, kw_only=True):
    """Done beside the target; None: not measured."""

    steps: int
    distance_m: float | None
    duration_s: float  # of the session, standing and sitting too, as the session screen counts it
    target: DoseTargets


def dose_of(parameters: dict[str, Any], measures: Measures, duration_s: float) -> Dose | None:
    """By the profile as it was in that session; None where it holds no targets."""
    try:
        target = msgspec.convert(parameters["dose"], DoseTargets)
    except (KeyError, msgspec.ValidationError):
        return None
    return Dose(steps=measures.steps, distance_m=measures.distance_m, duration_s=duration_s, target=target)


def last_rating(trail: Iterable[Record], kind: type[Rating]) -> int | None:
    """The patient's last rating of this kind; None: not asked."""
    ratings = [record.body.rating for record in trail if isinstance(record.body, kind)]
    return ratings[-1] if ratings else None
