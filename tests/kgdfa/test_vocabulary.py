"""The guided enrolment: what is counted, what counts prove, and every refusal."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kgdfa.gesture import Explanation, Gesture
from kgdfa.vocabulary import (
    IDLE_FRAMES,
    LEAD_FRAMES,
    LEAST_RECOGNISED,
    MOST_FRAMES,
    MOST_MISTAKEN,
    OTHER_HAND_FRAMES,
    PARTS,
    SHOWN_FRAMES,
    Frame,
    Sample,
    VocabularyEnrolment,
    VocabularyFault,
    VocabularyProof,
    abandon,
    leave_out,
    prove,
    update_enrolment,
)

F, G = VocabularyFault, Gesture


def sample(gesture: Gesture | None, taken: Mapping[Gesture, int], frames: int | None = None) -> Sample:
    whole = IDLE_FRAMES if gesture is None else SHOWN_FRAMES
    counts = tuple(taken.get(one, 0) for one in Gesture)
    return Sample(gesture=gesture, frames=whole if frames is None else frames, taken=counts)


def samples(changes: Mapping[int, Sample] | None = None) -> list[Sample]:
    """Every part shown perfectly, some of them (by their place) otherwise."""
    perfect = [sample(part, {} if part is None else {part: SHOWN_FRAMES}) for part in PARTS]
    return [(changes or {}).get(place, one) for place, one in enumerate(perfect)]


def run(show: Callable[[Gesture | None, int], Frame], state: VocabularyEnrolment | None = None) -> VocabularyEnrolment:
    """Until it ends; show: the frame of a part, by its number within the part."""
    state = state or VocabularyEnrolment()
    for _ in range(MOST_FRAMES * len(PARTS)):
        if state.ended:
            return state
        state = update_enrolment(state, show(state.sample.gesture, state.frames))
    raise AssertionError("does not end")


def code(state: VocabularyEnrolment) -> object:
    return state.fault.code if state.fault is not None else None


def test_who_shows_all_twelve_gets_all_twelve() -> None:
    state = run(lambda part, _: Frame(hand=True, gesture=part))
    proof = prove(state.samples)
    assert isinstance(proof, VocabularyProof)
    assert proof.vocabulary == tuple(Gesture)
    assert {(one.frames, one.recognised, one.mistaken) for one in proof.gestures} == {(2 * SHOWN_FRAMES,) * 2 + (0,)}
    assert proof.gestures[0].recognised_at_least == pytest.approx(0.9753, abs=1e-4)
    assert proof.gestures[0].mistaken_at_most == pytest.approx(0.0247, abs=1e-4)
    assert (proof.idle_frames, proof.idle_taken) == (IDLE_FRAMES, 0)


def test_while_the_hand_is_formed_nothing_counts() -> None:
    state = run(lambda part, at: Frame(hand=True, gesture=part if at >= LEAD_FRAMES else G.ROCK))
    assert all(one.mistaken == 0 for one in state.samples)
    early = run(lambda part, at: Frame(hand=True, gesture=part if at > LEAD_FRAMES else G.ROCK))
    assert sum(one.mistaken for one in early.samples) == len(PARTS) - 2  # each but the two showings of that gesture


def test_frames_without_a_hand_are_waited_for() -> None:
    state = run(lambda part, at: Frame(hand=at % 3 > 0, gesture=part if at % 3 else None))
    assert state.fault is None
    assert {one.frames for one in state.samples} == {SHOWN_FRAMES, IDLE_FRAMES}


@pytest.mark.parametrize(
    ("recognised", "mistaken", "reliable"),
    [(104, 0, True), (103, 0, False), (119, 1, True), (118, 2, False), (0, 0, False)],
)
def test_the_limits_are_those_of_exact_bounds(recognised: int, mistaken: int, reliable: bool) -> None:
    first = min(SHOWN_FRAMES, (recognised + 1) // 2)
    changed = {
        PARTS.index(G.THREE): sample(G.THREE, {G.THREE: first, G.FOUR: mistaken}),
        PARTS.index(G.THREE) + len(Gesture): sample(G.THREE, {G.THREE: recognised - first}),
    }
    proof = prove(samples(changed))
    assert isinstance(proof, VocabularyProof)
    assert (G.THREE in proof.vocabulary) is reliable
    assert len(proof.vocabulary) == len(Gesture) - 1 + reliable
    assert len(proof.gestures) == len(Gesture)


@given(
    st.lists(st.integers(0, SHOWN_FRAMES), min_size=len(PARTS) - 1, max_size=len(PARTS) - 1),
    st.lists(st.integers(0, 6), min_size=len(PARTS) - 1, max_size=len(PARTS) - 1),
    st.integers(0, 12),
)
def test_whatever_was_counted_only_what_is_proven_commands(right: list[int], wrong: list[int], idle: int) -> None:
    made = [
        sample(
            part, {part: right[at], Gesture(G.ROCK if part is not G.ROCK else G.ONE): min(wrong[at], 60 - right[at])}
        )
        for at, part in enumerate(PARTS)
        if part is not None
    ]
    made.append(sample(None, {G.FIVE: idle}))
    proof = prove(made)
    if isinstance(proof, Explanation):
        assert isinstance(proof.code, VocabularyFault)
        return
    by_gesture = {one.gesture: one for one in proof.gestures}
    for gesture in proof.vocabulary:
        assert by_gesture[gesture].recognised_at_least >= LEAST_RECOGNISED
        assert by_gesture[gesture].mistaken_at_most <= MOST_MISTAKEN
    assert proof.idle_at_most <= MOST_MISTAKEN
    assert G.FIVE not in proof.vocabulary or G.SIX in proof.vocabulary
    assert len(proof.vocabulary) > 0


def test_who_can_not_end_a_walk_may_not_begin_one() -> None:
    six = PARTS.index(G.SIX)
    proof = prove(samples({six: sample(G.SIX, {}), six + len(Gesture): sample(G.SIX, {})}))
    assert isinstance(proof, VocabularyProof)
    assert set(Gesture) - set(proof.vocabulary) == {G.FIVE, G.SIX}


def test_what_is_left_out_is_shown_no_more_and_commands_nothing() -> None:
    state = leave_out(VocabularyEnrolment())
    assert state.sample.gesture is G.ONE
    state = run(lambda part, _: Frame(hand=True, gesture=part), state)
    assert G.ZERO not in {one.gesture for one in state.samples}
    proof = prove(state.samples)
    assert isinstance(proof, VocabularyProof)
    assert proof.vocabulary == tuple(Gesture)[1:]


def test_left_out_at_its_second_showing_its_first_one_does_not_count() -> None:
    state = VocabularyEnrolment()
    while state.place < len(Gesture):
        state = update_enrolment(state, Frame(hand=True, gesture=state.sample.gesture))
    assert state.sample.gesture is G.ZERO
    assert G.ZERO not in {one.gesture for one in leave_out(state).samples}


def test_an_idle_hand_is_not_left_out() -> None:
    state = replace(VocabularyEnrolment(), place=len(PARTS) - 1, sample=Sample(gesture=None))
    assert leave_out(state) is state


def test_another_hand_ends_it_as_soon_as_it_could_have_been_voted() -> None:
    for frames in (OTHER_HAND_FRAMES - 1, OTHER_HAND_FRAMES):
        state = VocabularyEnrolment()
        for _ in range(frames):
            state = update_enrolment(state, Frame(hand=False, other_hand=True))
        state = update_enrolment(state, Frame(hand=True))
        assert (code(state) is F.OTHER_HAND) is (frames == OTHER_HAND_FRAMES)


def test_no_hand_at_all_is_no_hand_and_too_little_is_too_few() -> None:
    assert code(run(lambda *_: Frame(hand=False))) is F.NO_HAND
    few = run(lambda part, at: Frame(hand=at < LEAD_FRAMES + 7, gesture=part))
    assert few.fault == Explanation(F.TOO_FEW_FRAMES, {"count": 7, "wanted": SHOWN_FRAMES})
    assert few.samples == ()


def test_who_leaves_abandons_it_but_not_what_has_ended() -> None:
    assert code(abandon(VocabularyEnrolment())) is F.ABANDONED
    whole = run(lambda part, _: Frame(hand=True, gesture=part))
    assert abandon(whole) is whole
    assert update_enrolment(whole, Frame(hand=True)) is whole


@pytest.mark.parametrize(("worse", "refused"), [(42, True), (43, False)])
def test_the_same_gesture_once_well_and_once_not_is_a_contradiction(worse: int, refused: bool) -> None:
    found = prove(samples({PARTS.index(G.TWO): sample(G.TWO, {G.TWO: worse})}))
    assert (isinstance(found, Explanation) and found.code is F.CONTRADICTORY) is refused
    if isinstance(found, Explanation):
        assert found.values == {"gesture": G.TWO, "better": 1.0, "worse": 0.7}


@pytest.mark.parametrize(("taken", "refused"), [(4, False), (5, True)])
def test_an_idle_hand_that_is_taken_for_a_gesture_proves_nothing(taken: int, refused: bool) -> None:
    found = prove(samples({len(PARTS) - 1: sample(None, {G.FIVE: taken - 1, G.SEVEN: 1})}))
    assert (isinstance(found, Explanation) and found.code is F.IDLE_TAKEN) is refused
    if isinstance(found, Explanation):
        assert found.values["gesture"] is G.FIVE
        assert found.values["share"] == pytest.approx(taken / IDLE_FRAMES)


def test_an_idle_hand_may_look_like_a_gesture_that_does_not_command() -> None:
    five = PARTS.index(G.FIVE)
    unreliable = {at: sample(G.FIVE, {}) for at in (five, five + len(Gesture))}
    proof = prove(samples(unreliable | {len(PARTS) - 1: sample(None, {G.FIVE: 150})}))
    assert isinstance(proof, VocabularyProof)
    assert G.FIVE not in proof.vocabulary


def test_without_an_idle_hand_or_a_reliable_gesture_nothing_is_proven() -> None:
    without_idle = prove(samples()[:-1])
    assert isinstance(without_idle, Explanation)
    assert without_idle.code is F.IDLE_TAKEN
    none = prove([sample(part, {}) for part in PARTS])
    assert isinstance(none, Explanation)
    assert none.code is F.NONE_RELIABLE
