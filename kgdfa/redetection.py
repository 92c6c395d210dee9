"""How a live image is shown to the tracker: a near hand smaller, and other views while no hand is found.

A tracker searches for the hand near where it was, at the size that it had, so that a push of 0.3 s leaves it behind. A
near hand is therefore shown smaller, by as much as it is about to grow: on the view it stays where it was. The frame
that loses a hand all the same is given again, smaller yet: with none to track, the tracker searches everywhere.
A frame in which a near palm narrows as no hand can is detected untracked as well: led by a wrist outside the image, the
tracker looked beside the hand. That costs the next frame, so it is done for near hands only, and not for the frames
after it.

A frame has time for one view only (`views`), so a search shows another one in each frame. What finds a hand is kept
until it is lost.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np

from kgdfa.augmentation import to_image
from kgdfa.hand import Hand, same_place
from kgdfa.preprocess import Image
from kgdfa.views import FULL_VIEW, REDETECTION_VIEWS, SHRUNK, View, in_other_light, near_view, render_view

PATIENCE_FRAMES = 2  # without a hand before the search begins, plainly: the plain image finds most that come
# Of the image's height. A longer palm is shown smaller, at this size: an adult's nearer than 27 cm to the usual lens.
LARGEST_PALM = 0.30
SOUGHT_PALM = 0.27  # a lost hand's, a little smaller than a followed one's
GROWING_AGAIN = 1.1  # from frame to frame, from the one size to the other
STEADY_FROM = 0.95  # so little is not worth showing smaller
# From frame to frame 5-17, beside all keypoints' spread, narrows by less, but for hands that turn edge on: of 28 that
# did in 120 pushes 25 read too far by a quarter and more, and these were 25 of 37 such readings.
LEAST_NARROWING = 0.80
LOOK_FRAMES = 6  # from one untracked detection to the next, at least: as many as a push of 0.3 s is near in
# How far the keypoints of a tracked hand without the gesture sought lie from those of an untracked detection, RMS in
# palm lengths, before the tracker is made to forget. Of a digital fist that its tracker takes for an open hand, 0.18
# and more in 95 % of frames; of hands that are tracked rightly 0.05 to 0.16.
SLIPPED = 0.16
# A look that failed so long ago tells nothing of the hand in view: the next one is in the light that is tracked in.
RETRY_FRAMES = 30
# From the beginning of a look to the frame that takes its result: an untracked detection takes about as long as two
# tracked ones, and runs beside them. Always as many, so that the same frames give the same hands on every machine.
LOOK_LAG_FRAMES = 2
MOST_GROWTH = 1.35  # from frame to frame: a push of 0.3 s from 36 cm, 30 frames per second, makes it grow by 1.3
# A push that begins grows by more from frame to frame; it is expected to go on so, by at most this share more.
MOST_QUICKER = 1.15
NEAR_FRAMES = 3  # in which a hand just lost is sought at the size that it had: as many as end a press
# A palm from this length on is shown so even plainly: of 299 such frames the keypoints then lie 0.005 palm lengths from
# those of the whole image (median), and a frame takes 0.3 ms less.
SHRUNK_PALM_PX = 150
Shows = Callable[[Hand], bool]  # whether a hand shows the gesture that is sought, or any
Detection = Callable[[], tuple[Hand, ...]]  # one that has begun: waits for its hands


@dataclass(frozen=True, slots=True)
class RedetectionState:
    """The view of the next frame, and how many frames in a row before it showed no hand."""

    view: View = FULL_VIEW
    missing: int = 0


def next_state(search: RedetectionState, *, found: bool) -> RedetectionState:
    """The state after one more frame."""
    if found:
        return replace(search, missing=0)
    missing = search.missing + 1
    if missing < PATIENCE_FRAMES:
        return replace(search, missing=missing)
    return RedetectionState(REDETECTION_VIEWS[(missing - PATIENCE_FRAMES) % len(REDETECTION_VIEWS)], missing)


@dataclass(frozen=True, slots=True)
class PalmGrowth:
    """How large a followed hand is, pixels, and how it is about to grow.

    spread: of all its keypoints; breadth: 5-17 as a share of it. growth: expected until the next frame.
    """

    palm_px: float
    spread_px: float
    breadth: float
    narrowed: bool = False  # since the frame before, as no hand can
    growth: float = 1.0
    shown: float = LARGEST_PALM  # length of the palm on the view, where it is shown smaller, of the image's height

    @classmethod
    def of(cls, hand: Hand, before: PalmGrowth | None) -> PalmGrowth:
        """Its growth since the frame before; none is known of a hand that has just come."""
        off_px = hand.image_px - np.add.reduce(hand.image_px) / len(hand.image_px)
        spread_px = max(math.sqrt(float(np.vdot(off_px, off_px)) / len(off_px)), 1.0)
        breadth = hand.reference_px / spread_px
        if before is None:
            return cls(hand.palm_px, spread_px, breadth)
        grown = spread_px / before.spread_px
        if grown * STEADY_FROM > 1:
            grown *= min(MOST_QUICKER, max(1.0, grown / max(1.0, before.growth)))
        growth = min(MOST_GROWTH, max(1 / MOST_GROWTH, grown))
        narrowed = breadth < LEAST_NARROWING * before.breadth
        return cls(hand.palm_px, spread_px, breadth, narrowed, growth, min(LARGEST_PALM, before.shown * GROWING_AGAIN))

    def is_near(self, height_px: int) -> bool:
        """Whether it is, or is about to be, so large that it is shown smaller."""
        return self.palm_px * self.growth > LARGEST_PALM * height_px

    def fitted(self, view: View, height_px: int) -> View:
        """The view, made smaller where the hand would be too large in the next frame."""
        scale = self.shown * height_px / (self.palm_px * self.growth)
        return replace(view, scale=scale) if scale < STEADY_FROM * view.scale else view


def difference(hand: Hand, other: Hand) -> float:
    """How far two readings of one hand lie apart: RMS of the 21 keypoints in the image, in palm lengths of `other`."""
    apart_px = np.linalg.norm(hand.image_px - other.image_px, axis=1)
    return float(np.sqrt(np.mean(apart_px**2))) / other.palm_px


@dataclass(frozen=True, slots=True, kw_only=True)
class Look:
    """An untracked detection under way, of the hand as the tracker had it in the same frame."""

    view: View
    tracked: Hand
    sought: Shows
    detection: Detection

    def shows_another_shape(self) -> bool:
        """Whether the hand shows what is sought there, in a shape that the tracker did not have."""
        return any(difference(one, self.tracked) > SLIPPED and self.sought(one) for one in self.detection())


class Redetector:
    """Gives each frame to a tracker: a near hand smaller, and other views when it has lost the hand."""

    def __init__(
        self,
        track: Callable[[Image, int], tuple[Hand, ...]],
        order: Callable[[tuple[Hand, ...]], tuple[Hand, ...]] = lambda hands: hands,
        begin_look: Callable[[Image], Detection] = lambda _: lambda: (),
        forget: Callable[[int], None] = lambda _: None,
    ) -> None:
        """order: puts the hand that is to be kept in view in front of the others.

        begin_look: begins a detection as if no hand were tracked. forget: makes the tracker detect anew in the next
        frame; it is given the time of this one.
        """
        self._track = track
        self._order = order
        self._begin_look = begin_look
        self._forget = forget
        self.sought: Shows | None = None  # what the hand followed shows no more, or has not shown for long
        self._search = RedetectionState()
        self._growth: PalmGrowth | None = None  # of the hand followed, or lost a moment ago
        self._since_look = LOOK_FRAMES
        self._look: Look | None = None  # under way
        self._look_failed = False  # the last look, in the light that is tracked in

    def detect(self, image_bgr: Image, captured_ns: int) -> tuple[Hand, ...]:
        """The hands in the next frame, where its image has them; () when there is none."""
        followed = self._growth is not None and self._search.missing == 0
        hands = self._detect_in_view(image_bgr, captured_ns)
        if not hands and self._growth is not None:
            hands = self._redetect(image_bgr, captured_ns, followed)
        self._search = next_state(self._search, found=bool(hands))
        if hands:
            return self._checked(image_bgr, captured_ns, hands)
        self._look = None
        if self._search.missing >= NEAR_FRAMES:
            self._growth = None
        return hands

    def _checked(self, image_bgr: Image, captured_ns: int, hands: tuple[Hand, ...]) -> tuple[Hand, ...]:
        """The hands, after a look at the first where its keypoints are doubted.

        Near, a gesture is kept for half a second, and the frames that forgetting costs are those of a push.
        """
        growth = PalmGrowth.of(hands[0], self._growth)
        near = growth.is_near(image_bgr.shape[0])
        self._since_look += 1
        if self._look is not None and (near or self._since_look == LOOK_LAG_FRAMES):
            if not near and self._look.shows_another_shape():
                self._look_failed = False
                self._search = replace(self._search, view=self._look.view)
                self._forget(captured_ns)
            self._look = None
        if self._since_look >= LOOK_FRAMES and near and growth.narrowed:
            hands = self._broad_again(image_bgr, hands)
            growth = PalmGrowth.of(hands[0], self._growth)
            self._since_look = 0
        elif self._since_look >= LOOK_FRAMES and not near and self.sought is not None:
            self._look = self._begun_look(image_bgr, hands[0], growth, self.sought)
            self._since_look = 0
        self._growth = growth
        return hands

    def _redetect(self, image_bgr: Image, captured_ns: int, followed: bool) -> tuple[Hand, ...]:
        """Everywhere; and in the next view."""
        assert self._growth is not None
        self._growth = replace(self._growth, growth=1.0, shown=SOUGHT_PALM)
        hands = self._detect_in_view(image_bgr, captured_ns) if followed else ()
        if not hands:
            view = near_view(self._search.missing, self._search.view.scale)
            self._search = replace(self._search, view=view)
            hands = self._detect_in_view(image_bgr, captured_ns)
        return hands

    def _broad_again(self, image_bgr: Image, hands: tuple[Hand, ...]) -> tuple[Hand, ...]:
        """The hands, the first as an untracked detection has it, if its palm has not narrowed there."""
        assert self._growth is not None
        growth = replace(self._growth, growth=1.0, shown=SOUGHT_PALM)
        found = self._untracked(image_bgr, growth.fitted(self._search.view, image_bgr.shape[0]), hands[0])()
        return tuple(one for one in found if not PalmGrowth.of(one, self._growth).narrowed) or hands

    def _begun_look(self, image_bgr: Image, hand: Hand, growth: PalmGrowth, sought: Shows) -> Look:
        """An untracked detection of the hand, which may show what is sought in another shape.

        A tracker that follows a shape that is not the hand's keeps to it: it places the next crop by its own keypoints.
        MediaPipe takes some fists for open hands in one light and not in the other, so after a look in vain the next
        one is in the other light; where that has shown it, the hand is tracked in it from then on.
        """
        failed = self._look_failed and self._since_look <= RETRY_FRAMES
        self._look_failed = not failed  # until it has shown it
        view = in_other_light(self._search.view) if failed else self._search.view
        detection = self._untracked(image_bgr, growth.fitted(view, image_bgr.shape[0]), hand)
        return Look(view=view, tracked=hand, sought=sought, detection=detection)

    def _untracked(self, image_bgr: Image, view: View, hand: Hand) -> Detection:
        """Begin to detect the same hand in this view as if none were tracked; () where it is not found."""
        shown, transform = render_view(image_bgr, view)
        detection = self._begin_look(shown)

        def found() -> tuple[Hand, ...]:
            return tuple(one for one in (to_image(each, transform) for each in detection()) if same_place(one, hand))[
                :1
            ]

        return found

    def _detect_in_view(self, image_bgr: Image, captured_ns: int) -> tuple[Hand, ...]:
        view = self._search.view
        if self._growth is not None:
            view = self._growth.fitted(view, image_bgr.shape[0])
            if view == FULL_VIEW and self._growth.palm_px >= SHRUNK_PALM_PX:
                return self._order(self._shrunk(image_bgr, captured_ns))
        shown, transform = render_view(image_bgr, view)
        hands = self._track(shown, captured_ns)
        return self._order(hands if shown is image_bgr else tuple(to_image(hand, transform) for hand in hands))

    def _shrunk(self, image_bgr: Image, captured_ns: int) -> tuple[Hand, ...]:
        """The hands of the image as it is, in half its pixels each way."""
        height, width = image_bgr.shape[:2]
        size = (width // SHRUNK, height // SHRUNK)
        shown = np.asarray(cv2.resize(image_bgr, size, interpolation=cv2.INTER_AREA), np.uint8)
        larger = np.array([width, height]) / size
        return tuple(replace(hand, image_px=larger * hand.image_px) for hand in self._track(shown, captured_ns))
