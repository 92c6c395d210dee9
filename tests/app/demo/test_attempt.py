"""The figures of a attempt come from control's own moments, and are absent where a moment never came."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.demo.scenario import Attempt, spread, success
from app.ipc.snapshot import ActionReport
from app.ipc.states import Action, GaitState, Source
from kgdfa.gesture import Gesture


def attempt(report: ActionReport | None, *, ok: bool = True) -> Attempt:
    return Attempt(
        gesture=Gesture.ONE,
        recognised=True,
        pressed=True,
        start=GaitState.STANDING,
        end=GaitState.RIGHT_FORWARD,
        ok=ok,
        reason=None,
        report=report,
    )


def report(*, recognised_ns: int, released_ns: int, first_command_ns: int) -> ActionReport:
    return ActionReport(
        number=1,
        action=Action.STEP_RIGHT_FIRST,
        source=Source.GESTURE,
        from_state=GaitState.STANDING,
        tracking_rms_rad=0.01,
        recognised_ns=recognised_ns,
        released_ns=released_ns,
        first_command_ns=first_command_ns,
    )


def test_responses_run_from_capture_to_command_and_to_motion() -> None:
    one = attempt(report(recognised_ns=1_000_000, released_ns=301_000_000, first_command_ns=351_000_000))
    assert one.response_from_recognition_ms == pytest.approx(350.0)
    assert one.response_from_release_ms == pytest.approx(50.0)
    assert one.visible_motion_ms is None
    assert one.tracking_rms_deg == pytest.approx(math.degrees(0.01))


def test_without_an_action_there_is_no_figure() -> None:
    row = attempt(None, ok=False).row()
    assert row["response_from_release_ms"] is None
    assert row["tracking_rms_deg"] is None
    assert row["ok"] is False


@given(st.lists(st.one_of(st.none(), st.floats(0, 1e4)), max_size=50))
def test_spread_counts_only_what_exists(values: list[float | None]) -> None:
    known = [value for value in values if value is not None]
    figure = spread(values)
    if not known:
        assert figure is None
        return
    assert figure is not None
    assert figure.n == len(known)
    assert min(known) - 1e-6 <= figure.p50 <= figure.p99 <= max(known) + 1e-6


def test_success_is_the_share_that_did_what_was_signed() -> None:
    assert success([attempt(None), attempt(None, ok=False)]) == 0.5
    assert success([]) == 0.0
