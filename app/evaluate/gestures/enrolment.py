"""The guided enrolment on digital patients: which vocabulary it finds for hands that can't do all, and how that holds.

Keypoints are the digital hand's own with MediaPipe's errors on rendered hands like it (`joint_space`), drawn anew for
each frame: errors that last over frames, motion blur and lost hands are not simulated.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.random import Generator
from rich.table import Table

from app.evaluate.digital import centred
from app.evaluate.gestures.joint_space import Errors
from app.evaluate.harness import FRAME_NS, Step, mean, percent, table
from app.text.catalogue import tr
from hal.cameras.digital_hand.movement import TREMOR_HZ, HandLimit, limited, tremor_deg
from hal.cameras.digital_hand.render import person_of, posed
from hal.cameras.digital_hand.skeleton import POSES
from kgdfa.gesture import Explanation, Gesture, RuleSet, Vote, update_vote
from kgdfa.hand import FloatArray
from kgdfa.vocabulary import (
    IDLE_FRAMES,
    LEAD_FRAMES,
    SHOWN_FRAMES,
    Frame,
    VocabularyEnrolment,
    VocabularyProof,
    leave_out,
    prove,
    update_enrolment,
)

FIRST_PERSON = 7_000_000  # people from here on are only measured here
RATE_HZ = 20.0  # of the frames that the console counts
STRAY_DEG = 3.0  # sd of every joint from showing to showing
TURN_RAD = np.radians(6.0)  # sd about each axis
NEAR_M, FAR_M = 0.25, 0.45
IDLE_POSES = ("rest", "naturally open", "rest", "tiger claw", "rest")
ATTEMPTS = 4  # an enrolment that is refused for a gesture is done again without it


@dataclass(frozen=True, slots=True, kw_only=True)
class DigitalPatient:
    """One person's hand before rules and errors; every showing is another try at the pose."""

    limit: HandLimit
    person: int
    rules: RuleSet
    errors: Errors

    def show(self, gesture: Gesture | None, frames: int, random: Generator) -> Iterator[Gesture | None]:
        """What the rules make of each frame; None: an idle hand, resting and moving."""
        start, stray = random.uniform(0, 2 * np.pi), random.normal(0, STRAY_DEG, (5, 6))
        (x, y, z), rate_hz = random.normal(0, TURN_RAD, 3).tolist(), random.uniform(*TREMOR_HZ)
        distance_m = float(random.uniform(NEAR_M, FAR_M))
        for number in range(frames):
            angles = limited(self.limit, _pose(gesture, number / max(1, frames - 1)) + stray)
            angles = angles + tremor_deg(self.limit, number / RATE_HZ, rate_hz, start)
            named = gesture.value if gesture else "5"
            scene = posed(named, person=person_of(self.person), position_m=(0.0, 0.0, distance_m), turn_rad=(x, y, z))
            hand = self.errors.observe(centred(replace(scene, angles_deg=angles), distance_m), random)
            yield self.rules.classify(hand).gesture if hand is not None else None


def _pose(gesture: Gesture | None, along: float) -> FloatArray:
    """The pose's joint angles; an idle hand goes from one to the next, 0 to 1."""
    if gesture is not None:
        return POSES[gesture.value].angles_deg
    place = along * (len(IDLE_POSES) - 1)
    first = min(int(place), len(IDLE_POSES) - 2)
    before, after = (POSES[name].angles_deg for name in IDLE_POSES[first : first + 2])
    between: FloatArray = before + (place - first) * (after - before)
    return between


@dataclass(frozen=True, slots=True, kw_only=True)
class EnrolledPatient:
    """What became of one patient. refusals: codes, of attempts; recognised: share of later frames of the vocabulary.

    unintended: later showings, one a gesture of the vocabulary and one of an idle hand, in which another gesture of the
    vocabulary was voted. tried: the same of gestures outside the vocabulary, which the patient is not to try.
    """

    limit: HandLimit
    vocabulary: tuple[Gesture, ...]
    refusals: tuple[str, ...]
    recognised: float | None
    unintended: int
    tried: int


def enrol_patient(patient: DigitalPatient, seed: int) -> EnrolledPatient:
    """Enrol until something is proven; then show every gesture and an idle hand once more."""
    random = np.random.default_rng([seed, patient.person, list(HandLimit).index(patient.limit)])
    refusals: list[str] = []
    left_out: set[Gesture] = set()
    proof: VocabularyProof | Explanation | None = None
    while not isinstance(proof, VocabularyProof) and len(refusals) < ATTEMPTS:
        proof = _enrol(patient, left_out, random)
        if isinstance(proof, Explanation):
            refusals.append(proof.code.name)
            if isinstance(gesture := proof.values.get("gesture"), Gesture):
                left_out.add(gesture)
    vocabulary = proof.vocabulary if isinstance(proof, VocabularyProof) else ()
    recognised, unintended, tried = [], 0, 0
    for part in (*Gesture, None) if vocabulary else ():
        frames = [*patient.show(part, SHOWN_FRAMES if part else IDLE_FRAMES, random)]
        another = _votes_another(frames, part, vocabulary)
        if part is None or part in vocabulary:
            unintended += another
        else:
            tried += another
        if part in vocabulary:
            recognised.append(sum(one is part for one in frames) / len(frames))
    return EnrolledPatient(
        limit=patient.limit,
        vocabulary=vocabulary,
        refusals=tuple(refusals),
        recognised=mean(recognised),
        unintended=unintended,
        tried=tried,
    )


def _enrol(patient: DigitalPatient, left_out: set[Gesture], random: Generator) -> VocabularyProof | Explanation:
    state = VocabularyEnrolment()
    while not state.ended:
        if state.sample.gesture in left_out:
            state = leave_out(state)
            continue
        for _ in range(LEAD_FRAMES):
            state = update_enrolment(state, Frame(hand=True))
        for gesture in patient.show(state.sample.gesture, state.sample.wanted, random):
            state = update_enrolment(state, Frame(hand=True, gesture=gesture))
    return state.fault or prove(state.samples)


def _votes_another(frames: Sequence[Gesture | None], wanted: Gesture | None, vocabulary: Sequence[Gesture]) -> bool:
    """Whether a vote over these frames gave another gesture that would command."""
    vote, voted = Vote(), set[Gesture | None]()
    for number, gesture in enumerate(frames):
        vote = update_vote(vote, gesture, number * FRAME_NS)
        voted.add(vote.gesture)
    return bool((voted - {wanted, None}) & set(vocabulary))


def measure_enrolment(
    rules: RuleSet, errors: Errors, people: int, seed: int = 0, step: Step = lambda: None
) -> list[EnrolledPatient]:
    """So many people of each kind."""
    found = []
    for limit in HandLimit:
        for person in range(FIRST_PERSON, FIRST_PERSON + people):
            found.append(enrol_patient(DigitalPatient(limit=limit, person=person, rules=rules, errors=errors), seed))
            step()
    return found


def enrolment_table(found: Sequence[EnrolledPatient]) -> Table:
    """A row a kind of patient; in how many people's vocabulary each gesture is."""
    made = table("enrolment", "hand proven refusals_first recognised_later unintended tried")
    for gesture in Gesture:
        made.add_column(gesture.value, justify="right")
    for limit in HandLimit:
        own = [one for one in found if one.limit is limit]
        proven = [one for one in own if one.vocabulary]
        refusals = Counter(code for one in own for code in one.refusals)
        counts = [str(sum(gesture in one.vocabulary for one in own)) for gesture in Gesture]
        made.add_row(
            tr(limit),
            f"{len(proven)}/{len(own)}",
            ", ".join(f"{code.lower().replace('_', ' ')}: {count}" for code, count in refusals.items()) or "–",
            percent(mean(one.recognised for one in proven if one.recognised is not None)),
            f"{sum(one.unintended for one in proven)}/{sum(len(one.vocabulary) + 1 for one in proven)}",
            f"{sum(one.tried for one in proven)}/{sum(len(Gesture) - len(one.vocabulary) for one in proven)}",
            *counts,
        )
    return made
