"""Every command ends in exactly one class, whatever the replies do."""

from __future__ import annotations

from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hal.joints.can.driver import SocketCanJoints
from testing.request_tracker import RequestTracker, TrackedDrive
from tests.support.can_rig import MakeRig, with_motor

TICK_NS = 2_000_000
MS = 1_000_000


def run(requests: RequestTracker, delays_ms: Sequence[float | None], ticks_more: int = 0) -> None:
    """One command a tick; its reply comes after the delay, None: never. Replies are taken in at ticks, in order."""
    replies = sorted(n * TICK_NS + round(delay * MS) for n, delay in enumerate(delays_ms) if delay is not None)
    for tick in range(len(delays_ms) + ticks_more):
        now_ns = tick * TICK_NS
        while replies and replies[0] <= now_ns:
            requests.receive(replies.pop(0))
        requests.poll(now_ns)
        if tick < len(delays_ms):
            requests.send(now_ns)


@given(st.lists(st.one_of(st.none(), st.floats(0.1, 80.0)), max_size=60))
def test_the_classes_add_up(delays_ms: list[float | None]) -> None:
    requests = RequestTracker()
    run(requests, delays_ms, ticks_more=60)
    assert requests.sent == len(delays_ms) == requests.answered + requests.late + requests.missed + requests.in_flight
    assert requests.in_flight == 0
    assert requests.missed >= 0


def test_punctual_replies_are_answers() -> None:
    requests = RequestTracker()
    run(requests, [0.6] * 200, ticks_more=1)
    assert (requests.answered, requests.late, requests.missed) == (200, 0, 0)
    assert set(requests.round_trips_ns) == {600_000}


def test_replies_held_up_for_long_are_late_and_not_missed() -> None:
    """A host that stands for 40 ms and then delivers all at once."""
    requests = RequestTracker()
    held_up = [40.0 - 2.0 * n for n in range(20)]
    run(requests, [0.6] * 50 + held_up + [0.6] * 50, ticks_more=20)
    assert requests.missed == 0
    assert requests.late > 0
    assert requests.answered + requests.late == 120


@pytest.mark.parametrize("usual_ms", [0.6, 2.6, 7.0])
def test_one_lost_reply_is_one_missed_command_and_shifts_no_other(usual_ms: float) -> None:
    requests = RequestTracker()
    run(requests, [usual_ms] * 100 + [None] + [usual_ms] * 100, ticks_more=10)
    assert (requests.answered, requests.late, requests.missed) == (200, 0, 1)
    assert list(requests.round_trips_ns)[-1] == round(usual_ms * MS)


def test_slow_replies_at_a_steady_pace_are_not_missed() -> None:
    requests = RequestTracker()
    run(requests, [9.0] * 500, ticks_more=10)
    assert (requests.answered, requests.missed) == (500, 0)


def test_missing_replies_are_counted_and_late_ones_no_more_than_those() -> None:
    requests = RequestTracker()
    run(requests, [None] * 30, ticks_more=20)
    assert requests.missed == 30
    for _ in range(31):
        requests.receive(10**9)
    assert (requests.missed, requests.late) == (0, 30)


def test_a_drive_of_a_benchmark_tracks_what_it_is_asked_and_answers(make_rig: MakeRig) -> None:
    rig = make_rig(with_motor("AK80-64/V2"))
    assert isinstance(rig.joints, SocketCanJoints)
    tracked = tuple(TrackedDrive(drive.joint, drive.device, drive.model) for drive in rig.joints.drives)
    rig.joints.drives = tracked
    rig.joints.open(rig.now_ns())
    rig.joints.close(rig.now_ns())
    for drive in tracked:
        assert drive.requests.sent >= drive.requests.answered == drive.replies > 0
