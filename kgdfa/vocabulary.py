"""Guided enrolment: a patient shows each gesture twice and then an idle hand; which gestures are reliable is proven.

Pure: one `Frame` in, the next state out. Frames are counted, not seconds. A gesture is reliable when the exact bounds
of its counts keep both limits; one fault ends the enrolment, and then nothing of it is used.

The bounds of a share are Clopper and Pearson's (Biometrika 26, 1934), each one-sided. They hold for independent frames.
Frames in a row are not: who compares a bound with a limit leaves room for that.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import cache

from kgdfa.gesture import Explanation, Gesture

LEAD_FRAMES = 40  # with a hand, before a part counts: two seconds at the console's rate to form the hand
SHOWN_FRAMES = 60  # of each of a gesture's two showings
IDLE_FRAMES = 200  # ten seconds at the console's rate
MOST_FRAMES = 400  # of a part, with or without a hand; then it has too few
OTHER_HAND_FRAMES = 3  # in a row: as many as make a vote
LEAST_RECOGNISED = 0.8  # proven share of a gesture's frames that are recognised as it
MOST_MISTAKEN = 0.05  # proven share of its frames that are taken for another gesture; of idle frames for any
SHOWINGS = 2
PARTS: tuple[Gesture | None, ...] = (*(gesture for _ in range(SHOWINGS) for gesture in Gesture), None)  # None: idle
WALK, WALK_END = Gesture.FIVE, Gesture.SIX


class VocabularyFault(Enum):
    """Why an enrolment is refused."""

    OTHER_HAND = "other hand"
    ABANDONED = "abandoned"  # left before its end
    NO_HAND = "no hand"
    TOO_FEW_FRAMES = "too few frames"  # count, wanted
    CONTRADICTORY = "contradictory"  # gesture, better, worse: shares of the two showings
    IDLE_TAKEN = "idle taken"  # gesture that was taken most often, share, bound, limit
    NONE_RELIABLE = "none reliable"


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """What recognition made of one image. hand: of the enrolled hand; gesture: of this frame alone."""

    hand: bool
    gesture: Gesture | None = None
    other_hand: bool = False  # no hand commands, because another one is in view


@dataclass(frozen=True, slots=True, kw_only=True)
class Sample:
    """The frames of one part. taken: how many were taken for each gesture, in the order of `Gesture`."""

    gesture: Gesture | None  # that was to be shown; None: an idle hand
    frames: int = 0
    taken: tuple[int, ...] = (0,) * len(Gesture)

    @property
    def wanted(self) -> int:
        """Frames of a whole sample."""
        return IDLE_FRAMES if self.gesture is None else SHOWN_FRAMES

    @property
    def recognised(self) -> int:
        """Frames that were taken for what was to be shown."""
        return 0 if self.gesture is None else self.taken_for(self.gesture)

    @property
    def mistaken(self) -> int:
        """Frames that were taken for another gesture."""
        return sum(self.taken) - self.recognised

    def taken_for(self, *gestures: Gesture) -> int:
        """Frames that were taken for one of these."""
        return sum(count for gesture, count in zip(Gesture, self.taken, strict=True) if gesture in gestures)

    def with_frame(self, gesture: Gesture | None) -> Sample:
        """With one frame more."""
        taken = tuple(count + (one is gesture) for one, count in zip(Gesture, self.taken, strict=True))
        return replace(self, frames=self.frames + 1, taken=taken)


@dataclass(frozen=True, slots=True, kw_only=True)
class VocabularyEnrolment:
    """How far an enrolment is. samples: the finished ones. fault: why it has ended without a result."""

    place: int = 0  # in PARTS
    samples: tuple[Sample, ...] = ()
    sample: Sample = Sample(gesture=PARTS[0])
    lead: int = 0  # frames with a hand before this part counts
    frames: int = 0  # of this part, all
    other_hand: int = 0  # frames in a row with another hand
    left_out: frozenset[Gesture] = frozenset()  # the patient can't make them
    fault: Explanation | None = None

    @property
    def ended(self) -> bool:
        """Whether nothing more is counted."""
        return self.fault is not None or self.place >= len(PARTS)


def update_enrolment(state: VocabularyEnrolment, frame: Frame) -> VocabularyEnrolment:
    """The state after one more frame."""
    if state.ended:
        return state
    state = replace(state, frames=state.frames + 1, other_hand=state.other_hand + 1 if frame.other_hand else 0)
    if state.other_hand >= OTHER_HAND_FRAMES:
        return replace(state, fault=Explanation(VocabularyFault.OTHER_HAND))
    if frame.hand and state.lead < LEAD_FRAMES:
        state = replace(state, lead=state.lead + 1)
    elif frame.hand:
        state = replace(state, sample=state.sample.with_frame(frame.gesture))
    if state.sample.frames >= state.sample.wanted:
        return _next_part(replace(state, samples=(*state.samples, state.sample)))
    if state.frames < MOST_FRAMES:
        return state
    if not state.lead:
        return replace(state, fault=Explanation(VocabularyFault.NO_HAND))
    values = {"count": state.sample.frames, "wanted": state.sample.wanted}
    return replace(state, fault=Explanation(VocabularyFault.TOO_FEW_FRAMES, values))


def leave_out(state: VocabularyEnrolment) -> VocabularyEnrolment:
    """Go on without the gesture that is to be shown now; an idle hand can't be left out."""
    gesture = state.sample.gesture
    if state.ended or gesture is None:
        return state
    kept = tuple(sample for sample in state.samples if sample.gesture is not gesture)
    return _next_part(replace(state, samples=kept, left_out=state.left_out | {gesture}))


def abandon(state: VocabularyEnrolment) -> VocabularyEnrolment:
    """Ended by who left; one that has ended already keeps what it came to."""
    return state if state.ended else replace(state, fault=Explanation(VocabularyFault.ABANDONED))


def _next_part(state: VocabularyEnrolment) -> VocabularyEnrolment:
    place = state.place + 1
    while place < len(PARTS) and PARTS[place] in state.left_out:
        place += 1
    gesture = PARTS[place] if place < len(PARTS) else None
    return replace(state, place=place, sample=Sample(gesture=gesture), lead=0, frames=0)


@dataclass(frozen=True, slots=True, kw_only=True)
class GestureCounts:
    """One gesture's frames of both showings."""

    gesture: Gesture
    frames: int
    recognised: int
    mistaken: int  # taken for another gesture

    @property
    def recognised_at_least(self) -> float:
        """The proven share."""
        return at_least(self.recognised, self.frames)

    @property
    def mistaken_at_most(self) -> float:
        """The proven share."""
        return at_most(self.mistaken, self.frames)

    @property
    def reliable(self) -> bool:
        """Whether both limits are proven."""
        return self.recognised_at_least >= LEAST_RECOGNISED and self.mistaken_at_most <= MOST_MISTAKEN


@dataclass(frozen=True, slots=True, kw_only=True)
class VocabularyProof:
    """What a finished enrolment proves. gestures: of all that were shown; vocabulary: of those that may command."""

    gestures: tuple[GestureCounts, ...]
    vocabulary: tuple[Gesture, ...]
    idle_frames: int
    idle_taken: int  # frames of an idle hand that were taken for a gesture of the vocabulary

    @property
    def idle_at_most(self) -> float:
        """The proven share."""
        return at_most(self.idle_taken, self.idle_frames)


def prove(samples: Sequence[Sample]) -> VocabularyProof | Explanation:
    """What these samples prove, or why they prove nothing: a `VocabularyFault` with its values."""
    shown = [gesture for gesture in Gesture if any(sample.gesture is gesture for sample in samples)]
    for gesture in shown:
        if contradiction := _contradiction([sample for sample in samples if sample.gesture is gesture]):
            return contradiction
    gestures = tuple(_counts(gesture, samples) for gesture in shown)
    reliable = {one.gesture for one in gestures if one.reliable}
    if WALK_END not in reliable:  # who can't end a walk by gesture may not begin one by gesture
        reliable.discard(WALK)
    vocabulary = tuple(gesture for gesture in Gesture if gesture in reliable)
    if not vocabulary:
        return Explanation(VocabularyFault.NONE_RELIABLE)
    idle = [sample for sample in samples if sample.gesture is None]
    proof = VocabularyProof(
        gestures=gestures,
        vocabulary=vocabulary,
        idle_frames=sum(sample.frames for sample in idle),
        idle_taken=sum(sample.taken_for(*vocabulary) for sample in idle),
    )
    if proof.idle_at_most <= MOST_MISTAKEN:
        return proof
    most = max(vocabulary, key=lambda gesture: sum(sample.taken_for(gesture) for sample in idle))
    share = proof.idle_taken / max(proof.idle_frames, 1)
    values = {"gesture": most, "share": share, "bound": proof.idle_at_most, "limit": MOST_MISTAKEN}
    return Explanation(VocabularyFault.IDLE_TAKEN, values)


def _counts(gesture: Gesture, samples: Sequence[Sample]) -> GestureCounts:
    own = [sample for sample in samples if sample.gesture is gesture]
    return GestureCounts(
        gesture=gesture,
        frames=sum(sample.frames for sample in own),
        recognised=sum(sample.recognised for sample in own),
        mistaken=sum(sample.mistaken for sample in own),
    )


def _contradiction(showings: Sequence[Sample]) -> Explanation | None:
    """One showing proves that the gesture is recognised often enough, another that it is not."""
    better = max(showings, key=lambda sample: sample.recognised / max(sample.frames, 1))
    worse = min(showings, key=lambda sample: sample.recognised / max(sample.frames, 1))
    proves = at_least(better.recognised, better.frames) >= LEAST_RECOGNISED
    if not (proves and at_most(worse.recognised, worse.frames) < LEAST_RECOGNISED):
        return None
    shares = {"better": better.recognised / better.frames, "worse": worse.recognised / worse.frames}
    return Explanation(VocabularyFault.CONTRADICTORY, {"gesture": better.gesture, **shares})


CONFIDENCE = 0.95
_HALVINGS = 50  # of [0, 1]: to 1e-15


@cache
def at_least(hits: int, count: int) -> float:
    """The share that is reached with 95 % confidence: under a smaller one so many hits would be rarer than 5 %."""
    return 1.0 - at_most(count - hits, count)


@cache
def at_most(hits: int, count: int) -> float:
    """The share that is not exceeded with 95 % confidence; 1 where nothing was counted.

    Raises ValueError for counts that can't be.
    """
    if not 0 <= hits <= count:
        raise ValueError(f"{hits} of {count}")
    if hits == count:
        return 1.0
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        share = (low + high) / 2
        low, high = (share, high) if _so_few(hits, count, share) > 1 - CONFIDENCE else (low, share)
    return high


def _so_few(hits: int, count: int, share: float) -> float:
    """The chance of at most so many hits: the binomial distribution's sum."""
    orders = math.lgamma(count + 1)
    return math.fsum(
        math.exp(
            orders
            - math.lgamma(hit + 1)
            - math.lgamma(count - hit + 1)
            + hit * math.log(share)
            + (count - hit) * math.log1p(-share)
        )
        for hit in range(hits + 1)
    )
