"""When the guardian acts, by the clock: never early, never late, never on its own lateness."""

from __future__ import annotations

import pytest

from app.ipc.messages import Heartbeat
from app.ipc.streams import DAMP_NS
from app.session.heartbeat_check import (
    DAMPING_NS,
    ENDING_DAMP_NS,
    OFF_NS,
    WAIT_NS,
    GuardianAction,
    GuardianState,
    check_heartbeat,
)

MS = 1_000_000
CHECK = 4 * MS


def silent_for(
    silent_ms: int, *, enabled: bool = True, last: bool = False, unconfirmed: bool = False, step_ns: int = CHECK
) -> tuple[GuardianState, int]:
    """Looks at a heartbeat that falls silent; the state and when it began to act (ms after the last beat, or 0)."""
    state, acted_ms = GuardianState(), 0
    for now_ns in range(1_000 * MS, (1_000 + silent_ms) * MS, step_ns):
        newest = Heartbeat(at_ns=1_000 * MS, enabled=enabled, last=last, unconfirmed=unconfirmed)
        beat = newest if now_ns == 1_000 * MS else None
        state = check_heartbeat(state, beat, now_ns)
        if state.action is not GuardianAction.MONITOR and not acted_ms:
            acted_ms = now_ns // MS - 1_000
    return state, acted_ms


@pytest.mark.parametrize(
    ("enabled", "unconfirmed", "action"),
    [
        (True, False, GuardianAction.DAMP),
        (True, True, GuardianAction.DAMP),
        (False, True, GuardianAction.DAMP_LEFT_ON),
    ],
)
def test_it_damps_between_65_and_80_ms_after_the_last_beat_what_carries_power_or_may(
    enabled: bool, unconfirmed: bool, action: GuardianAction
) -> None:
    state, acted_ms = silent_for(90, enabled=enabled, unconfirmed=unconfirmed)
    assert state.action is action
    assert 65 < acted_ms < 80


def test_a_heartbeat_that_continues_is_left_alone() -> None:
    state = GuardianState()
    for now_ns in range(0, 2_000 * MS, CHECK):
        beat = Heartbeat(at_ns=now_ns, enabled=True) if now_ns % (20 * MS) == 0 else None
        state = check_heartbeat(state, beat, now_ns)
    assert state.action is GuardianAction.MONITOR


@pytest.mark.parametrize(("enabled", "last"), [(False, False), (True, True), (False, True)])
def test_without_power_or_after_a_good_end_there_is_nothing_to_do(enabled: bool, last: bool) -> None:
    assert silent_for(500, enabled=enabled, last=last)[0].action is GuardianAction.MONITOR


def test_a_control_that_awaits_the_drives_answers_is_given_three_seconds() -> None:
    state = GuardianState(heartbeat=Heartbeat(at_ns=0, enabled=False, unconfirmed=True, awaits_drives=True))
    for now_ns in range(0, WAIT_NS, CHECK):
        state = check_heartbeat(state, None, now_ns)
    assert state.action is GuardianAction.MONITOR
    for now_ns in range(WAIT_NS, WAIT_NS + 4 * CHECK, CHECK):
        state = check_heartbeat(state, None, now_ns)
    assert state.action is GuardianAction.DAMP_LEFT_ON


def test_before_the_first_beat_it_waits() -> None:
    state = GuardianState()
    for now_ns in range(0, 500 * MS, CHECK):
        state = check_heartbeat(state, None, now_ns)
    assert state.action is GuardianAction.MONITOR


@pytest.mark.parametrize("fresh_ms", [0, 60])  # how long control had been silent when both were frozen
def test_one_late_check_does_not_act(fresh_ms: int) -> None:
    """The host stood still: control can't have sent anything either, and does so in the next milliseconds."""
    state, _ = silent_for(fresh_ms + 4)
    for late_ms in (10_000, 10_013):
        now_ns = (1_000 + fresh_ms + late_ms) * MS
        state = check_heartbeat(state, None, now_ns)
        assert (state.action, state.missed) == (GuardianAction.MONITOR, int(late_ms > 10_000))
    state = check_heartbeat(state, Heartbeat(at_ns=now_ns, enabled=True), now_ns + 20 * MS)
    assert (state.action, state.missed) == (GuardianAction.MONITOR, 0)


@pytest.mark.parametrize("step_ms", [4, 11, 13, 20])
def test_a_guardian_that_is_late_again_and_again_acts_all_the_same(step_ms: int) -> None:
    _, acted_ms = silent_for(400, step_ns=step_ms * MS)
    assert 65 < acted_ms <= 65 + 3 * step_ms


def test_it_continues_to_the_end_whatever_control_reports_then() -> None:
    state, _ = silent_for(90)
    back = Heartbeat(at_ns=1_100 * MS, enabled=True)
    assert check_heartbeat(state, back, 1_100 * MS).action is GuardianAction.DAMP
    assert check_heartbeat(state, back, state.since_ns + DAMP_NS).action is GuardianAction.DAMP
    assert check_heartbeat(state, back, state.since_ns + DAMP_NS + MS).action is GuardianAction.SWITCH_OFF


def off() -> GuardianState:
    """It has damped the joints and is switching them off."""
    state, _ = silent_for(90)
    return check_heartbeat(state, None, state.since_ns + DAMP_NS + MS)


def test_it_watches_again_when_a_control_reports_that_nothing_is_powered() -> None:
    state = off()
    now_ns = state.since_ns + OFF_NS + MS
    unpowered = Heartbeat(at_ns=now_ns, enabled=False)
    assert check_heartbeat(state, unpowered, now_ns - 2 * MS).action is GuardianAction.SWITCH_OFF
    again = check_heartbeat(state, unpowered, now_ns)
    assert again.action is GuardianAction.MONITOR
    silent = check_heartbeat(again, Heartbeat(at_ns=now_ns, enabled=True), now_ns + MS)
    for step in range(1, 20):
        silent = check_heartbeat(silent, None, now_ns + step * CHECK)
    assert silent.action is GuardianAction.DAMP


@pytest.mark.parametrize(("enabled", "last"), [(True, False), (False, True)])
def test_neither_powered_drives_nor_a_last_message_make_it_watch_again(enabled: bool, last: bool) -> None:
    state = off()
    now_ns = state.since_ns + OFF_NS + MS
    assert (
        check_heartbeat(state, Heartbeat(at_ns=now_ns, enabled=enabled, last=last), now_ns).action
        is GuardianAction.SWITCH_OFF
    )
    assert check_heartbeat(state, None, now_ns).action is GuardianAction.SWITCH_OFF


def test_at_a_sessions_end_the_damping_is_short() -> None:
    state, _ = silent_for(90)
    assert check_heartbeat(state, None, state.since_ns + ENDING_DAMP_NS + MS).action is GuardianAction.DAMP
    ended = check_heartbeat(state, None, state.since_ns + ENDING_DAMP_NS + MS, ending=True)
    assert ended.action is GuardianAction.SWITCH_OFF
    assert check_heartbeat(ended, None, ended.since_ns + 10 * DAMP_NS).action is GuardianAction.SWITCH_OFF


def test_an_older_beat_received_again_makes_nobody_silent_or_alive() -> None:
    """Not even one that said that nothing is powered."""
    old = Heartbeat(at_ns=0, enabled=False)
    state = GuardianState()
    for now_ns in range(CHECK, 2_000 * MS, CHECK):
        beat = Heartbeat(at_ns=now_ns, enabled=True) if now_ns <= 1_000 * MS else old
        state = check_heartbeat(check_heartbeat(state, beat, now_ns), old, now_ns)
        if now_ns <= 1_000 * MS:
            assert state.action is GuardianAction.MONITOR
    assert state.action is not GuardianAction.MONITOR


@pytest.mark.parametrize("late_ms", [14, 10_000])
def test_a_late_check_evaluates_no_moment_a_second_time(late_ms: int) -> None:
    state, _ = silent_for(72)
    assert (state.action, state.missed) == (GuardianAction.MONITOR, 1)
    late = check_heartbeat(state, None, state.checked_ns + late_ms * MS)
    assert (late.action, late.missed) == (GuardianAction.MONITOR, 1)
    assert check_heartbeat(late, None, late.checked_ns + CHECK).action is GuardianAction.DAMP


@pytest.mark.parametrize("unconfirmed", [False, True])
@pytest.mark.parametrize("enabled", [False, True])
def test_damping_is_not_broken_off_by_a_control_that_reports_no_power(enabled: bool, unconfirmed: bool) -> None:
    """Neither what carried power nor what only had not confirmed that it is off."""
    state, _ = silent_for(90, enabled=enabled, unconfirmed=not enabled)
    damps = state.action
    assert damps is (GuardianAction.DAMP if enabled else GuardianAction.DAMP_LEFT_ON)
    for now_ns in range(state.since_ns + CHECK, state.since_ns + DAMPING_NS[damps], CHECK):
        state = check_heartbeat(state, Heartbeat(at_ns=now_ns, enabled=False, unconfirmed=unconfirmed), now_ns)
        assert state.action is damps
