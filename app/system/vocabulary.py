"""With which gestures a patient may command, as the profile has it, and the age of its evidence."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from enum import Enum, auto
from functools import cache
from hashlib import sha256
from importlib import resources
from pathlib import Path

import msgspec

from app.ipc.states import GESTURE_OF, Action
from app.system.config import Config
from app.system.hand_model import BUNDLE_SHA256
from kgdfa.gesture import Explanation, Gesture
from kgdfa.vocabulary import VocabularyProof
from logs.reading.regular import path_named
from logs.reason import reason_of
from logs.records import VocabularyEnrolled
from profiles.schema import GestureEvidence, GestureUsed, HandUsed, Profile, VocabularyEvidence

# In kgdfa: what a verdict hangs on.
RULES = ("robust.npz", "robust.py", "gesture_needs.py", "features.py", "published.py")
VALID_FOR = timedelta(days=91)  # three months: docs/decisions.md


class VocabularyStatus(Enum):
    """How the evidence of a vocabulary stands."""

    NOT_NEEDED = auto()  # all twelve, and nobody was enrolled: recognition as it was measured on many people
    VALID = auto()  # proven_at
    MISSING = auto()
    OTHER_HAND = auto()  # proven_at; or, from before the hand was kept, of a hand that is not known
    TOO_FEW = auto()  # the vocabulary has a gesture that was not proven
    OTHER_MODEL = auto()  # proven_at
    TOO_OLD = auto()  # proven_at, months


def vocabulary_of(profile: Profile) -> frozenset[Gesture]:
    """The gestures that command."""
    return frozenset(Gesture(one.value) for one in profile.vocabulary)


def by_key_only(vocabulary: frozenset[Gesture]) -> tuple[Action, ...]:
    """The actions that no gesture of this vocabulary commands: the therapist's keys do."""
    return tuple(action for action, gesture in GESTURE_OF.items() if gesture not in vocabulary)


def vocabulary_status(profile: Profile, model: str, at: datetime) -> VocabularyStatus:
    """Whether the vocabulary is proven by now, for what recognises now."""
    found = profile.evidence
    if found is None:
        return VocabularyStatus.NOT_NEEDED if set(profile.vocabulary) == set(GestureUsed) else VocabularyStatus.MISSING
    if found.hand is not profile.hand:
        return VocabularyStatus.OTHER_HAND
    if not set(profile.vocabulary) <= set(found.vocabulary):
        return VocabularyStatus.TOO_FEW
    if found.model != model:
        return VocabularyStatus.OTHER_MODEL
    return VocabularyStatus.VALID if timedelta() <= at - found.proven_at <= VALID_FOR else VocabularyStatus.TOO_OLD


def status_now(profile: Profile, config: Config) -> VocabularyStatus:
    """By the wall clock and this program's models."""
    return vocabulary_status(profile, recognition_hash(config) if profile.evidence else "", datetime.now(UTC))


def with_evidence(profile: Profile, proof: VocabularyProof, model: str, at: datetime, hand: HandUsed) -> Profile:
    """The profile that commands with what was proven. hand: that was shown."""
    vocabulary = tuple(GestureUsed(gesture.value) for gesture in proof.vocabulary)
    found = VocabularyEvidence(
        proven_at=at.replace(microsecond=0),
        model=model,
        hand=hand,
        vocabulary=vocabulary,
        idle_frames=proof.idle_frames,
        idle_taken=proof.idle_taken,
        idle_at_most=round(proof.idle_at_most, 4),
        gestures=tuple(
            GestureEvidence(
                gesture=GestureUsed(one.gesture.value),
                frames=one.frames,
                recognised=one.recognised,
                mistaken=one.mistaken,
                recognised_at_least=round(one.recognised_at_least, 4),
                mistaken_at_most=round(one.mistaken_at_most, 4),
            )
            for one in proof.gestures
        ),
    )
    return msgspec.structs.replace(profile, vocabulary=vocabulary, evidence=found)


def enrolment_record(profile: Profile, refusal: Explanation | None = None) -> VocabularyEnrolled:
    """For the trail; profile: as it is from now on. A refusal tells nothing of the evidence that stays."""
    vocabulary = tuple(one.value for one in profile.vocabulary)
    found = profile.evidence
    if refusal is not None or found is None:
        why = None if refusal is None else reason_of(refusal)
        return VocabularyEnrolled(patient=profile.identifier, reason=why, vocabulary=vocabulary)
    return VocabularyEnrolled(
        patient=profile.identifier,
        vocabulary=vocabulary,
        model=found.model,
        gestures=tuple(one.gesture.value for one in found.gestures),
        frames=tuple(one.frames for one in found.gestures),
        recognised=tuple(one.recognised for one in found.gestures),
        mistaken=tuple(one.mistaken for one in found.gestures),
        recognised_at_least=tuple(one.recognised_at_least for one in found.gestures),
        mistaken_at_most=tuple(one.mistaken_at_most for one in found.gestures),
        idle_frames=found.idle_frames,
        idle_taken=found.idle_taken,
        idle_at_most=found.idle_at_most,
    )


def recognition_hash(config: Config) -> str:
    """SHA-256 of what recognises gestures: the rules' name, their code and fitted model, the hand model."""
    hand = _hash_of(path_named(config.model)) if config.model else BUNDLE_SHA256
    rules = (_hash_of(Path(str(resources.files("kgdfa") / name))) for name in RULES)
    return sha256("\n".join((config.rules, *rules, hand)).encode()).hexdigest()


@cache
def _hash_of(path: Path) -> str:
    """Of a file; empty where it can't be read: then nothing was proven with it."""
    try:
        return sha256(path.read_bytes()).hexdigest()
    except OSError:
        return ""
