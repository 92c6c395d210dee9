from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from app.evaluate.gestures.measures import SequenceFigures, measure_sequence, run_sequence, verdicts_and_votes
from app.evaluate.gestures.report import sequence_shown, sequence_table
from app.evaluate.harness import FRAME_NS, EvaluateFault
from app.evaluate.readings import Footage
from app.perception.pipeline import RULES
from app.system.errors import AppError
from kgdfa.gesture import Gesture, Vote, update_vote


def test_a_steady_sequence_is_all_right() -> None:
    labels = ["skip", *["1"] * 8, "skip", *["2"] * 8]
    voted = ["none", "none", "none", *["1"] * 9, *["2"] * 6]
    figures = measure_sequence(labels, labels, voted)
    assert (figures.shown, figures.recognised, figures.broken, figures.false_onsets) == (2, 2, 0, 0)
    assert figures.delay_frames == 2
    assert figures.frame_accuracy == 1
    assert figures.voted_accuracy == pytest.approx(12 / 16)


def test_a_broken_gesture_and_a_false_onset_are_counted() -> None:
    labels = [*["1"] * 10, *["none:ok"] * 30]
    voted = ["none", "none", "1", "1", "none", "1", "1", "1", "1", "1", *["none"] * 25, *["5"] * 5]
    figures = measure_sequence(labels, voted, voted)
    assert (figures.shown, figures.recognised, figures.broken, figures.false_onsets) == (1, 1, 1, 1)


def test_a_gesture_never_reported_is_not_recognised() -> None:
    figures = measure_sequence(["3"] * 6, ["none"] * 6, ["none"] * 6)
    assert (figures.shown, figures.recognised, figures.delay_frames) == (1, 0, None)
    cells = [str(cell) for cell in sequence_table(Path("video"), {"robust": figures}).columns[1].cells]
    assert cells[-3:-1] == ["–", "–"]


# A gesture voted, one too short to be, one voted 8 frames early and one 9 frames early: at 30 Hz.
LABELS = [*["1"] * 10, *["none:ok"] * 9, *["2"] * 3, *["none:ok"] * 12, *["3"] * 9, *["none:ok"] * 12, *["4"] * 4]
VOTED = [*["none"] * 2, *["1"] * 9, *["none"] * 15, *["3"] * 17, *["none"] * 3, *["4"] * 13]


@pytest.mark.parametrize("times", [1, 2, 4, 8])
def test_a_faster_camera_has_the_same_figures(times: int) -> None:
    assert len(LABELS) == len(VOTED) == 59
    labels, voted = (np.repeat(some, times).tolist() for some in (LABELS, VOTED))
    figures = measure_sequence(labels, voted, voted, FRAME_NS // times)
    assert (figures.shown, figures.recognised, figures.broken, figures.false_onsets) == (3, 3, 0, 1)
    assert figures.delay_frames == times * 2 / 3
    assert figures.delay_ms == pytest.approx(2 / 3 * 1000 / 30)


@pytest.mark.parametrize("rate_hz", [15.0, 25.0, 29.97, 30.0, 30.3, 50.0, 60.0, 120.0, 240.0])
def test_a_perfect_hand_that_counts_as_shown_is_voted(rate_hz: float) -> None:
    period_ns = round(1e9 / rate_hz)
    for frames in range(1, 60):
        vote, voted = Vote(), []
        for number in range(frames):
            vote = update_vote(vote, Gesture.TWO, (number + 1) * period_ns)
            voted.append(vote.gesture.value if vote.gesture else "none")
        figures = measure_sequence(["2"] * frames, voted, voted, period_ns)
        assert figures.recognised == figures.shown == (frames * period_ns > 3.5 * FRAME_NS and frames > 3)


def test_the_chain_over_footage_guides_its_detector_as_a_sessions_does(monkeypatch: pytest.MonkeyPatch) -> None:
    followed: list[object] = []

    def follow(*what: object) -> None:
        followed.append(what)

    detector: Any = SimpleNamespace(detect=lambda *_: (), follow=follow)
    monkeypatch.setattr("kgdfa.keypoints.live_detector", lambda _: nullcontext(detector))
    image = np.zeros((90, 160, 3), np.uint8)
    footage = Footage(
        labels=("skip",) * 3,
        focal_px=160.0,
        reference_m=0.08,
        period_ns=33_000_000,
        frames=lambda: iter([image, None, image]),
    )
    reports = run_sequence(footage, Path("model"), RULES["robust"]())
    assert [report is None for report in reports] == [False, True, False], "one that can't be read"
    assert verdicts_and_votes(reports) == (["none", None, "none"], ["none"] * 3)
    assert len(followed) == 2


def test_a_frame_that_can_not_be_read_refuses_nothing_and_ends_no_vote() -> None:
    three: Any = SimpleNamespace(verdict=SimpleNamespace(gesture=Gesture.THREE), gesture=Gesture.THREE)
    nothing: Any = SimpleNamespace(verdict=None, gesture=None)
    raw, voted = verdicts_and_votes([None, *[three] * 4, None, *[three] * 4, nothing, None, three, nothing])
    assert voted == ["none", *["3"] * 9, "none", "none", "3", "none"]
    figures = measure_sequence([*["3"] * 10, *["none:ok"] * 4], raw, voted)
    assert figures.frame_accuracy == pytest.approx((8 + 2) / (10 + 3)), "the eleventh, twelfth and fourteenth"
    assert figures.voted_accuracy == pytest.approx((9 + 2) / (10 + 3))
    assert (figures.shown, figures.recognised, figures.broken, figures.delay_frames) == (1, 1, 0, 1)
    unread = measure_sequence(["none:ok"] * 5, [None] * 5, ["none"] * 5)
    assert (unread.frame_accuracy, unread.voted_accuracy) == (None, None)


def test_footage_of_which_no_frame_can_be_read_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    detector: Any = SimpleNamespace(follow=None)
    monkeypatch.setattr("kgdfa.keypoints.live_detector", lambda _: nullcontext(detector))
    footage = Footage(
        labels=("none:ok",) * 2,
        focal_px=160.0,
        reference_m=0.08,
        period_ns=33_000_000,
        frames=lambda: iter([None, None]),
        paths=(Path("a/1.jpg"), Path("a/2.jpg")),
    )
    with pytest.raises(AppError) as refused:
        run_sequence(footage, Path("model"), RULES["robust"]())
    assert (refused.value.code, refused.value.values["file"]) == (EvaluateFault.IMAGE_UNREADABLE, Path("a/1.jpg"))


def test_counts_and_shares_of_footage_are_not_rounded_up() -> None:
    figures = SequenceFigures(
        frames=5412,
        frame_accuracy=0.9996,
        voted_accuracy=0.5,
        shown=1234,
        recognised=1234,
        broken=0,
        delay_frames=2.25,
        delay_ms=75.0,
        false_onsets=3,
    )
    cells = [str(cell) for cell in sequence_table(Path("video"), {"robust": figures}).columns[1].cells]
    assert cells == ["5412", "0.9996", "0.5000", "1234", "1234", "0", "2.2500", "75.0000", "3"]


@pytest.mark.parametrize(("claimed", "lines"), [(None, 0), (0, 0), (5, 0), (6, 1)])
def test_a_header_that_claims_more_frames_than_can_be_read_is_shown(claimed: int | None, lines: int) -> None:
    figures = {"robust": measure_sequence(["skip"] * 3, ["none"] * 3, ["none"] * 3)}
    cut = [*sequence_shown(Path("a.avi"), figures, [], claimed)][1:]
    assert len(cut) == lines
    assert all(f"estimates {claimed}: cut off, damaged, or of an uneven rate" in str(line) for line in cut)
    (unreadable,) = [*sequence_shown(Path("a"), figures, [Path("a/1.jpg")], None)][1:]
    assert str(unreadable).startswith("a/1.jpg can't be read: its single verdict is none where a gesture is shown")
