"""When the guardian acts, by the clock: never early, never late, never on its own lateness."""

from __future__ import annotations

import pytest

from app.ipc.messages import Heartbeat
from app.session.guardian import DAMP_NS, ENDING_DAMP_NS, OFF_NS, Doing, Watch, look

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


def off() -> Watch:
    """It has damped the joints and is switching them off."""
    watch, _ = watched(60)
    return look(watch, None, watch.since_ns + DAMP_NS + MS)


def test_it_watches_again_when_a_living_control_says_that_nothing_is_powered() -> None:
    watch = off()
    now_ns = watch.since_ns + OFF_NS + MS
    unpowered = Heartbeat(at_ns=now_ns, enabled=False)
    assert look(watch, unpowered, now_ns - 2 * MS).doing is Doing.OFF
    again = look(watch, unpowered, now_ns)
    assert again.doing is Doing.WATCH
    silent = look(again, Heartbeat(at_ns=now_ns, enabled=True), now_ns + MS)
    for step in range(1, 20):
        silent = look(silent, None, now_ns + step * LOOK)
    assert silent.doing is Doing.DAMP


@pytest.mark.parametrize(("enabled", "last"), [(True, False), (False, True)])
def test_neither_powered_drives_nor_a_last_word_make_it_watch_again(enabled: bool, last: bool) -> None:
    watch = off()
    now_ns = watch.since_ns + OFF_NS + MS
    assert look(watch, Heartbeat(at_ns=now_ns, enabled=enabled, last=last), now_ns).doing is Doing.OFF
    assert look(watch, None, now_ns).doing is Doing.OFF


def test_at_a_sessions_end_the_damping_is_short() -> None:
    watch, _ = watched(60)
    assert look(watch, None, watch.since_ns + ENDING_DAMP_NS + MS).doing is Doing.DAMP
    ended = look(watch, None, watch.since_ns + ENDING_DAMP_NS + MS, ending=True)
    assert ended.doing is Doing.OFF
    assert look(ended, None, ended.since_ns + 10 * DAMP_NS).doing is Doing.OFF
