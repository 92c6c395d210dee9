"""The chain of one camera: hand, gesture, distance and button, frame by frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from kgdfa.button_state import ButtonMode, ButtonPlace, ButtonState
from kgdfa.commanding import Tracks, update_tracks
from kgdfa.depth import ChosenDistance, DepthFault, DepthRange, choose_distance
from kgdfa.distance import Distance, DistanceChoice, DistanceSource, RangeFinder
from kgdfa.gesture import Explanation, Gesture, HandRefusal, RuleSet, Verdict, Vote
from kgdfa.hand import Hand, is_cut_off
from kgdfa.preprocess import Image, Prepare, as_bgr8
from kgdfa.recognition import FrameReading, Recognition, recognise
from kgdfa.redetection import Shows
from kgdfa.track import Enrolment


@dataclass(frozen=True, slots=True, kw_only=True)
class PipelineInput:
    """What the pipeline needs of a frame. image_bgr: (h, w, 3) uint8; depth_m: (h, w) float32, 0 = none."""

    image_bgr: NDArray[np.uint8]
    captured_ns: int
    depth_m: NDArray[np.float32] | None = None
    depth_ns: int | None = None  # of depth_m, which may come with several images; None: captured_ns

    @property
    def map_ns(self) -> int:
        """When this very depth map first came."""
        return self.captured_ns if self.depth_ns is None else self.depth_ns


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """The result of one frame. `gesture` is voted and smoothed; `verdict` is this frame's alone.

    distance: by which the button decided; `depth_distance`: what depth measured, whichever decides.
    """

    captured_ns: int
    hand: Hand | None
    verdict: Verdict | None
    gesture: Gesture | None
    recognised_ns: int
    votes: int
    distance: Distance | None
    depth_distance: Distance | None
    button: ButtonState
    depth_fault: DepthFault | None = None  # why there is no depth_distance, or it does not decide
    refusal: Explanation | None = None  # why no hand in view commands
    vote_ns: tuple[int, ...] = ()  # captures of the frames that made `gesture`, or ended the one before
    reading: FrameReading | None = None  # what vote and button took


class Detector(Protocol):
    """Finds hands in an image, the tracked one first: `keypoints.HandDetector`, or a fake of ours."""

    def detect(self, image_bgr: Image, captured_ns: int) -> tuple[Hand, ...]:
        """The hands in one image; () when there is none."""


Follow = Callable[[Hand | None, bool, Shows | None], None]

UNRECOGNISED_FRAMES = 15  # of a hand without a gesture, after which one is sought: about half a second


def _alternating(vote: Vote, now_ns: int) -> Explanation | None:
    """Which gestures are read in turn."""
    if not vote.alternates(now_ns):
        return None
    return Explanation(HandRefusal.ALTERNATING, {"gesture": vote.read, "other": vote.read_before})


class Pipeline:
    """The stages in order, and what each must remember from one frame to the next."""

    def __init__(
        self,
        *,
        detector: Detector,
        rules: RuleSet,
        range_finder: RangeFinder,
        place: ButtonPlace,
        mode: ButtonMode = ButtonMode.ROBUST,
        prepare: Prepare | None = None,
        depth_finder: DepthRange | None = None,
        choice: DistanceChoice = DistanceChoice.MONOCULAR,
        enrolment: Enrolment | None = None,
        follow: Follow = lambda _hand, _unknown, _sought: None,
    ) -> None:
        """choice: which distance commands; depth needs a depth_finder. enrolment: whose hand commands; None: anybody's.

        follow: is given each frame's commanding hand, if any, whether another one may be the enrolled one, and what is
        sought: the gesture in force where the frame does not show it, any gesture after UNRECOGNISED_FRAMES without.
        """
        self._enrolment = enrolment
        self._follow = follow
        self._detector = detector
        self._rules = rules
        self._range_finder = range_finder
        self._depth_finder = depth_finder
        self._place = place
        self._mode = mode
        self._prepare = prepare or as_bgr8
        self._tracks = Tracks()
        self._hand_number = 0  # of the newest hand that commanded
        self._recognition = Recognition()
        self._unrecognised = 0  # frames in a row without a gesture
        self._choice = choice
        self._chosen = ChosenDistance()
        self._depth_ns: int | None = None  # of the newest depth map

    def process(self, source: PipelineInput) -> Report:
        """One frame through the chain. Raises KgdfaError for an image that can't be read."""
        now_ns = source.captured_ns
        image = self._prepare(source.image_bgr)
        verdicts = [(hand, self._rules.classify(hand)) for hand in self._detector.detect(image, now_ns)]
        hand, verdict = self._update_tracks(verdicts, now_ns)
        monocular = self._range_finder.measure(hand, now_ns) if hand else None
        repeated = self._is_repeated(source)
        depth, fault = self._measure_depth(source, hand)
        self._chosen = choose_distance(self._chosen, self._choice, monocular, depth)
        distance = self._chosen.distance
        reading = FrameReading(
            captured_ns=now_ns,
            hand=self._hand_number,
            gesture=verdict.gesture if verdict and self._tracks.known else None,
            cut_off=hand is not None and is_cut_off(hand, image.shape[1], image.shape[0]),
            distance_m=distance.safe_m if distance else None,
            beside_px=self._place.beside_px(hand.bounding_box) if hand else None,
            source=distance.source if distance else DistanceSource.MONOCULAR,
            bridge_m=self._chosen.bridge_m,
            repeated=repeated and distance is not None and distance.source is DistanceSource.DEPTH,
        )
        self._recognition = recognise(self._recognition, reading, self._place, self._mode)
        vote = self._recognition.vote
        commanding = self._tracks.commanding
        sought = self._sought(vote.gesture, verdict)
        self._follow(commanding.hand if commanding else None, not self._tracks.known, sought)
        return Report(
            captured_ns=now_ns,
            hand=hand,
            verdict=verdict,
            gesture=vote.gesture,
            recognised_ns=vote.recognised_ns,
            votes=vote.votes,
            distance=distance,
            depth_distance=depth,
            depth_fault=self._chosen.fault or fault,
            button=self._recognition.button,
            refusal=self._tracks.refusal or (_alternating(vote, now_ns) if commanding else None),
            vote_ns=vote.decided_ns,
            reading=reading,
        )

    def _update_tracks(self, verdicts: list[tuple[Hand, Verdict]], now_ns: int) -> tuple[Hand | None, Verdict | None]:
        """The commanding hand and its verdict; another one inherits neither votes nor a steadied distance."""
        hands = tuple(hand for hand, _ in verdicts)
        signing = [verdict.gesture is not None for _, verdict in verdicts]
        self._tracks = update_tracks(self._tracks, hands, now_ns, self._enrolment, signing)
        track = self._tracks.commanding
        if track is not None and track.number != self._hand_number:
            self._hand_number = track.number
            self._range_finder.reset()
            self._chosen = ChosenDistance()
            if self._depth_finder is not None:
                self._depth_finder.reset()
        commanding = track.hand if track else None
        return next((both for both in verdicts if both[0] is commanding), (None, None))

    def _sought(self, voted: Gesture | None, verdict: Verdict | None) -> Shows | None:
        """What the keypoints of this frame lack, which may be of a shape that the hand does not have; else None."""
        recognised = verdict.gesture if verdict else None
        self._unrecognised = 0 if verdict is None or recognised or voted else self._unrecognised + 1
        if verdict is not None and voted is not None and recognised is not voted:
            return lambda hand: self._rules.classify(hand).gesture is voted
        if self._unrecognised % UNRECOGNISED_FRAMES == UNRECOGNISED_FRAMES - 1:
            return lambda hand: self._rules.classify(hand).gesture is not None
        return None

    def _is_repeated(self, source: PipelineInput) -> bool:
        """The depth map is that of a frame before: a camera whose depth comes slower gives it with several images."""
        if source.depth_m is None:
            return False
        repeated, self._depth_ns = source.map_ns == self._depth_ns, source.map_ns
        return repeated

    def _measure_depth(self, source: PipelineInput, hand: Hand | None) -> tuple[Distance | None, DepthFault | None]:
        """The depth camera's distance, or why there is none; nothing without a depth map."""
        if source.depth_m is None or self._depth_finder is None or hand is None:
            return None, None
        depth = self._depth_finder.measure(source.depth_m, hand, source.map_ns)
        return depth, self._depth_finder.fault
