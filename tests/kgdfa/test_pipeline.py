from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from kgdfa.button_state import ButtonPlace
from kgdfa.depth import DepthFault, DepthRange
from kgdfa.distance import DistanceChoice
from kgdfa.draw import draw
from kgdfa.gesture import Gesture, HandRefusal
from kgdfa.hand import Hand, Side
from kgdfa.pipeline import UNRECOGNISED_FRAMES, Pipeline, PipelineInput, Report
from kgdfa.preprocess import Image
from kgdfa.published import PublishedRules
from kgdfa.robust_distance import RobustRange
from kgdfa.track import LOST_FRAMES, Enrolment
from tests.kgdfa.hands import STATES, drawn_hand

BLACK = np.zeros((720, 1280, 3), np.uint8)
PLACE = ButtonPlace(x_px=480, y_px=400, radius_px=60, threshold_m=0.20)


class ScriptedDetector:
    """Finds the given hands, frame by frame."""

    def __init__(self, frames: Sequence[tuple[Hand, ...]]) -> None:
        self._frames = list(frames)

    def detect(self, image_bgr: Image, captured_ns: int) -> tuple[Hand, ...]:
        return self._frames.pop(0)


def run(frames: Sequence[tuple[Hand, ...]], enrolment: Enrolment | None = None) -> list[Report]:
    pipeline = Pipeline(
        detector=ScriptedDetector(frames),
        rules=PublishedRules(),
        range_finder=RobustRange(focal_px=650.0, reference_m=0.065),
        place=PLACE,
        enrolment=enrolment,
    )
    pictures = [PipelineInput(image_bgr=BLACK, captured_ns=(k + 1) * 33_000_000) for k in range(len(frames))]
    return [pipeline.process(picture) for picture in pictures]


def test_a_depth_map_refused_as_a_jump_is_refused_with_the_next_image_too() -> None:
    """By its own moment: to that of the image the hand could have come so far."""
    came = [(1, 0.40), (2, 0.29), (2, 0.29), (4, 0.40)]  # frame with which the map came first, metres
    pipeline = Pipeline(
        detector=ScriptedDetector([(shown(Gesture.TWO),)] * len(came)),
        rules=PublishedRules(),
        range_finder=RobustRange(focal_px=650.0, reference_m=0.065),
        place=PLACE,
        depth_finder=DepthRange(mode="robust"),
        choice=DistanceChoice.DEPTH,
    )
    reports = [
        pipeline.process(
            PipelineInput(
                image_bgr=BLACK,
                captured_ns=frame * 33_000_000,
                depth_m=np.full(BLACK.shape[:2], depth_m, np.float32),
                depth_ns=first * 33_000_000,
            )
        )
        for frame, (first, depth_m) in enumerate(came, 1)
    ]
    assert [report.depth_fault for report in reports] == [None, DepthFault.JUMP, DepthFault.JUMP, None]
    assert [report.distance is None for report in reports] == [False, True, True, False]


def shown(gesture: Gesture) -> Hand:
    return drawn_hand(STATES[gesture])


def test_three_frames_make_a_gesture_with_its_distance() -> None:
    reports = run([(shown(Gesture.TWO),)] * 4)
    assert [report.gesture for report in reports] == [None, None, Gesture.TWO, Gesture.TWO]
    assert reports[3].recognised_ns == reports[2].captured_ns
    assert reports[3].distance is not None
    assert reports[3].verdict is not None


def test_no_hand_is_a_report_too() -> None:
    report = run([()])[0]
    assert (report.hand, report.verdict, report.gesture, report.distance) == (None, None, None, None)
    assert not report.button.pressed


def test_flips_blur_and_two_lost_frames_do_not_end_a_gesture() -> None:
    two = shown(Gesture.TWO)
    flipped = replace(two, side=Side.LEFT)
    reports = run([(two,)] * 3 + [(flipped,), (), (), (two,), (shown(Gesture.FIVE),), (two,)])
    assert {report.gesture for report in reports[2:]} == {Gesture.TWO}


def test_a_hand_read_as_two_gestures_in_turn_commands_neither_and_is_told_so() -> None:
    turns = [shown(gesture) for gesture in (Gesture.THREE, Gesture.TWO) * 2 for _ in range(4)]
    reports = run([(hand,) for hand in turns])
    assert reports[6].gesture is Gesture.TWO
    refusal = reports[-1].refusal
    assert reports[-1].gesture is None
    assert refusal is not None
    assert refusal.code is HandRefusal.ALTERNATING
    assert refusal.values == {"gesture": Gesture.TWO, "other": Gesture.THREE}


def test_a_hand_read_in_turns_that_has_left_is_reported_no_more() -> None:
    turns = [(shown(gesture),) for gesture in (Gesture.THREE, Gesture.TWO) * 2 for _ in range(4)]
    reports = run([*turns, (), *turns[-1:], *[()] * (LOST_FRAMES + 1)])
    assert all(report.refusal for report in reports[len(turns) - 1 : len(turns) + 2]), "over a frame without it as well"
    assert reports[-1].refusal is None


def at_edge(gesture: Gesture, off_px: float) -> tuple[Hand]:
    """A hand moved to the left; from about 330 px on its thumb is out of the image."""
    return (drawn_hand(STATES[gesture], at_px=(-off_px, 0.0)),)


def test_a_hand_partly_out_of_the_image_keeps_its_gesture() -> None:
    leaving = [at_edge(Gesture.FIVE, off_px) for off_px in (0, 0, 0, 100, 200, 300, 400, 400, 400, 300)]
    assert {report.gesture for report in run(leaving)[2:]} == {Gesture.FIVE}


def test_a_hand_entering_at_the_edge_is_judged_when_it_is_whole() -> None:
    entering = [at_edge(Gesture.FIVE, off_px) for off_px in (450, 450, 450, 400, 350, 300, 250, 200, 150)]
    assert [report.gesture for report in run(entering)] == [None] * 7 + [Gesture.FIVE] * 2


def test_a_second_hand_neither_steals_nor_adds_votes() -> None:
    two, other = shown(Gesture.TWO), drawn_hand(STATES[Gesture.FIVE], at_px=(600.0, 0.0))
    reports = run([(two,)] * 3 + [(other, two)] * 5)
    assert {report.gesture for report in reports[2:]} == {Gesture.TWO}


def test_votes_of_one_hand_do_not_count_for_the_next() -> None:
    two, other = shown(Gesture.TWO), drawn_hand(STATES[Gesture.TWO], at_px=(600.0, 0.0))
    reports = run([(two,)] * 2 + [()] * 6 + [(other,)] * 3)
    assert [report.gesture for report in reports[8:]] == [None, None, Gesture.TWO]


def test_two_hands_of_equal_claim_are_none() -> None:
    two, other = shown(Gesture.TWO), drawn_hand(STATES[Gesture.FIVE], at_px=(600.0, 0.0))
    reports = run([(two, other)] * 5)
    assert all(report.hand is None and report.gesture is None for report in reports)
    assert {report.refusal.code for report in reports if report.refusal} == {HandRefusal.TWO_HANDS}


def nearer(scale: float) -> Hand:
    """A two that has come nearer by this factor."""
    return drawn_hand(STATES[Gesture.TWO], scale=scale, at_px=(490 * (1 - scale), 400 * (1 - scale)))


def test_the_other_hand_signs_and_pushes_in_vain() -> None:
    """The enrolled hand commands with the very same frames."""
    push = [nearer(scale) for scale in (1, 1, 1, 1, 1.1, 1.25, 1.4, 1.6, 1.75, 1.75, 1.6, 1.4, 1.25, 1.1, 1, 1)]
    for side, commands in ((Side.RIGHT, 1), (Side.LEFT, 0)):
        reports = run([(hand,) for hand in push], Enrolment(side=side))
        assert reports[-1].button.release_count == commands
        assert (reports[-1].refusal is None) is bool(commands)
        assert any(report.gesture for report in reports) is bool(commands)


def test_drawing_marks_the_hand_and_the_button() -> None:
    report = run([(shown(Gesture.FIVE),)])[0]
    picture = BLACK.copy()
    draw(picture, report, PLACE)
    x, y = report.hand.image_px[8].astype(int) if report.hand else (0, 0)
    assert picture[y, x].any()
    assert picture[int(PLACE.y_px), int(PLACE.x_px + PLACE.radius_px)].any()
    far_out = replace(report, hand=drawn_hand("ooooo", at_px=(1e7, -1e7)))
    draw(picture, far_out, PLACE)


def doubts(frames: Sequence[tuple[Hand, ...]]) -> list[bool]:
    """Whether each frame's keypoints are doubted, as the detector is told."""
    told: list[bool] = []
    pipeline = Pipeline(
        detector=ScriptedDetector(frames),
        rules=PublishedRules(),
        range_finder=RobustRange(focal_px=650.0, reference_m=0.065),
        place=PLACE,
        follow=lambda _hand, _unknown, sought: told.append(sought is not None),
    )
    for frame in range(len(frames)):
        pipeline.process(PipelineInput(image_bgr=BLACK, captured_ns=(frame + 1) * 33_000_000))
    return told


def test_keypoints_that_no_longer_show_the_gesture_in_force_are_doubted() -> None:
    two, none = (shown(Gesture.TWO),), (drawn_hand("ohhhh"),)
    assert doubts([two] * 4 + [none, none, two, (), two]) == [False] * 4 + [True, True, False, False, False]
    assert doubts([two] * 3 + [none] * 6) == [False] * 3 + [True] * 4 + [False] * 2  # the fifth ends the gesture


def test_a_hand_without_a_gesture_is_doubted_every_half_second() -> None:
    none = (drawn_hand("ohhhh"),)
    told = doubts([none] * (2 * UNRECOGNISED_FRAMES))
    assert [frame for frame, doubted in enumerate(told, 1) if doubted] == [14, 29]
    assert not any(doubts([()] * UNRECOGNISED_FRAMES))
