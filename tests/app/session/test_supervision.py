"""Perception is started again when it died or froze, with patience, and not for ever."""

from __future__ import annotations

from itertools import pairwise

from app.session.child import BACK_OFF_S, FIRST_REPORT_S, SILENCE_S, Supervisor


def test_a_reporting_perception_is_left_alone() -> None:
    supervisor = Supervisor()
    assert not any(supervisor.must_restart(0.1 * i, alive=True, reported=True) for i in range(1000))


def test_a_dead_one_is_started_again_and_given_up_in_the_end() -> None:
    supervisor = Supervisor()
    restarts = [t for i in range(10_000) if supervisor.must_restart(t := i * 0.1, alive=False, reported=False)]
    assert len(restarts) == len(BACK_OFF_S)
    pauses = [after - before for before, after in pairwise(restarts)]
    assert pauses == sorted(pauses)


def test_a_frozen_one_is_started_again_after_its_timeout() -> None:
    supervisor = Supervisor()
    assert not supervisor.must_restart(0.0, alive=True, reported=True)
    assert not supervisor.must_restart(SILENCE_S * 0.9, alive=True, reported=False)
    assert supervisor.must_restart(SILENCE_S * 1.1, alive=True, reported=False)


def test_loading_the_model_is_not_mistaken_for_a_freeze() -> None:
    supervisor = Supervisor()
    assert not supervisor.must_restart(0.0, alive=True, reported=False)
    assert not supervisor.must_restart(FIRST_REPORT_S * 0.9, alive=True, reported=False)
    assert supervisor.must_restart(FIRST_REPORT_S * 1.1, alive=True, reported=False)
