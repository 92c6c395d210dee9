"""How far measured outcomes are from the true ones: what only one side has passes no limit."""

from __future__ import annotations

from math import inf

import pytest
from msgspec.structs import replace

from app.evaluate.outcomes.compare import CASES, IN_POINTS, RANGE, RELATIVE, Compared, errors_of, errors_table
from app.outcomes.measures import Measures, Range
from app.text.catalogue import use_language

WHOLE = Measures(
    steps=2,
    **dict.fromkeys(RELATIVE, 2.0),
    **dict.fromkeys(IN_POINTS, 5.0),
    range_of_motion={"left_hip": Range(low_deg=-10.0, high_deg=30.0), "left_knee": Range(low_deg=0.0, high_deg=50.0)},
)


def test_lengths_and_times_are_compared_by_their_share_and_asymmetries_by_their_difference() -> None:
    knee = {**WHOLE.range_of_motion, "left_knee": Range(low_deg=0.0, high_deg=55.0)}
    measured = replace(WHOLE, speed_m_s=1.9, step_time_asymmetry_percent=7.0, range_of_motion=knee)
    errors = errors_of(measured, WHOLE)
    assert errors.pop("speed_m_s") == pytest.approx(-5.0)
    assert errors.pop("step_time_asymmetry_percent") == pytest.approx(2.0)
    assert errors.pop(RANGE) == pytest.approx(10.0)
    assert set(errors.values()) == {0.0}


@pytest.mark.parametrize("name", [*RELATIVE, *IN_POINTS])
def test_what_only_one_side_has_passes_no_limit(name: str) -> None:
    lacking = replace(WHOLE, **{name: None})
    assert errors_of(lacking, WHOLE)[name] == errors_of(WHOLE, lacking)[name] == inf
    assert errors_of(lacking, lacking)[name] == 0.0


def test_a_session_without_ranges_passes_no_limit() -> None:
    assert errors_of(replace(WHOLE, range_of_motion={}), WHOLE)[RANGE] == inf
    assert errors_of(WHOLE, replace(WHOLE, range_of_motion={}))[RANGE] == inf


def test_the_patients_are_named_in_the_language_in_use() -> None:
    found = [Compared(case=case, measured=WHOLE, true=WHOLE, errors=errors_of(WHOLE, WHOLE)) for case in CASES]
    use_language("zh")
    names = [str(cell) for cell in errors_table(found).columns[0].cells]
    assert names == ["1.70 m", "1.50 m", "1.90 m", "大腿较长", "步行缓慢", "坐下、起立、行走", "左步较短", "左步较长"]
    assert [one.as_json()["case"] for one in found[3:5]] == ["long thighs", "slow"]
