from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from hal.cameras.digital_hand.render import posed
from hal.cameras.digital_hand.skeleton import ACROSS_THUMB, GESTURES, LOOK_ALIKES, OPEN_THUMB, PINCH_THUMB, POSES, Pose
from kgdfa.errors import KgdfaError, KgdfaFault
from kgdfa.features import FEATURES
from kgdfa.gesture import Decision, Explanation, Finger, Gesture
from kgdfa.gesture_needs import NEEDS, Condition, missing_condition
from kgdfa.hand import FloatArray, Hand, Side
from kgdfa.robust import RobustModel, RobustRules, load_model, save_model
from tests.support.known_hands import known_hand

RULES = RobustRules()
shaken = arrays(np.float64, (21, 3), elements=st.floats(-1, 1))


def true_hand(pose: str, turn_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Hand:
    """The digital hand's own joints, as a detector without error would find them."""
    hand = known_hand(posed(pose, turn_rad=turn_rad))
    assert hand is not None
    return hand


@pytest.mark.parametrize("gesture", [pose.name for pose in GESTURES])
def test_every_gesture_of_the_digital_hand_is_reported(gesture: str) -> None:
    verdict = RULES.classify(true_hand(gesture))
    assert verdict.gesture is Gesture(gesture), verdict


@pytest.mark.parametrize("pose", [pose.name for pose in LOOK_ALIKES])
def test_similar_hands_are_refused_with_a_reason(pose: str) -> None:
    verdict = RULES.classify(true_hand(pose))
    assert verdict.gesture is None, verdict
    assert verdict.explanation.code is Decision.NOT
    assert isinstance(verdict.explanation.values["gesture"], Gesture)
    assert isinstance(verdict.explanation.values["measure"], Explanation)


BELOW = {
    Condition.THUMB_NOT_OPEN,
    Condition.FINGER_NOT_OPEN,
    Condition.FINGER_NOT_HOOKED,
    Condition.FINGER_NOT_STRAIGHT,
}
ZERO, SIX, SEVEN = POSES["0"], POSES["6"], POSES["7"]


def certain_of(gesture: Gesture) -> RobustModel:
    """The shipped model, but for perceptrons that take every hand for that gesture."""
    model = load_model()
    bias = model.bias_out.copy()
    bias[list(Gesture).index(gesture)] += 1000
    return replace(model, bias_out=bias)


@pytest.mark.parametrize(
    ("changed", "condition", "fingers"),
    [
        (
            replace(ZERO, name="changed 0", thumb=POSES["thumb up"].thumb),
            Condition.THUMB_NOT_FOLDED,
            {"finger": Finger.THUMB, "other": Finger.RING},
        ),
        (
            replace(SIX, name="changed 6", thumb=PINCH_THUMB),
            Condition.THUMB_NOT_OPEN,
            {"finger": Finger.THUMB, "other": Finger.MIDDLE},
        ),
        (
            replace(SEVEN, name="changed 7", thumb=ACROSS_THUMB),
            Condition.TIPS_NOT_CLOSED,
            {"finger": Finger.THUMB, "other": Finger.FORE},
        ),
        (
            replace(SEVEN, name="changed 7", ring=(8, 83, 22, 14), pinky=(14, 80, 26, 18)),
            Condition.FINGER_NOT_FOLDED,
            {"finger": Finger.RING},
        ),
        (
            replace(POSES["1"], name="changed 1", index=POSES["9"].index),
            Condition.FINGER_NOT_STRAIGHT,
            {"finger": Finger.FORE},
        ),
        (
            replace(POSES["2"], name="changed 2", thumb=OPEN_THUMB),
            Condition.THUMB_NOT_FOLDED,
            {"finger": Finger.THUMB, "other": Finger.PINKY},
        ),
        (
            replace(SIX, name="changed 6", pinky=ZERO.pinky),
            Condition.FINGER_NOT_OPEN,
            {"finger": Finger.PINKY},
        ),
        (
            replace(POSES["8"], name="changed 8", thumb=ZERO.thumb),
            Condition.THUMB_NOT_OPEN,
            {"finger": Finger.THUMB, "other": Finger.MIDDLE},
        ),
        (
            replace(POSES["9"], name="changed 9", index=ZERO.index, turn_deg=(-20, 0, 0)),
            Condition.FINGER_NOT_HOOKED,
            {"finger": Finger.FORE},
        ),
    ],
    ids=[
        "0 with the thumb up",
        "6 with a half-open thumb",
        "7 with the thumb away from the fingers",
        "7 with all five tips together",
        "1 with a hook",
        "2 with an open thumb",
        "6 without the little finger",
        "8 with the thumb over the fingers",
        "9 with a folded forefinger",
    ],
)
def test_a_gesture_lacks_what_it_needs_whatever_the_model_decides(
    changed: Pose, condition: Condition, fingers: dict[str, Finger], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(POSES, changed.name, changed)
    hand, nearest = true_hand(changed.name), Gesture(changed.name[-1])
    rules = RobustRules(certain_of(nearest))
    assert rules.classify(true_hand(nearest.value)).gesture is nearest
    verdict = rules.classify(hand)
    assert (verdict.gesture, verdict.explanation.values["gesture"]) == (None, nearest)
    missing = verdict.explanation.values["measure"]
    assert isinstance(missing, Explanation)
    assert missing.code is condition
    assert missing.values.items() >= fingers.items()
    value, limit = missing.values["value"], missing.values["limit"]
    assert isinstance(value, float)
    assert isinstance(limit, float)
    assert (value < limit) is (condition in BELOW)


def test_a_thumb_that_is_far_from_the_ring_finger_but_bent_is_folded() -> None:
    """Either measure of a 0's thumb does: MediaPipe lays few thumbs where they are."""
    need = NEEDS[Gesture.ZERO][0]
    assert need.otherwise is not None
    values = np.zeros((1, len(FEATURES)))
    values[:, need.columns] = 2 * need.high
    values[:, need.otherwise.columns] = need.otherwise.high - 1
    assert missing_condition(Gesture.ZERO, values) is None
    values[:, need.otherwise.columns] = need.otherwise.high + 1
    lacking = missing_condition(Gesture.ZERO, values)
    assert lacking is not None
    assert (lacking.values["value"], lacking.values["limit"]) == (2 * need.high, need.high)


@given(shaken, st.floats(0, 0.5))
def test_whatever_the_hand_confidence_is_a_share_and_a_reason_is_given(shake: FloatArray, size: float) -> None:
    hand = true_hand("5")
    odd = Hand(
        image_px=hand.image_px + size * 500 * shake[:, :2],
        world_m=hand.world_m + size * shake,
        presence=1.0,
        side=Side.LEFT,
    )
    verdict, scores = RULES.classify(odd), RULES.predict_proba(odd)
    assert 0 <= verdict.confidence <= 1
    assert isinstance(verdict.explanation.code, Decision)
    assert scores.shape == (12,)
    assert 0 <= scores.sum() <= 1 + 1e-6
    assert verdict.confidence == pytest.approx(scores.max(), abs=1e-6)


def test_the_verdict_does_not_depend_on_the_mirror() -> None:
    for pose in (*GESTURES, *LOOK_ALIKES):
        hand = true_hand(pose.name)
        mirrored = Hand(
            image_px=hand.image_px * (-1, 1),
            world_m=hand.world_m * (-1, 1, 1),
            presence=1.0,
            side=Side.LEFT,
        )
        assert RULES.classify(mirrored).gesture is RULES.classify(hand).gesture


def test_a_threshold_never_reached_refuses_everything() -> None:
    model = load_model()
    strict = RobustRules(replace(model, accept=np.full(12, 1.01)))
    assert all(strict.classify(true_hand(pose.name)).gesture is None for pose in GESTURES)
    torn = RobustRules(replace(model, tie=1.01))
    assert all(torn.classify(true_hand(pose.name)).gesture is None for pose in GESTURES)


def test_a_model_survives_its_file_and_others_are_refused(tmp_path: Path) -> None:
    model = load_model()
    save_model(model, tmp_path / "model.npz")
    again, values = load_model(tmp_path / "model.npz"), np.ones((2, len(FEATURES)))
    np.testing.assert_allclose(
        again.predict_proba(again.normalize(values)), model.predict_proba(model.normalize(values)), rtol=1e-5
    )
    (tmp_path / "broken.npz").write_bytes(b"PK not really")
    for bad in ("broken.npz", "missing.npz"):
        with pytest.raises(KgdfaError) as raised:
            load_model(tmp_path / bad)
        assert raised.value.code is KgdfaFault.GESTURE_MODEL_UNREADABLE
    save_model(replace(model, classes=tuple(reversed(model.classes))), tmp_path / "other.npz")
    with pytest.raises(KgdfaError) as raised:
        load_model(tmp_path / "other.npz")
    assert raised.value.code is KgdfaFault.GESTURE_MODEL_OUTDATED
