"""Table 6's way of counting, on hands whose keypoints are known: no hand model is needed."""

from __future__ import annotations

from typing import cast

import pytest

from app.evaluate.digital_scenes import CHANGES, FLIP, Moment
from app.evaluate.trigger import CAMERAS, Change, Outcome, look_at
from app.evaluate.watcher import BLANK, FRAME_NS, GAP_NS, Watcher
from kgdfa.hand import Hand
from kgdfa.keypoints import HandDetector
from kgdfa.preprocess import Image
from tests.app.evaluate.seen_hands import seen_hand


class Knowing:
    """A detector of ours that knows where the hands of the moments to come are."""

    def __init__(self, moments: list[Moment]) -> None:
        self.moments = list(moments)
        self.seen_ns: list[int] = []

    def detect(self, image_bgr: Image, captured_ns: int) -> tuple[Hand, ...]:
        self.seen_ns.append(captured_ns)
        if image_bgr is BLANK or not self.moments:
            return ()
        hand = seen_hand(self.moments.pop(0).scene, tracked=len(self.moments) > 0)
        assert hand is not None
        return (hand,)


def judged(change: Change, *, blind: bool = False) -> Outcome:
    detector = Knowing([] if blind else change.moments())
    return look_at(Watcher(cast(HandDetector, detector)), change)


def change_at(distance_cm: int) -> Change:
    return Change(distance_cm=distance_cm, number=CHANGES.index(FLIP), focal_px=650.0)


def test_a_hand_well_within_the_threshold_presses_both_cameras_buttons() -> None:
    assert {(camera, "robust") for camera in CAMERAS} <= judged(change_at(12)).pressed


def test_a_flip_far_off_presses_only_what_takes_zero_for_a_distance() -> None:
    outcome = judged(change_at(40))
    assert outcome.pressed == {("D435i", "published")}
    assert outcome.commands["D435i", "robust"] == outcome.commands["monocular", "robust"] == 0


def test_no_hand_presses_nothing() -> None:
    assert judged(change_at(20), blind=True).pressed == frozenset()


def test_each_change_is_another_hand_the_same_at_every_distance() -> None:
    assert change_at(20).person == change_at(60).person
    other = Change(distance_cm=20, number=1, focal_px=650.0)
    assert other.person != change_at(20).person


def test_forgetting_shows_an_empty_room_after_a_pause() -> None:
    detector = Knowing([])
    watcher = Watcher(cast(HandDetector, detector))
    watcher.look(BLANK)
    watcher.forget()
    first, second, third = detector.seen_ns
    assert second - first == GAP_NS + FRAME_NS
    assert third - second == pytest.approx(FRAME_NS)
