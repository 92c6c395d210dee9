"""Every hand in view is followed by itself: what it has shown so far. Which one commands: `kgdfa/commanding.py`.

A hand's side is voted over its frames that show a gesture, with hysteresis; where its arm came from is what its first
frames showed. Both end with the track, and begin anew where one hand can't have moved so (`kgdfa/continuity.py`) or two
overlap: there the detector may follow from the one hand to the other. The size of a hand tells nobody from another: one
camera sees size over distance, and MediaPipe's world landmarks give every palm about the same size (docs/decisions.md).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from kgdfa.button_state import GAP_FRAMES
from kgdfa.continuity import DOUBTFUL_FRAMES, MOST_FRAMES, Jump, jump_between
from kgdfa.frame_time import FRAME_NS, have_lasted, row_has_lasted
from kgdfa.gesture import Explanation, HandRefusal
from kgdfa.hand import FloatArray, Hand, Keypoint, Side

LOST_FRAMES = 5  # a hand gone this long is gone; fewer may be blur or the image's edge
REACH_REFERENCES = 1.5  # how far a hand may be from where it was a frame ago, in reference segments: 3 m/s at 30 Hz
REACH_GROWTH_REFERENCES = 0.5  # and how much farther for each frame without it
# From frame to frame at 30 Hz, and in each further 30th of a second since a hand was found: more is another hand in its
# place. Of the arm's direction, and of the palm's size, which a push of 0.3 s makes 1.3 times as large.
LARGEST_ARM_TURN_RAD, FURTHER_ARM_TURN_RAD = math.radians(60), math.radians(15)
LARGEST_GROWTH, FURTHER_GROWTH = 1.6, 1.35
# Log-odds of the side, as the detector's scores give them: what one frame may add, from where the side counts as known
# (two sure frames), and what all frames together may reach. A hand that is followed can't change its side, but the
# detector may err for a moment, so frames against a known side count half. As many sure ones in a row as make a vote
# let the hand be judged anew: the tracker may have slipped onto another. What would let a refused hand command counts
# only from a higher score: a left 5 that came near the camera was read as a right one at 0.85, frame after frame.
SIDE_STEP, SIDE_KNOWN, SIDE_MOST, SIDE_AGAINST = 2.0, 4.0, 12.0, 0.5
CONTRARY_FRAMES, SURE, SURE_ENROLLED = 3, 0.8, 0.95
OVERLAP_REFERENCES = REACH_REFERENCES  # two palms this near touch, and may be taken for one another in the next frame
SAME_POINTS_REFERENCES = 0.5  # two detections whose keypoints are this near on average are one hand, found twice
ENTRY_FRAMES = 10  # of a track show where its arm comes from
SHORT_ARM = 0.5  # reference segments from wrist to knuckles: a hand that points at the camera shows no arm


@dataclass(frozen=True, slots=True, kw_only=True)
class Enrolment:
    """Whose hand commands. side: None, either. arm_rad: where the arm comes from, see `arm_rad`; None: anywhere."""

    side: Side | None = None
    arm_rad: float | None = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Track:
    """One hand followed. `number` grows with every new one; `lost` counts frames without it.

    side_log_odds: positive for right. arm: sum of the arm's directions in the first frames, unit vectors as complex
    numbers. moved: farthest mean displacement of its keypoints from the first frame, reference segments.
    in_row: frames in a row with it, up to the newest.
    trusted: the newest one that may have come of those before; doubtful: frames in a row since that may not.
    trusted_ns, counted_ns: captures of that one, and of the newest frame in which the hand counted as not lost.
    anew: why, and anew_ns: when it was last judged anew.
    """

    hand: Hand | None = None
    last: Hand
    lost: int = 0
    in_row: int = 0
    number: int
    side_log_odds: float = 0.0
    signing: int = 0  # frames that showed a gesture
    contrary_ns: tuple[int, ...] = ()  # captures of frames in a row of the other side for sure
    arm: complex = 0j
    arm_frames: int = 0
    first_px: FloatArray
    began_ns: int
    captured_ns: int
    moved: float = 0.0
    trusted: Hand
    trusted_ns: int
    counted_ns: int
    doubtful: int = 0
    anew: Explanation | None = None
    anew_ns: int = 0

    @property
    def side(self) -> Side | None:
        """None until it is known."""
        if abs(self.side_log_odds) < SIDE_KNOWN:
            return None
        return Side.RIGHT if self.side_log_odds > 0 else Side.LEFT


def arm_rad(hand: Hand) -> float | None:
    """Where the forearm comes from: 0 from below, +π/2 from the image's left, π from above. None: it can't be seen."""
    arm = _arm(hand)
    return None if arm is None else math.atan2(arm.imag, arm.real)


def _arm(hand: Hand) -> complex | None:
    (u, v), (a, b) = hand.image_px[Keypoint.MIDDLE_MCP].tolist(), hand.image_px[Keypoint.WRIST].tolist()
    x, y = u - a, v - b
    length = math.hypot(x, y)
    return complex(-y, x) / length if length >= SHORT_ARM * max(hand.reference_px, 1.0) else None


class Detection(NamedTuple):
    """A hand in one frame. signs: it shows a gesture; only then its side counts, at rest it may be either."""

    hand: Hand
    signs: bool


class When(NamedTuple):
    """Of a frame: its capture, and how long after the one before."""

    captured_ns: int
    elapsed_ns: int


def begin_track(detected: Detection, number: int, captured_ns: int, enrolment: Enrolment | None) -> Track:
    """A hand that none of the tracks has been."""
    track = Track(
        last=detected.hand,
        number=number,
        first_px=detected.hand.image_px,
        began_ns=captured_ns,
        captured_ns=captured_ns,
        trusted=detected.hand,
        trusted_ns=captured_ns,
        counted_ns=captured_ns,
    )
    return _advanced(track, detected, When(captured_ns, 0), enrolment)


def continue_tracks(
    followed: Sequence[Track], detections: Sequence[Detection], when: When, enrolment: Enrolment | None
) -> tuple[list[Track], list[Detection]]:
    """Every track with its hand, the nearest pairs first; and the hands that belong to none.

    A track of one frame comes last: it may be a slip of the tracker, which the hand's own track refused.
    """
    pairs = sorted(
        (track.began_ns == track.captured_ns, reach, place, number)
        for place, track in enumerate(followed)
        for number, (hand, _) in enumerate(detections)
        if (reach := _reach(hand, track.last)) <= _reach_limit(track) and _same_hand(hand, track, when.captured_ns)
    )
    found: dict[int, int] = {}
    for _, _, place, number in pairs:
        if place not in found and number not in found.values():
            found[place] = number
    continued = [
        _advanced(track, detections[found[place]], when, enrolment)
        if place in found
        else replace(track, hand=None, lost=track.lost + 1)
        for place, track in enumerate(followed)
    ]
    others = [detected for number, detected in enumerate(detections) if number not in found.values()]
    return [track for track in continued if not _outlasts(track, track.lost, LOST_FRAMES, when.captured_ns)], others


def without_doubles(detections: Sequence[Detection]) -> list[Detection]:
    """Without a second detection of one hand."""
    return [
        detected
        for place, detected in enumerate(detections)
        if all(_apart(detected.hand, one.hand) > SAME_POINTS_REFERENCES for one in detections[:place])
    ]


def _apart(hand: Hand, other: Hand) -> float:
    """Mean distance of their keypoints, reference segments."""
    return _mean_px(hand.image_px - other.image_px) / max(hand.reference_px, other.reference_px, 1.0)


def _mean_px(shifts_px: FloatArray) -> float:
    return float(np.add.reduce(np.sqrt(np.vecdot(shifts_px, shifts_px)))) / len(shifts_px)


def _advanced(track: Track, detected: Detection, when: When, enrolment: Enrolment | None) -> Track:
    """The track with its hand of one more frame; judged anew where that hand can't have come of those before.

    A hand that may not have come of those before counts for two frames, then as none for as long as a press survives
    without one: what slipped back by then is the hand of before, and nothing was pressed or released meanwhile.
    """
    hand, signs = detected
    enrolled = enrolment.side if enrolment is not None else None
    unsure = track.side not in {None, hand.side} and hand.side is enrolled and hand.presence < SURE_ENROLLED
    tells = signs and not unsure
    followed = replace(
        track,
        hand=hand,
        last=hand,
        lost=0,
        in_row=1 if track.hand is None else track.in_row + 1,
        signing=track.signing + signs,
        captured_ns=when.captured_ns,
        moved=max(track.moved, _mean_px(hand.image_px - track.first_px) / max(hand.reference_px, 1.0)),
    )
    lost = _outlasts(track, track.lost, GAP_FRAMES, when.captured_ns - when.elapsed_ns)
    jump = jump_between(track.trusted, hand, when.elapsed_ns, lost=lost)
    if enrolment is not None and jump is not None and jump.code is not Jump.UNSEEN:
        if not have_lasted(track.doubtful + 1, DOUBTFUL_FRAMES + 1, when.captured_ns - track.trusted_ns):
            return replace(followed, doubtful=track.doubtful + 1, counted_ns=when.captured_ns)
        if not _outlasts(track, track.lost + 1, GAP_FRAMES, when.captured_ns):
            return replace(followed, hand=None, lost=track.lost + 1, doubtful=track.doubtful + 1)
    contrary_ns = _contrary(track, hand, when.captured_ns) if tells else track.contrary_ns
    if jump is None and row_has_lasted(contrary_ns, CONTRARY_FRAMES):
        jump = Explanation(Jump.SIDE, {"value": len(contrary_ns), "limit": CONTRARY_FRAMES})
    now_ns = when.captured_ns
    followed = replace(followed, doubtful=0, trusted=hand, trusted_ns=now_ns, counted_ns=now_ns, contrary_ns=())
    if jump is not None:
        return _anew(followed, Explanation(HandRefusal.JUMPED, {"jump": jump.code, **jump.values}), when.captured_ns)
    arm = _arm(hand) if track.arm_frames < ENTRY_FRAMES else None
    return replace(
        followed,
        contrary_ns=contrary_ns,
        side_log_odds=_side_log_odds(track, hand) if tells else track.side_log_odds,
        arm=track.arm + (arm or 0),
        arm_frames=track.arm_frames + (arm is not None),
    )


def _outlasts(track: Track, lost: int, frames: int, now_ns: int) -> bool:
    """Whether it was lost for more than so many frames, up to the one captured then."""
    return have_lasted(lost, frames + 1, now_ns - track.counted_ns)


def _contrary(track: Track, hand: Hand, captured_ns: int) -> tuple[int, ...]:
    """Frames in a row that are sure of the other side; unsure ones change nothing."""
    if track.side is None or hand.presence < SURE:
        return track.contrary_ns
    return (*track.contrary_ns, captured_ns) if hand.side is not track.side else ()


def _anew(track: Track, why: Explanation, captured_ns: int) -> Track:
    return replace(track, side_log_odds=0.0, arm=0j, arm_frames=0, anew=why, anew_ns=captured_ns)


def restart_overlapping(track: Track, followed: Sequence[Track], captured_ns: int) -> Track:
    """Judged anew in every frame in which another hand is within its reach.

    A hand of one frame is none: the detector sees a second one at times in the fingers of a hand that comes near.
    """
    hand = track.hand
    others = [one.hand for one in followed if one.hand is not None and one is not track and one.in_row > 1]
    apart = min((_palms_apart(hand, other) for other in others), default=math.inf) if hand is not None else math.inf
    if apart > OVERLAP_REFERENCES:
        return track
    values = {"apart": apart, "limit": OVERLAP_REFERENCES}
    return _anew(track, Explanation(HandRefusal.OVERLAP, values), captured_ns)


def _palms_apart(hand: Hand, other: Hand) -> float:
    """How far the two palms are apart on the image, in the mean of their reference segments."""
    return 2 * hand.palm_shift_px(other) / max(hand.reference_px + other.reference_px, 1.0)


def _side_log_odds(track: Track, hand: Hand) -> float:
    score = min(max(hand.presence, 0.5), 1 - 1e-9)
    step = min(math.log(score / (1 - score)), SIDE_STEP) * (1 if track.side in (None, hand.side) else SIDE_AGAINST)
    after = track.side_log_odds + (step if hand.side is Side.RIGHT else -step)
    return max(-SIDE_MOST, min(SIDE_MOST, after))


def _reach_limit(track: Track) -> float:
    return REACH_REFERENCES + REACH_GROWTH_REFERENCES * min(track.lost, LOST_FRAMES)


def _reach(hand: Hand, last: Hand) -> float:
    """How far the palm has moved, in units of the larger of the two reference segments."""
    return hand.palm_shift_px(last) / max(hand.reference_px, last.reference_px, 1.0)


def _same_hand(hand: Hand, track: Track, captured_ns: int) -> bool:
    """Whether its size and its arm's direction may be those of a moment ago: if not, the tracker has slipped."""
    further = min(max((captured_ns - track.captured_ns) / FRAME_NS - 1, 0.0), MOST_FRAMES)
    # Near the camera the wrist is out of the image and the palm's length a guess; 5-17 slips together now and then.
    grown = min(_ratio(hand.palm_px, track.last.palm_px), _ratio(hand.reference_px, track.last.reference_px))
    if grown > LARGEST_GROWTH * FURTHER_GROWTH**further:
        return False
    now, before = _arm(hand), _arm(track.last)
    if now is None or before is None:
        return True
    turn_rad = abs(math.atan2((now * before.conjugate()).imag, (now * before.conjugate()).real))
    return turn_rad <= LARGEST_ARM_TURN_RAD + FURTHER_ARM_TURN_RAD * further


def _ratio(first_px: float, second_px: float) -> float:
    """Of the larger to the smaller."""
    return max(first_px, second_px) / max(min(first_px, second_px), 1.0)
