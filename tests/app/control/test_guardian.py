"""When the guardian acts, by the clock: never early, never late, never on its own lateness."""

from __future__ import annotations

import pytest

from app.guardian import DAMP_NS, ENDING_DAMP_NS, Doing, Watch, look
from app.messages import Heartbeat

MS = 1_000_000
LOOK = 4 * MS


def watched(silent_ms: int, *, enabled: bool = True, last: bool = False, step_ns: int = LOOK) -> tuple[Watch, int]:
    """Looks at a heartbeat that falls silent; the watch and when it began to act (ms after the last beat, or 0)."""
    watch, acted_ms = Watch(), 0
    for now_ns in range(1_000 * MS, (1_000 + silent_ms) * MS, step_ns):
        beat = Heartbeat(at_ns=1_000 * MS, enabled=enabled, last=last) if now_ns == 1_000 * MS else None
        watch = look(watch, beat, now_ns)
        if watch.doing is not Doing.WATCH and not acted_ms:
            acted_ms = now_ns // MS - 1_000
    return watch, acted_ms


def test_it_damps_between_35_and_50_ms_after_the_last_beat() -> None:
    watch, acted_ms = watched(60)
    assert watch.doing is Doing.DAMP
    assert 35 < acted_ms < 50


def test_a_heartbeat_that_goes_on_is_left_alone() -> None:
    watch = Watch()
    for now_ns in range(0, 2_000 * MS, LOOK):
        beat = Heartbeat(at_ns=now_ns, enabled=True) if now_ns % (20 * MS) == 0 else None
        watch = look(watch, beat, now_ns)
    assert watch.doing is Doing.WATCH


@pytest.mark.parametrize(("enabled", "last"), [(False, False), (True, True), (False, True)])
def test_without_power_or_after_a_good_end_there_is_nothing_to_do(enabled: bool, last: bool) -> None:
    assert watched(500, enabled=enabled, last=last)[0].doing is Doing.WATCH


def test_before_the_first_beat_it_waits() -> None:
    watch = Watch()
    for now_ns in range(0, 500 * MS, LOOK):
        watch = look(watch, None, now_ns)
    assert watch.doing is Doing.WATCH


def test_a_guardian_that_is_late_itself_does_not_act_on_it() -> None:
    assert watched(400, step_ns=20 * MS)[0].doing is Doing.WATCH


def test_it_goes_on_to_the_end_whatever_control_says_then() -> None:
    watch, _ = watched(60)
    back = Heartbeat(at_ns=1_100 * MS, enabled=True)
    assert look(watch, back, 1_100 * MS).doing is Doing.DAMP
    assert look(watch, back, watch.since_ns + DAMP_NS).doing is Doing.DAMP
    assert look(watch, back, watch.since_ns + DAMP_NS + MS).doing is Doing.OFF


def test_at_a_sessions_end_the_damping_is_short() -> None:
    watch, _ = watched(60)
    assert look(watch, None, watch.since_ns + ENDING_DAMP_NS + MS).doing is Doing.DAMP
    off = look(watch, None, watch.since_ns + ENDING_DAMP_NS + MS, ending=True)
    assert off.doing is Doing.OFF
    assert look(off, None, off.since_ns + 10 * DAMP_NS).doing is Doing.OFF
