"""Two hands in a scene, detected without errors: what the clips show, and that only the enrolled hand commands."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from app.evaluate.trigger import foreign
from app.evaluate.trigger.foreign import ForeignKind, evaluate_foreign, steps, turned
from hal.cameras.digital_hand.render import Rendered, Scene, keypoints_m, person_of, posed
from kgdfa.hand import Hand
from tests.app.evaluate.known_hands import known_hand

IMAGE = np.zeros((720, 1280, 3), np.uint8)


class KnownHands:
    """Detector and camera at once: finds the hands of the scene that was rendered last, where its image has them."""

    def __init__(self) -> None:
        self._hands: tuple[Hand, ...] = ()

    def render(self, scene: Scene, _seed: int) -> Rendered:
        found = [known_hand(one) for one in (scene, scene.second) if one is not None]
        self._hands = tuple(hand for hand in found if hand is not None and inside(hand))
        return Rendered(IMAGE, None)

    def detect(self, _image: Any, _captured_ns: int = 0) -> tuple[Hand, ...]:
        return self._hands

    def follow(self, hand: Hand | None, unknown: bool) -> None:
        """It finds every hand in any case."""


def inside(hand: Hand) -> bool:
    x, y = hand.palm_centre_px
    return bool(0 <= x < 1280 and 0 <= y < 720)


def test_only_the_enrolled_hand_commands(monkeypatch: pytest.MonkeyPatch) -> None:
    known = KnownHands()
    monkeypatch.setattr(foreign, "render", known.render)
    done = []
    detector: Any = known
    result = evaluate_foreign(detector, frames=5 * foreign.CLIP_FRAMES, pushes=1, seed=1, step=lambda: done.append(1))
    assert len(done) == steps(5 * foreign.CLIP_FRAMES, 1)
    assert (result.frames, result.commands, result.interrupted) == (5 * foreign.CLIP_FRAMES, 0, False)
    assert (result.pushes, result.alone, result.beside) == (1, 1, 1)
    alone = (result.kinds[kind.value] for kind in (ForeignKind.OTHER_SIDE, ForeignKind.SAME_SIDE))
    assert [(one.without > 0, one.refused > 50) for one in alone] == [(True, True)] * 2


def test_an_interrupt_keeps_what_there_is(monkeypatch: pytest.MonkeyPatch) -> None:
    known = KnownHands()
    monkeypatch.setattr(foreign, "render", known.render)

    def interrupt() -> None:
        raise KeyboardInterrupt

    detector: Any = known
    result = evaluate_foreign(detector, frames=1000, pushes=5, seed=1, step=interrupt)
    assert (result.frames, result.interrupted) == (foreign.CLIP_FRAMES, True)


@pytest.mark.parametrize("degrees", [0, 90, 180, -90])
def test_a_hand_reaches_in_along_its_arm(degrees: int) -> None:
    scene = posed("5", person=person_of(1), position_m=(0.0, 0.0, 0.4))
    here, away = (turned(scene, math.radians(degrees), (0.0, 0.0), share) for share in (0.0, 1.0))
    at, gone = keypoints_m(here), keypoints_m(away)
    assert at is not None
    assert gone is not None
    arm = (at[0] - at[9])[:2]
    shift = (gone - at).mean(axis=0)[:2]
    assert float(arm @ shift) / float(np.linalg.norm(arm) * np.linalg.norm(shift)) > 0.95
    assert np.linalg.norm(shift) == pytest.approx(foreign.OUTSIDE_M)
