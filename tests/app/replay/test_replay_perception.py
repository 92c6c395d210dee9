"""Decisions of vote and button, made again from the recorded frames, are the recorded ones; a changed value is told."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import structs

from app.perception.frames import DecisionRecorder, FrameBatch, button_of, button_record, unpack
from app.replay.difference import Difference
from app.replay.perception import DECISIONS, NOT_REPLAYED
from app.replay.session import replay
from kgdfa.button_state import ButtonMode, ButtonPlace, PressCancel
from kgdfa.distance import Distance, DistanceChoice, DistanceSource
from kgdfa.gesture import VOTE_FRAMES, Decision, Explanation, Gesture, Verdict
from kgdfa.pipeline import Report
from kgdfa.recognition import FrameReading, Recognition, recognise
from logs.reason import reason
from logs.records import Body, Calibration, Cancel, Frames, GestureOnset, Press, Record, Release
from tests.app.perception.test_reporting import SCALE

PLACE = ButtonPlace(x_px=640.0, y_px=360.0, radius_px=76.8, threshold_m=0.2)
FRAME_NS = 33_333_333
ONE, TWO = Gesture.ONE, Gesture.TWO


def seen(distance_m: float | None, gesture: Gesture | None = ONE, **changes: object) -> FrameReading:
    reading = FrameReading(captured_ns=0, hand=1, gesture=gesture, cut_off=False, distance_m=distance_m, beside_px=0.0)
    return replace(reading, **changes)  # type: ignore[arg-type]


NOBODY = replace(seen(None), gesture=None, beside_px=None)
PUSH = (*[seen(0.4)] * 4, seen(0.3), seen(0.22), seen(0.19), seen(0.18), seen(0.25), seen(0.4))
CANCELLED = (*[seen(0.4, TWO)] * 8, seen(0.22, TWO), seen(0.19, TWO), *[seen(0.18, beside_px=200.0)] * 2, seen(0.4))


def timed(readings: Iterable[FrameReading], gaps_ns: Iterable[int] = ()) -> list[FrameReading]:
    """A frame after another, or after so long."""
    gaps, now_ns, found = iter(gaps_ns), 10**12, []
    for reading in readings:
        now_ns += next(gaps, FRAME_NS)
        found.append(replace(reading, captured_ns=now_ns))
    return found


def recorded(readings: Sequence[FrameReading], mode: ButtonMode = ButtonMode.ROBUST) -> list[Body]:
    """What perception records of these frames; the pipeline's report is made of them as the pipeline does."""
    scale = Calibration(
        method=SCALE.anchor_method,
        anchor_m=SCALE.anchor_m,
        focal_px=SCALE.focal_px,
        focal_source=SCALE.focal_source,
    )
    bodies: list[Body] = [scale, button_record(PLACE, mode, DistanceChoice.MONOCULAR)]
    state, recorder = Recognition(), DecisionRecorder(SCALE)
    for reading in readings:
        state = recognise(state, reading, PLACE, mode)
        bodies += recorder.take(report(reading, state))
    return [*bodies, *recorder.end()]


def report(reading: FrameReading, state: Recognition) -> Report:
    """Shown a centimetre nearer than the safe distance."""
    named, distance_m = reading.gesture, reading.distance_m
    verdict = Verdict(gesture=named, confidence=0.87654321, explanation=Explanation(Decision.CLOSEST))
    return Report(
        captured_ns=reading.captured_ns,
        hand=None,
        verdict=verdict if reading.beside_px is not None else None,
        gesture=state.vote.gesture,
        recognised_ns=state.vote.recognised_ns,
        votes=min(state.vote.count, VOTE_FRAMES),
        distance=None if distance_m is None else Distance(shown_m=distance_m - 0.01, safe_m=distance_m, sd_m=0.01),
        depth_distance=None,
        button=state.button,
        vote_ns=state.vote.decided_ns,
        reading=reading,
    )


def trail(bodies: Iterable[Body], process: str = "perception") -> list[Record]:
    """As a file gives them back."""
    lines = (
        Record(
            body=body,
            monotonic_ns=number,
            operator="",
            previous="",
            process=process,
            schema=2,
            sequence=number,
            session="s",
            wall="",
            hash="",
        )
        for number, body in enumerate(bodies)
    )
    return [msgspec.json.decode(msgspec.json.encode(line), type=Record) for line in lines]


def differing(bodies: Iterable[Body]) -> tuple[Difference, ...]:
    return replay(trail(bodies)).differences


hands = st.builds(
    seen,
    st.one_of(st.none(), st.floats(0.05, 0.7)),
    st.sampled_from([None, ONE, TWO]),
    hand=st.sampled_from([0] * 9 + [1]),
    cut_off=st.booleans(),
    beside_px=st.one_of(st.just(0.0), st.floats(0.0, 300.0)),
)
by_depth = st.builds(
    seen,
    st.floats(0.05, 0.7),
    hand=st.sampled_from([0] * 9 + [1]),
    source=st.just(DistanceSource.DEPTH),
    bridge_m=st.one_of(st.none(), st.floats(0.05, 0.7)),
    repeated=st.booleans(),
)
frames = st.lists(
    st.one_of(
        hands,
        by_depth,
        st.sampled_from([NOBODY, replace(NOBODY, hand=0)]),
        st.sampled_from([replace(one, hand=0) for one in PUSH]),
    ),
    max_size=80,
)


def renumbered(readings: Iterable[FrameReading]) -> list[FrameReading]:
    """`hand` says whether it is another one than before: numbers as the track counts them."""
    number, found = 0, []
    for reading in readings:
        number += reading.hand
        found.append(replace(reading, hand=number))
    return found


@given(frames, st.lists(st.integers(0, 400_000_000), max_size=80), st.sampled_from(ButtonMode))
def test_whatever_the_frames_the_replay_is_equal(
    readings: list[FrameReading], gaps_ns: list[int], mode: ButtonMode
) -> None:
    bodies = recorded(timed(renumbered(readings), gaps_ns), mode)
    again = replay(trail(bodies))
    assert again.differences == ()
    assert (again.replayed, again.not_recorded) == (sum(isinstance(body, DECISIONS) for body in bodies), 0)


@given(frames)
def test_frames_are_unpacked_as_they_were(readings: list[FrameReading]) -> None:
    given_frames = timed(renumbered(readings))
    batch = FrameBatch()
    for reading in given_frames:
        batch.add(reading, 0.5)
    found = [reading for record in batch.take(at_once=True) for reading, _ in unpack(record, 0)]
    assert found == given_frames


def test_the_setup_of_the_button_is_kept() -> None:
    assert button_of(button_record(PLACE, ButtonMode.PUBLISHED, DistanceChoice.MONOCULAR)) == (
        PLACE,
        ButtonMode.PUBLISHED,
    )


CHANGED = [seen(0.4)] * 3  # a gesture that takes another's place has to stand
SESSION = recorded(timed((*PUSH, *[NOBODY] * 5, *CANCELLED, *CHANGED, *PUSH)))


def test_a_session_of_pushes_is_replayed_whole() -> None:
    kinds = [type(body).__name__ for body in SESSION if isinstance(body, DECISIONS)]
    assert kinds.count("Press") == 3
    assert kinds.count("Release") == 2
    assert kinds.count("Cancel") == 1
    assert differing(SESSION) == ()


PRESSED = PUSH[:8]  # and then no frame any more


def test_a_press_in_force_at_the_end_is_cancelled_and_replayed_with_what_begins_anew() -> None:
    ended = recorded(timed(PRESSED))
    onset, cancel = ended[-2:]
    assert isinstance(onset, GestureOnset)
    assert isinstance(cancel, Cancel)
    assert (onset.gesture, cancel.gesture) == (None, "1")
    assert (onset.explanation, cancel.reason) == (reason(Decision.ENDED), reason(PressCancel.ENDED))
    again = replay(trail([*ended, *recorded(timed(PUSH))]))
    assert again.differences == ()
    killed = [*ended[:-2], *recorded(timed(PUSH))]  # or an older trail
    assert differing(killed) == ()
    (found,) = differing([*ended[:-1], structs.replace(cancel, pressed_ns=1)])
    assert (found.kind, found.field) == ("cancel", "pressed_ns")
    (found,) = differing([*ended[:-1], *recorded(timed(PUSH))])
    assert (found.field, found.replayed) == ("decision", "cancel")


def test_frames_do_not_go_on_after_an_end() -> None:
    readings = timed(PUSH)
    ended, whole = recorded(readings[:8]), recorded(readings)
    goes_on = [*ended, *whole[len(ended) - 2 :]]
    assert "number" in {one.field for one in differing(goes_on)}


def changed(field: str, value: object) -> object:
    """Another value of the same kind."""
    if isinstance(value, tuple):
        return (*value, 1)
    if isinstance(value, bool):
        return not value
    if isinstance(value, int | float):
        return value + 1
    return 1.0 if value is None and field != "gesture" else "2" if value == "1" else "1"


@pytest.mark.parametrize("kind", DECISIONS)
def test_every_value_of_a_decision_that_is_changed_is_told(kind: type[Body]) -> None:
    for place, body in enumerate(SESSION):
        if not isinstance(body, kind) or kind.__name__ == "Hint":
            continue
        for field in set(body.__struct_fields__) - NOT_REPLAYED - {"reason"}:
            tampered = [*SESSION]
            tampered[place] = msgspec.structs.replace(body, **{field: changed(field, getattr(body, field))})
            (told,) = differing(tampered)
            assert (told.sequence, told.field) == (place, field)
            assert told.recorded != told.replayed


def test_a_distance_that_is_changed_takes_its_press_away() -> None:
    place, batch = next((at - 1, SESSION[at - 1]) for at, body in enumerate(SESSION) if isinstance(body, Press))
    assert isinstance(batch, Frames)
    tampered = [*SESSION]
    tampered[place] = msgspec.structs.replace(batch, safe_distance_m=(*batch.safe_distance_m[:-1], 0.21))
    told = differing(tampered)
    assert {"decision"} <= {one.field for one in told}
    assert told[0].sequence == place + 1


@pytest.mark.parametrize(
    "changes",
    [{"hands": "hhh"}, {"hands": "h.."}, {"confidence": (0.5, 0.5, 0.5)}],
    ids=["a hand more", "a hand less", "a figure more"],
)
def test_frames_whose_columns_do_not_fit_their_hands_are_told(changes: dict[str, object]) -> None:
    bodies = recorded(timed([seen(0.4), seen(0.4), NOBODY]))
    place, batch = next((at, body) for at, body in enumerate(bodies) if isinstance(body, Frames))
    assert batch.hands == "nh."
    bodies[place] = structs.replace(batch, **changes)
    (told,) = differing(bodies)
    assert (told.sequence, told.field, told.recorded, told.replayed) == (place, "name", "frames", None)


def test_what_is_left_out_is_told() -> None:
    place = next(at for at, body in enumerate(SESSION) if isinstance(body, Release))
    (told,) = differing([*SESSION[:place], *SESSION[place + 1 :]])
    assert (told.field, told.recorded, told.replayed) == ("decision", None, "release")
    place = next(at for at, body in enumerate(SESSION) if isinstance(body, Frames))
    told = differing([*SESSION[:place], *SESSION[place + 1 :]])[-1]
    assert (told.field, told.replayed) == ("number", 0)


def test_an_older_trail_has_nothing_to_replay() -> None:
    old = [body for body in SESSION if isinstance(body, DECISIONS)]
    again = replay(trail(old))
    assert (again.replayed, again.not_recorded, again.differences) == (0, len(old), ())
    assert any(isinstance(body, GestureOnset) for body in old)
