"""Dose and discomfort from what a trail holds, and the smallest changes."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from app.outcomes.change import SMALLEST_CHANGES
from app.outcomes.measures import Measures
from app.outcomes.session import dose_of, last_rating
from app.outcomes.table import RATINGS, TESTS
from logs.records import SCHEMA, Discomfort, Exertion, Note, Pain, Rating, Record
from profiles.schema import DoseTargets

MEASURES = Measures(steps=40, walking_time_s=80.0, distance_m=11.0)


def record(body: Rating | Note) -> Record:
    return Record(
        body=body,
        hash="0" * 64,
        monotonic_ns=1,
        operator="",
        previous="0" * 64,
        process="console",
        schema=SCHEMA,
        sequence=1,
        session="s",
        wall="",
    )


def test_the_dose_is_of_the_targets_in_that_session() -> None:
    target = DoseTargets(steps=80, distance_m=20.0, duration_s=600.0)
    found = dose_of({"dose": msgspec.to_builtins(target)}, MEASURES, 300.0)
    assert found is not None
    assert (found.steps, found.distance_m, found.duration_s, found.target) == (40, 11.0, 300.0, target)


@pytest.mark.parametrize("parameters", [{}, {"dose": None}, {"dose": {"steps": "many"}}, {"dose": {"unknown": 1}}])
def test_without_known_targets_there_is_no_dose(parameters: dict[str, Any]) -> None:
    assert dose_of(parameters, MEASURES, 300.0) is None


def test_the_last_rating_of_a_kind_counts() -> None:
    assert last_rating([], Discomfort) is None
    assert last_rating([record(Note(text="well"))], Pain) is None
    trail = [record(Discomfort(rating=6)), record(Exertion(rating=13)), record(Discomfort(rating=2))]
    assert [last_rating(trail, kind) for kind in (Discomfort, Pain, Exertion)] == [2, None, 13]


@pytest.mark.parametrize(("kind", "bad"), [("pain", -1), ("pain", 11), ("exertion", 5), ("exertion", 21)])
def test_a_rating_beyond_its_scale_is_no_record(kind: str, bad: int) -> None:
    with pytest.raises(msgspec.ValidationError):
        msgspec.convert({"kind": kind, "rating": bad}, Pain | Exertion)


def test_smallest_changes_are_of_measures_and_cited() -> None:
    assert set(SMALLEST_CHANGES) <= {*Measures.__struct_fields__, *RATINGS, *(key for key, *_ in TESTS)}
    assert all(change.least > 0 and change.source for change in SMALLEST_CHANGES.values())
    assert SMALLEST_CHANGES["speed_m_s"].of(0.5) == 0.16
    assert SMALLEST_CHANGES["cadence_steps_min"].of(40.0) == pytest.approx(8.4)
