"""Table 7's account: what counts as a trial, when a round goes on, and what is told of failures."""

from __future__ import annotations

import errno
from collections.abc import Callable, Sequence
from enum import Enum
from itertools import count
from pathlib import Path

import pytest

from app.demo.drives import DemoFault
from app.demo.scenario import ALL_TWELVE, Attempt, Step
from app.demo.session import SessionResult
from app.evaluate.harness import EvaluateFault
from app.evaluate.loop.response import ATTEMPTS, Rounds, Watch, evaluate_response, shared, wearer
from app.evaluate.loop.table7 import PAPER, ResponseResult, response_table, shown
from app.ipc.snapshot import ActionReport
from app.ipc.states import ACTION_OF, Action, GaitState, Source
from app.system.config import Config
from app.system.errors import AppError
from app.system.paths import Home
from app.text.catalogue import tr
from kgdfa.button_state import PressCancel, PressHint
from kgdfa.gesture import Gesture
from logs.reason import reason, reason_of
from tests.app.demo.sessions import session_of
from tests.support.disks import full_disk

MS = 1_000_000


class Hand:
    """A runner whose every trial is decided by a function of its number and leg."""

    def __init__(self, decide: Callable[[int, Step], bool]) -> None:
        self.allowed: tuple[Action, ...] = ()
        self.decide = decide
        self.made = 0
        self.click_s = 0.0
        self.clicks_s: list[float] = []
        self.powered_off = 0
        self.can_power_off = True
        self.moved_anyway = False

    def run(self, leg: Step) -> Attempt:
        ok = self.decide(self.made, leg)
        self.clicks_s.append(self.click_s)
        self.made += 1
        self.allowed = () if self.moved_anyway else (ACTION_OF[leg.gesture],)
        return attempt(leg.gesture, ok=ok)

    def relax(self) -> None:
        pass

    def power_off(self) -> bool:
        self.powered_off += 1
        return self.can_power_off


def attempt(gesture: Gesture, *, ok: bool = True, why: Enum = PressHint.PUSH_STEADILY) -> Attempt:
    report = ActionReport(
        number=1,
        action=ACTION_OF[gesture],
        source=Source.GESTURE,
        from_state=GaitState.STANDING,
        recognised_ns=1000 * MS,
        released_ns=1300 * MS,
        first_command_ns=1345 * MS,
        first_motion_ns=1400 * MS,
    )
    return Attempt(
        gesture=gesture,
        recognised=True,
        pressed=ok,
        start=GaitState.STANDING,
        end=GaitState.STANDING,
        ok=ok,
        reason=None if ok else reason(why),
        report=report if ok else None,
    )


def result_of(*attempts: Attempt) -> ResponseResult:
    return ResponseResult(sessions=(session_of(attempts),))


def test_every_round_powers_the_legs_anew_and_makes_all_twelve() -> None:
    hand, rounds = Hand(lambda _, __: True), Rounds(3)
    attempts = rounds.run_attempts(hand, ALL_TWELVE)
    assert [one.gesture for one in attempts] == [leg.gesture for leg in ALL_TWELVE] * 3
    assert rounds.left == 0
    assert hand.powered_off == 2, "between rounds, not after the last"


def test_every_push_takes_as_long_as_was_drawn_for_it() -> None:
    hand = Hand(lambda _, __: True)
    Rounds(2, (0.3, 0.8)).run_attempts(hand, ALL_TWELVE)
    assert len(set(hand.clicks_s)) == 24
    assert 0.3 <= min(hand.clicks_s) < max(hand.clicks_s) <= 0.8


def test_an_attempt_that_did_nothing_counts_and_is_made_again() -> None:
    attempts = Rounds(1).run_attempts(Hand(lambda made, _: made != 4), ALL_TWELVE)
    assert len(attempts) == 13
    assert [one.gesture for one in attempts if not one.ok] == [ALL_TWELVE[4].gesture]
    assert result_of(*attempts).as_json()["success"] == pytest.approx(12 / 13, abs=1e-4)


def test_a_transition_that_never_works_ends_the_session_with_the_round_unmade() -> None:
    rounds = Rounds(2)
    attempts = rounds.run_attempts(Hand(lambda _, leg: leg.gesture is not Gesture.TWO), ALL_TWELVE)
    assert sum(one.gesture is Gesture.TWO for one in attempts) == ATTEMPTS
    assert rounds.left == 2


def test_a_failure_that_moved_the_legs_is_not_tried_again() -> None:
    hand, rounds = Hand(lambda made, _: made != 2), Rounds(1)
    hand.moved_anyway = True
    assert len(rounds.run_attempts(hand, ALL_TWELVE)) == 3
    assert rounds.left == 1


def test_legs_that_keep_their_power_end_the_session() -> None:
    hand, rounds = Hand(lambda _, __: True), Rounds(3)
    hand.can_power_off = False
    assert len(rounds.run_attempts(hand, ALL_TWELVE)) == 12
    assert rounds.left == 2


def test_an_interruption_keeps_the_attempts_made() -> None:
    def interrupt(made: int, _: Step) -> bool:
        if made == 7:
            raise KeyboardInterrupt
        return True

    rounds = Rounds(1)
    assert len(rounds.run_attempts(Hand(interrupt), ALL_TWELVE)) == 7
    assert rounds.interrupted


def evaluated(folder: Path, trials: int, *, seeds: Sequence[int] = (1, 2), stops_after: int = 10_000) -> ResponseResult:
    """An evaluation by hands that never fail; interrupted in the attempt after so many."""
    hand = Hand(lambda made, _: made < stops_after or _interrupt())

    def run(_home: Home, _config: Config, rounds: Rounds, _watch: Watch) -> SessionResult:
        return session_of(rounds.run_attempts(hand, ALL_TWELVE))

    return evaluate_response(
        Home(folder),
        Config(),
        attempts=trials,
        seeds=seeds,
        click_s=(0.3, 0.8),
        watch=lambda _: None,
        keep=folder / "kept.jsonl",
        run=run,
    )


def _interrupt() -> bool:
    raise KeyboardInterrupt


def test_an_interrupted_evaluation_goes_on_from_what_is_kept(tmp_path: Path) -> None:
    first = evaluated(tmp_path, 16, stops_after=12 * 7 + 3)
    assert (first.interrupted, len(first.attempts)) == (True, 12 * 7 + 3)
    whole = evaluated(tmp_path, 16)
    assert not whole.interrupted
    assert whole.attempts[: 12 * 7 + 3] == first.attempts
    assert len(whole.attempts) == 12 * 16 + 3, "the round that was interrupted is made again"
    assert len(whole.programs) == 1
    assert evaluated(tmp_path, 16).as_json() == whole.as_json(), "nothing is left to make"


LATER = [
    KeyboardInterrupt(),
    AppError(DemoFault.CONTROL_SILENT, limit_s=60.0),
    OSError(errno.ENOSPC, "No space left on device"),
]


def evaluated_until(error: BaseException, number: int) -> ResponseResult:
    """An evaluation of one hand whose session of this number, from 0, raises outside of its attempts."""
    hand, begun = Hand(lambda _, __: True), count()

    def run(_home: Home, _config: Config, rounds: Rounds, _watch: Watch) -> SessionResult:
        if next(begun) == number:
            raise error
        return session_of(rounds.run_attempts(hand, ALL_TWELVE))

    return evaluate_response(
        Home(Path()), Config(), attempts=15, seeds=[1], click_s=(0.3, 0.3), watch=lambda _: None, run=run
    )


@pytest.mark.parametrize("error", LATER, ids=repr)
def test_a_later_session_that_can_not_be_run_costs_none_of_those_before(error: BaseException) -> None:
    result = evaluated_until(error, 2)
    assert len(result.attempts) == 12 * 10
    assert result.interrupted == isinstance(error, KeyboardInterrupt)
    assert result.gave_up == (None if result.interrupted else reason_of(error))
    assert isinstance(list(shown(result))[-1], str)


def test_a_first_session_that_can_not_be_run_is_its_own_error() -> None:
    with pytest.raises(AppError) as refused:
        evaluated_until(LATER[1], 0)
    assert refused.value.code is DemoFault.CONTROL_SILENT


def test_a_full_disk_beneath_what_is_kept_costs_no_session(tmp_path: Path) -> None:
    with full_disk(1):
        result = evaluated(tmp_path, 1, seeds=(1,))
    assert (len(result.attempts), result.gave_up and result.gave_up.code) == (12, "EvaluateFault.FILE_UNWRITABLE")


def test_the_summary_of_attempts_without_one_command_has_dashes() -> None:
    text = list(shown(result_of(attempt(Gesture.ZERO, ok=False))))[-1]
    assert isinstance(text, str)
    assert "success 0.00 % of 1, mean response – s" in text
    assert "visible – s" in text
    assert "p50 – ms, p99 – ms" in text


def test_what_is_kept_of_other_hands_is_refused(tmp_path: Path) -> None:
    evaluated(tmp_path, 2)
    with pytest.raises(AppError) as refused:
        evaluated(tmp_path, 2, seeds=(2, 3))
    assert refused.value.code is EvaluateFault.PROGRESS_OF_OTHERS


def test_attempts_are_shared_evenly_among_the_hands() -> None:
    assert list(shared(50, (1, 2, 3))) == [(1, 17), (2, 17), (3, 16)]


def test_every_hand_is_measured_and_has_its_button_where_the_paper_has_it() -> None:
    first, second = wearer(1), wearer(2)
    assert first.palm != second.palm
    assert first.press_threshold_m == second.press_threshold_m >= 0.20


def test_figures_run_from_recognition_and_from_release() -> None:
    figures = result_of(attempt(Gesture.ONE), attempt(Gesture.TWO)).as_json()
    assert figures["response_s"] == pytest.approx(0.345)
    assert figures["visible_s"] == pytest.approx(0.4)
    assert figures["release_to_command_ms"] == {"p50": 45.0, "p99": 45.0}
    assert figures["per_gesture"]["1"]["trials"] == 1
    assert figures["per_gesture"]["9"]["success"] is None


def test_failures_are_reported_by_gesture_and_reason_the_commonest_first() -> None:
    lost = attempt(Gesture.SEVEN, ok=False, why=PressCancel.HAND_LOST)
    figures = result_of(attempt(Gesture.ONE, ok=False), lost, lost).as_json()
    assert figures["failures"] == [
        {"gesture": "7", "reason": tr(PressCancel.HAND_LOST), "times": 2},
        {"gesture": "1", "reason": tr(PressHint.PUSH_STEADILY), "times": 1},
    ]


def test_the_table_has_a_row_a_gesture() -> None:
    assert response_table(result_of(attempt(Gesture.ONE))).row_count == len(PAPER) == 12
