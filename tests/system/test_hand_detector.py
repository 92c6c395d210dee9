"""The detector of hands with its model, before digital hands."""

from __future__ import annotations

import os
from collections.abc import Iterable
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

from app.evaluate.detector_pool import PoolDetector
from app.evaluate.hand_motions import Moment, held, take
from hal.cameras.digital_hand.render import lens_for, person_of
from kgdfa.hand import FloatArray
from kgdfa.keypoints import SILENCE, live_detector

PERSON, LENS = person_of(4711), lens_for(1280, 720)


def moments(gesture: str, distance_m: float, frames: int) -> Iterable[Moment]:
    return held(gesture, person=PERSON, lens=LENS, distance_m=distance_m, turn_rad=(0.0, 0.0), seed=3, frames=frames)


def keypoints_px(detector: PoolDetector, shown: Iterable[Moment]) -> list[FloatArray]:
    """(21 x hands, 2) of each frame."""
    frames = [detector.detect(take(moment, 5)[0]) for moment in shown]
    return [np.array([point for hand in hands for point in hand.image_px]) for hands in frames]


@pytest.mark.parametrize("distance_m", [0.14, 0.45])
def test_after_a_reset_it_detects_as_one_that_has_seen_nothing(hand_model: Path, distance_m: float) -> None:
    wanted = list(moments("0", distance_m, 6))
    with live_detector(hand_model) as inner:
        fresh = keypoints_px(PoolDetector(inner), wanted)
    with live_detector(hand_model) as inner:
        used = PoolDetector(inner)
        assert keypoints_px(used, moments("5", 0.22, 6))[-1].size
        used.reset()
        after = keypoints_px(used, wanted)
    for ours, theirs in zip(after, fresh, strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_standard_error_is_as_before_after_detectors_were_loaded_side_by_side() -> None:
    """In the order of two threads: each enters, then each leaves."""
    before, first, second = os.fstat(2), ExitStack(), ExitStack()
    first.enter_context(SILENCE)
    second.enter_context(SILENCE)
    assert os.path.samestat(os.fstat(2), Path(os.devnull).stat())
    first.close()
    assert os.path.samestat(os.fstat(2), Path(os.devnull).stat()), "the second still loads"
    second.close()
    assert os.path.samestat(os.fstat(2), before)
