"""Table 6's way of counting, on hands whose keypoints are known: no hand model is needed."""

from __future__ import annotations

from typing import cast

import pytest

from app.evaluate.detector_pool import PoolDetector
from app.evaluate.hand_motions import CHANGES, EDGE, EDGE_SHARE, FLIP, OPEN_CLOSE, Moment
from app.evaluate.trigger.chain import CAMERAS
from app.evaluate.trigger.table6 import Change, ChangeOutcome, run_change
from kgdfa.hand import Hand
from kgdfa.keypoints import HandDetector
from kgdfa.preprocess import Image
from tests.support.known_hands import known_hand


class Knowing:
    """A detector of ours that knows where the hands of the moments to come are."""

    def __init__(self, moments: list[Moment]) -> None:
        self.moments = list(moments)

    def detect(self, _image: Image, _captured_ns: int) -> tuple[Hand, ...]:
        if not self.moments:
            return ()
        hand = known_hand(self.moments.pop(0).scene, tracked=len(self.moments) > 0)
        assert hand is not None
        return (hand,)


def outcome_of(change: Change, *, blind: bool = False) -> ChangeOutcome:
    detector = Knowing([] if blind else change.moments())
    return run_change(PoolDetector(cast(HandDetector, detector)), change)


def change_at(distance_cm: int, kind: str = FLIP, turn: int = 0) -> Change:
    number = turn * len(CHANGES) + CHANGES.index(kind)
    return Change(distance_cm=distance_cm, number=number, focal_px=650.0)


def test_a_hand_well_within_the_threshold_presses_both_cameras_buttons() -> None:
    assert {(camera, "robust") for camera in CAMERAS} <= outcome_of(change_at(12)).pressed


def test_fingers_that_fold_before_the_palm_press_only_what_takes_zero_for_a_distance() -> None:
    outcome = outcome_of(change_at(30, OPEN_CLOSE))
    assert outcome.pressed == {("D435i", "published")}
    assert outcome.commands["D435i", "robust"] == outcome.commands["monocular", "robust"] == 0


@pytest.mark.parametrize("kind", CHANGES)
def test_no_change_far_off_presses(kind: str) -> None:
    assert outcome_of(change_at(65, kind)).pressed == frozenset()


def test_changes_run_to_both_edges_by_turns() -> None:
    farthest_m = []
    for turn in range(4):
        places = [one.scene.place for one in change_at(50, EDGE, turn).moments()]
        x_m = [place.position_m[0] for place in places if place is not None]
        farthest_m.append(max(x_m, key=abs))
    edge_m = pytest.approx(EDGE_SHARE * 1280 / 650 * 0.50, rel=0.02)
    assert [-x_m if turn % 2 else x_m for turn, x_m in enumerate(farthest_m)] == [edge_m] * 4


def test_no_hand_presses_nothing() -> None:
    assert outcome_of(change_at(20), blind=True).pressed == frozenset()


def test_each_change_is_another_hand_the_same_at_every_distance() -> None:
    assert change_at(20).person == change_at(60).person
    other = Change(distance_cm=20, number=1, focal_px=650.0)
    assert other.person != change_at(20).person
