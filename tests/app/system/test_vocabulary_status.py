"""The evidence of a vocabulary in the profile: kept in its file, and how it ages."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path

import msgspec
import pytest

from app.system import vocabulary
from app.system.config import Config
from app.system.vocabulary import (
    VALID_FOR,
    VocabularyStatus,
    recognition_hash,
    vocabulary_of,
    vocabulary_status,
    with_evidence,
)
from kgdfa.gesture import Gesture
from kgdfa.vocabulary import GestureCounts, VocabularyProof
from profiles.errors import ProfileError
from profiles.files import decode, encode
from profiles.schema import DEMO_PATIENT, GestureUsed, HandUsed, Profile

AT = datetime(2026, 3, 1, 9, 30, tzinfo=UTC)
MODEL = "ab" * 32
PROOF = VocabularyProof(
    gestures=(
        GestureCounts(gesture=Gesture.ZERO, frames=120, recognised=118, mistaken=1),
        GestureCounts(gesture=Gesture.NINE, frames=120, recognised=40, mistaken=0),
    ),
    vocabulary=(Gesture.ZERO,),
    idle_frames=200,
    idle_taken=2,
)
ENROLLED = with_evidence(DEMO_PATIENT, PROOF, MODEL, AT, HandUsed.RIGHT)
assert ENROLLED.evidence is not None
OF_UNKNOWN_HAND = msgspec.structs.replace(
    ENROLLED, evidence=msgspec.structs.replace(ENROLLED.evidence, hand=None)
)  # as before it was kept


def status(profile: Profile, model: str = MODEL, after: timedelta = timedelta()) -> VocabularyStatus:
    return vocabulary_status(profile, model, AT + after)


def test_the_profile_s_file_holds_date_counts_bounds_and_model() -> None:
    text = encode(ENROLLED)
    assert decode(text, "") == ENROLLED
    assert vocabulary_of(ENROLLED) == {Gesture.ZERO}
    for part in (
        'vocabulary = "0"',
        'hand = "right"',
        "2026-03-01",
        MODEL,
        "recognised = 118",
        "recognised_at_least = 0.94",
        "idle_taken = 2",
    ):
        assert part in text
    assert decode(encode(DEMO_PATIENT, text), "") == DEMO_PATIENT, "and it can be taken away again"
    assert decode(encode(OF_UNKNOWN_HAND), "") == OF_UNKNOWN_HAND


@pytest.mark.parametrize(
    "wrong",
    [
        "frames = -1",
        "recognised_at_least = 1.2",
        "recognised_at_least = nan",
        'gesture = "10"',
        "proven_at = 2026-03-01",
    ],
)
def test_evidence_that_can_not_be_is_refused(wrong: str) -> None:
    name = wrong.split(" = ", maxsplit=1)[0]
    lines = [wrong if line.strip().startswith(f"{name} =") else line for line in encode(ENROLLED).splitlines()]
    with pytest.raises(ProfileError, match=name):
        decode("\n".join(lines), "")


@pytest.mark.parametrize(
    ("profile", "model", "after", "expected"),
    [
        (DEMO_PATIENT, MODEL, timedelta(), VocabularyStatus.NOT_NEEDED),
        (
            msgspec.structs.replace(DEMO_PATIENT, vocabulary=(GestureUsed.ONE,)),
            MODEL,
            timedelta(),
            VocabularyStatus.MISSING,
        ),
        (ENROLLED, MODEL, timedelta(), VocabularyStatus.VALID),
        (ENROLLED, MODEL, VALID_FOR, VocabularyStatus.VALID),
        (ENROLLED, MODEL, VALID_FOR + timedelta(days=1), VocabularyStatus.TOO_OLD),
        (ENROLLED, MODEL, timedelta(days=-1), VocabularyStatus.TOO_OLD),
        (ENROLLED, "cd" * 32, timedelta(), VocabularyStatus.OTHER_MODEL),
        (
            msgspec.structs.replace(ENROLLED, hand=HandUsed.LEFT),
            MODEL,
            timedelta(),
            VocabularyStatus.OTHER_HAND,
        ),
        (OF_UNKNOWN_HAND, MODEL, timedelta(), VocabularyStatus.OTHER_HAND),
        (
            msgspec.structs.replace(ENROLLED, vocabulary=(GestureUsed.ZERO, GestureUsed.NINE)),
            MODEL,
            timedelta(),
            VocabularyStatus.TOO_FEW,
        ),
    ],
)
def test_it_ages_by_time_by_model_by_hand_and_by_what_is_added(
    profile: Profile, model: str, after: timedelta, expected: VocabularyStatus
) -> None:
    assert status(profile, model, after) is expected


def test_other_rules_or_another_hand_model_are_another_model(tmp_path: Path) -> None:
    own = tmp_path / "own.task"
    own.write_bytes(b"model")
    hashes = {recognition_hash(config) for config in (Config(), Config(rules="published"), Config(model=str(own)))}
    assert len(hashes) == 3
    assert all(len(one) == 64 for one in hashes)


@pytest.mark.parametrize("left_out", vocabulary.RULES)
def test_each_file_of_the_rules_counts(left_out: str, monkeypatch: pytest.MonkeyPatch) -> None:
    before = recognition_hash(Config())
    monkeypatch.setattr(vocabulary, "RULES", tuple(name for name in vocabulary.RULES if name != left_out))
    assert recognition_hash(Config()) != before
