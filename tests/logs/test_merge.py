"""One timeline of two trails: where the clocks are known to a bound, every record is within it."""

from __future__ import annotations

import itertools
from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from logs.errors import AuditError, AuditFault
from logs.merge import Bound, Merged, merge, place_moment
from logs.reason import key_of
from logs.records import Note
from tests.support.two_trails import HOUR, MS, SECOND, Host, sign_again, two_hosts


def noted_ns(one: Merged) -> int | None:
    """The true time that a note says, by the first host's clock, which is the true one; None: no note."""
    return HOUR + int(str(one.record.body.text)) if isinstance(one.record.body, Note) else None


@given(
    ahead_ns=st.integers(-HOUR + 1, HOUR),
    drift_ppm=st.integers(-1000, 1000),
    errors=st.lists(st.tuples(st.floats(-1, 1), st.integers(0, 50 * MS)), min_size=4, max_size=4),
    notes=st.lists(st.tuples(st.integers(1, 600 * SECOND), st.booleans()), max_size=12),
)
@example(ahead_ns=0, drift_ppm=-1000, errors=[(0.0, 0)] * 4, notes=[(1, True)])
@settings(max_examples=40, deadline=None)
def test_times_are_right_within_the_printed_uncertainty(
    ahead_ns: int,
    drift_ppm: int,
    errors: list[tuple[float, int]],
    notes: list[tuple[int, bool]],
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    root = tmp_path_factory.mktemp("pair")
    hosts = Host(root / "a", "a"), Host(root / "b", "b", ahead_ns, drift_ppm)
    namings = [(600 * SECOND * (number + 1) // 5, number % 2, error) for number, error in enumerate(errors)]
    for at_ns, which in sorted([*((at, int(second)) for at, second in notes), *((at, who) for at, who, _ in namings)]):
        host, other = hosts[which], hosts[1 - which]
        error = next((error for at, who, error in namings if (at, who) == (at_ns, which)), None)
        if error is None:
            host.note(at_ns)
        else:
            share, bound_ns = error
            host.name(other, at_ns, error_ns=int(share * bound_ns), uncertainty_ns=bound_ns)
    for host in hosts:
        host.end(600 * SECOND)
    found = [(one.placed, noted_ns(one)) for one in merge(*(host.path for host in hosts))]
    placed = [(place, true_ns) for place, true_ns in found if true_ns is not None]
    clash = {(at, bool(who)) for at, who, _ in namings}
    assert len(placed) == sum(note not in clash for note in notes)
    for place, true_ns in placed:
        assert abs(place.at_ns - true_ns) <= place.uncertainty_ns + 1
    for (before, before_ns), (after, after_ns) in itertools.pairwise(placed):
        assert before_ns <= after_ns + before.uncertainty_ns + after.uncertainty_ns + 2


def test_an_hour_apart_and_drifting_the_order_is_the_true_one(tmp_path: Path) -> None:
    console, joints = two_hosts(tmp_path, ahead_ns=HOUR, drift_ppm=100)
    for first, second in ((console, joints), (joints, console)):
        found = merge(first.path, second.path)
        said = [int(str(one.record.body.text)) for one in found if isinstance(one.record.body, Note)]
        assert said == sorted(said)
        assert len(said) == 100
        assert max(one.placed.uncertainty_ns for one in found) < 3 * MS
        assert {one.placed.uncertainty_ns for one in found if one.trail == 0} == {0}


def test_the_quicker_of_two_estimates_counts_and_a_step_is_not_hidden() -> None:
    good = [Bound(0, -50 * MS, 50 * MS), Bound(10, -MS, 2 * MS)]
    assert place_moment(good, 5).uncertainty_ns < 2 * MS
    stepped = [Bound(0, -MS, MS), Bound(SECOND, 99 * MS, 101 * MS)]
    placed = place_moment(stepped, SECOND // 2)
    assert placed.uncertainty_ns >= 51 * MS, "before or after the step: both are possible"


def test_far_from_any_estimate_a_place_is_less_certain() -> None:
    assert place_moment([Bound(0, -MS, MS)], 1000 * SECOND).uncertainty_ns >= MS + 1_000 * MS


def test_trails_that_do_not_belong_together_are_refused(tmp_path: Path) -> None:
    console, joints = two_hosts(tmp_path / "one", seconds=1)
    strange, _ = two_hosts(tmp_path / "two", seconds=2)
    with pytest.raises(AuditError) as refused:
        merge(console.path, strange.path)
    assert key_of(refused.value.code) == key_of(AuditFault.TRAILS_NOT_JOINED)
    sign_again(joints.path, joints.key, lambda found: [one for one in found if not isinstance(one.body, Note)])
    with pytest.raises(AuditError) as refused:
        merge(console.path, joints.path)
    assert key_of(refused.value.code) == key_of(AuditFault.TRAILS_CONTRADICT)
