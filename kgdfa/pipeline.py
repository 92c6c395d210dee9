"""The chain of one camera: hand, gesture, distance and button, frame by frame; and which hand commands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from kgdfa.button import ButtonInput, ButtonMode, ButtonPlace, ButtonState, advance
from kgdfa.distance import Distance, RangeFinder
from kgdfa.gesture import VOTE_FRAMES, Gesture, RuleSet, Verdict
from kgdfa.hand import Hand, is_cut_off
from kgdfa.preprocess import Image, as_bgr8
from kgdfa.recognition import FrameReading, Recognition, recognise

LOST_FRAMES = 5  # a hand gone this long is gone; fewer may be blur or the image's edge
REACH_REFERENCES = 1.5  # how far a hand may be from where it was a frame ago, in reference segments: 3 m/s at 30 Hz
REACH_GROWTH_REFERENCES = 0.5  # and how much farther for each frame without it
EQUAL_CLAIM = 0.75  # a second hand this large, relative to the first, claims the command as well


@dataclass(frozen=True, slots=True, kw_only=True)
class Track:
    """The commanding hand. `number` grows with every new one; `lost` counts frames without it."""

    hand: Hand | None = None
    last: Hand | None = None
    lost: int = 0
    number: int = 0
    contested: bool = False


def update_track(track: Track, hands: tuple[Hand, ...]) -> Track:
    """The track after one frame. A new hand is taken only when none is followed and none claims as well."""
    last = track.last
    if last is not None:
        near = [hand for hand in hands if _reach(hand, last) <= REACH_REFERENCES + REACH_GROWTH_REFERENCES * track.lost]
        if near:
            hand = min(near, key=lambda candidate: _reach(candidate, last))
            return replace(track, hand=hand, last=hand, lost=0, contested=False)
        if track.lost < LOST_FRAMES:
            return replace(track, hand=None, lost=track.lost + 1)
    return _acquire(track, hands)


def _acquire(track: Track, hands: tuple[Hand, ...]) -> Track:
    by_size = sorted(hands, key=lambda hand: hand.reference_px, reverse=True)
    contested = len(by_size) > 1 and by_size[1].reference_px >= EQUAL_CLAIM * by_size[0].reference_px
    if not by_size or contested:
        return Track(number=track.number, contested=contested)
    return Track(hand=by_size[0], last=by_size[0], number=track.number + 1)


def _reach(hand: Hand, last: Hand) -> float:
    """How far the palm has moved, in units of the larger of the two reference segments."""
    return hand.palm_shift_px(last) / max(hand.reference_px, last.reference_px, 1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class PipelineInput:
    """What the pipeline needs of a frame. image_bgr: (h, w, 3) uint8; depth_m: (h, w) float32, 0 = none."""

    image_bgr: NDArray[np.uint8]
    captured_ns: int
    depth_m: NDArray[np.float32] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """The result of one frame. `gesture` is voted and smoothed; `verdict` is this frame's alone."""

    captured_ns: int
    hand: Hand | None
    verdict: Verdict | None
    gesture: Gesture | None
    recognised_ns: int
    votes: int
    distance: Distance | None
    depth_distance: Distance | None
    button: ButtonState
    depth_button: ButtonState | None = None
    contested: bool = False  # two hands claim the command: neither has it
    vote_ns: tuple[int, ...] = ()  # captures of the frames that made `gesture`, or ended the one before
    reading: FrameReading | None = None  # what vote and button took


class Detector(Protocol):
    """Finds hands in an image, the tracked one first: `keypoints.HandDetector`, or a fake of ours."""

    def detect(self, image_bgr: Image, captured_ns: int) -> tuple[Hand, ...]:
        """The hands in one image; () when there is none."""
        ...


class DepthFinder(Protocol):
    """Measures distance on a depth map, falling back on the monocular one where the map has nothing."""

    def measure(
        self, depth_m: NDArray[np.float32], hand: Hand, monocular: Distance | None, captured_ns: int
    ) -> Distance | None:
        """The distance now, or None."""
        ...

    def reset(self) -> None:
        """Forget the past: another hand, or a gap."""
        ...


Prepare = Callable[[NDArray[np.uint8]], Image]


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
        depth_finder: DepthFinder | None = None,
    ) -> None:
        self._detector = detector
        self._rules = rules
        self._range_finder = range_finder
        self._depth_finder = depth_finder
        self._place = place
        self._mode = mode
        self._prepare = prepare or as_bgr8
        self._track = Track()
        self._recognition = Recognition()
        self._depth_button: ButtonState | None = None

    def process(self, source: PipelineInput) -> Report:
        """One frame through the chain. Raises KgdfaError for an image that can't be read."""
        now_ns = source.captured_ns
        image = self._prepare(source.image_bgr)
        hand = self._update_track(self._detector.detect(image, now_ns))
        verdict = self._rules.classify(hand) if hand else None
        distance = self._range_finder.measure(hand, now_ns) if hand else None
        reading = FrameReading(
            captured_ns=now_ns,
            hand=self._track.number,
            gesture=verdict.gesture if verdict else None,
            cut_off=hand is not None and is_cut_off(hand, image.shape[1], image.shape[0]),
            distance_m=distance.safe_m if distance else None,
            beside_px=self._place.beside_px(hand.bounding_box) if hand else None,
        )
        self._recognition = recognise(self._recognition, reading, self._place, self._mode)
        vote = self._recognition.vote
        depth_distance = self._measure_depth(source, hand, distance, reading.beside_px)
        return Report(
            captured_ns=now_ns,
            hand=hand,
            verdict=verdict,
            gesture=vote.gesture,
            recognised_ns=vote.recognised_ns,
            votes=min(vote.count, VOTE_FRAMES),
            distance=distance,
            depth_distance=depth_distance,
            button=self._recognition.button,
            depth_button=self._depth_button,
            contested=self._track.contested,
            vote_ns=vote.decided_ns,
            reading=reading,
        )

    def _update_track(self, hands: tuple[Hand, ...]) -> Hand | None:
        """The commanding hand; another one inherits neither votes nor a steadied distance."""
        before = self._track.number
        self._track = update_track(self._track, hands)
        if self._track.number != before:
            self._range_finder.reset()
            if self._depth_finder is not None:
                self._depth_finder.reset()
        return self._track.hand

    def _measure_depth(
        self, source: PipelineInput, hand: Hand | None, monocular: Distance | None, beside_px: float | None
    ) -> Distance | None:
        """The depth camera's own distance and button, beside the monocular ones; nothing without a depth map."""
        if source.depth_m is None or self._depth_finder is None:
            return None
        now_ns = source.captured_ns
        observed = self._depth_finder.measure(source.depth_m, hand, monocular, now_ns) if hand else None
        vote = self._recognition.vote
        observed_by_depth = ButtonInput(
            captured_ns=now_ns,
            gesture=vote.gesture,
            recognised_ns=vote.recognised_ns,
            distance_m=observed.safe_m if observed else None,
            beside_px=beside_px,
        )
        self._depth_button = advance(self._depth_button or ButtonState(), observed_by_depth, self._place, self._mode)
        return observed
