"""Which hand commands: every hand in view is followed, and refused with a reason unless it is the enrolled one.

A hand's side is voted over its frames that show a gesture, with hysteresis; where its arm came from is what its first
frames showed. Both end with the track. The size of a hand tells nobody from another: one camera sees size over
distance, and MediaPipe's world landmarks give every palm about the same size (docs/decisions.md).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from kgdfa.gesture import Explanation
from kgdfa.hand import FloatArray, Hand, Keypoint, Side

LOST_FRAMES = 5  # a hand gone this long is gone; fewer may be blur or the image's edge
REACH_REFERENCES = 1.5  # how far a hand may be from where it was a frame ago, in reference segments: 3 m/s at 30 Hz
REACH_GROWTH_REFERENCES = 0.5  # and how much farther for each frame without it
# From frame to frame at 30 Hz, and in each further 30th of a second since a hand was found: more is another hand in its
# place. Of the arm's direction, and of the palm's size, which a push of 0.3 s makes 1.3 times as large.
FRAME_NS, MOST_FRAMES = 33_333_333, 6
LARGEST_TURN_RAD, FURTHER_TURN_RAD = math.radians(60), math.radians(15)
LARGEST_GROWTH, FURTHER_GROWTH = 1.6, 1.35
EQUAL_CLAIM = 0.75  # a second hand this large, relative to the first, claims the command as well
# Log-odds of the side, as the detector's scores give them: what one frame may add, from where the side counts as known
# (two sure frames), and what all frames together may reach. A hand that is followed can't change its side, but the
# detector may err for a moment, so frames against a known side count half. A run of sure ones means that the tracker
# has slipped onto another hand: the side is voted anew.
SIDE_STEP, SIDE_KNOWN, SIDE_MOST, SIDE_AGAINST = 2.0, 4.0, 60.0, 0.5
SLIPPED_FRAMES, SURE = 8, 0.8
AMBIGUOUS = 0.5  # `signing` of a gesture whose side the detector may miss all along: the rendered 3
KEPT_NS = 1_000_000_000  # a hand that comes back so soon, to where it was lost, is still known
ENTRY_FRAMES = 10  # of a track show where its arm comes from
LEAST_ENTRY_FRAMES = 3  # as many as a gesture's vote needs
ARM_LIMIT_RAD = math.radians(75)
SHORT_ARM = 0.5  # reference segments from wrist to knuckles: a hand that points at the camera shows no arm
# A hand that shows a gesture and has not moved at all in so long a time is a picture of one.
STILL_NS, STILL_REFERENCES = 2_000_000_000, 0.08
UNCLEAR_FRAMES = 15  # with a gesture, and the side is still unclear: it is told


class HandRefusal(Enum):
    """Why a hand in view does not command."""

    OTHER_SIDE = "other side"  # side, enrolled, log_odds, limit
    OTHER_ARM = "other arm"  # angle_rad, limit_rad
    SIDE_UNCLEAR = "side unclear"  # log_odds, limit
    STILL = "still"  # moved: reference segments, limit, duration_s
    TWO_HANDS = "two hands"  # share: of the larger one's size, limit


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
    """

    hand: Hand | None = None
    last: Hand
    lost: int = 0
    number: int
    side_log_odds: float = 0.0
    signing: int = 0  # frames that showed a gesture
    contrary: int = 0  # in a row, of the other side for sure
    arm: complex = 0j
    arm_frames: int = 0
    first_px: FloatArray
    began_ns: int
    captured_ns: int
    moved: float = 0.0

    @property
    def side(self) -> Side | None:
        """None until it is known."""
        if abs(self.side_log_odds) < SIDE_KNOWN:
            return None
        return Side.RIGHT if self.side_log_odds > 0 else Side.LEFT


@dataclass(frozen=True, slots=True, kw_only=True)
class Tracks:
    """Every hand in view, and which of them commands. refusal: why none does, where hands are in view."""

    followed: tuple[Track, ...] = ()
    number: int = 0  # of the commanding one; another number is another hand; 0: none
    made: int = 0
    refusal: Explanation | None = None
    known: bool = False  # the commanding one is the enrolled one for certain
    gone: Track | None = None  # the last that was lost while it commanded

    @property
    def commanding(self) -> Track | None:
        """The hand that commands; it may be lost for some frames."""
        return next((track for track in self.followed if track.number == self.number), None)


def arm_rad(hand: Hand) -> float | None:
    """Where the forearm comes from: 0 from below, +π/2 from the image's left, π from above. None: it can't be seen."""
    arm = _arm(hand)
    return None if arm is None else math.atan2(arm.imag, arm.real)


def _arm(hand: Hand) -> complex | None:
    (u, v), (a, b) = hand.image_px[Keypoint.MIDDLE_MCP].tolist(), hand.image_px[Keypoint.WRIST].tolist()
    x, y = u - a, v - b
    length = math.hypot(x, y)
    return complex(-y, x) / length if length >= SHORT_ARM * max(hand.reference_px, 1.0) else None


def update_tracks(
    tracks: Tracks,
    hands: tuple[Hand, ...],
    captured_ns: int,
    enrolment: Enrolment | None = None,
    signing: Sequence[float] = (),
) -> Tracks:
    """The tracks after one frame. A hand that commands keeps the command until it is lost or refused.

    enrolment: None refuses nobody; the largest hand is taken, unless another claims as well. signing: which hands
    show a gesture (1; 0: none; AMBIGUOUS), () for all; only then their side counts: at rest it may be either.
    """
    before = tracks.commanding
    weights = {id(hand): signs for hand, signs in zip(hands, signing, strict=False)}
    followed, others = _continued(tracks.followed, hands, captured_ns, weights)
    gone = before if before and all(track.number != before.number for track in followed) else tracks.gone
    made = tracks.made
    for hand in others:
        made += 1
        followed.append(_advanced(_begun(hand, made, captured_ns, gone), hand, captured_ns, weights))
    return _decided(Tracks(followed=tuple(followed), number=tracks.number, made=made, gone=gone), enrolment)


def _continued(
    followed: tuple[Track, ...], hands: tuple[Hand, ...], captured_ns: int, weights: dict[int, float]
) -> tuple[list[Track], list[Hand]]:
    """Every track with its hand, the nearest pairs first; and the hands that belong to none."""
    pairs = sorted(
        (reach, place, number)
        for place, track in enumerate(followed)
        for number, hand in enumerate(hands)
        if (reach := _reach(hand, track.last)) <= REACH_REFERENCES + REACH_GROWTH_REFERENCES * track.lost
        and _same_hand(hand, track, captured_ns)
    )
    found: dict[int, int] = {}
    for _, place, number in pairs:
        if place not in found and number not in found.values():
            found[place] = number
    continued = [
        _advanced(track, hands[found[place]], captured_ns, weights)
        if place in found
        else replace(track, hand=None, lost=track.lost + 1)
        for place, track in enumerate(followed)
    ]
    others = [hand for number, hand in enumerate(hands) if number not in found.values()]
    return [track for track in continued if track.lost <= LOST_FRAMES], others


def _begun(hand: Hand, number: int, captured_ns: int, gone: Track | None) -> Track:
    begun = Track(last=hand, number=number, first_px=hand.image_px, began_ns=captured_ns, captured_ns=captured_ns)
    if gone is None or captured_ns - gone.captured_ns > KEPT_NS or not _same_hand(hand, gone, captured_ns):
        return begun
    near = _reach(hand, gone.last) <= REACH_REFERENCES + REACH_GROWTH_REFERENCES * LOST_FRAMES
    return replace(begun, side_log_odds=gone.side_log_odds, moved=gone.moved) if near else begun


def _advanced(track: Track, hand: Hand, captured_ns: int, weights: dict[int, float]) -> Track:
    arm = _arm(hand) if track.arm_frames < ENTRY_FRAMES else None
    signs, contrary = weights.get(id(hand), 1.0), track.contrary
    if signs == 1.0:
        against = track.side not in {None, hand.side} and hand.presence >= SURE
        contrary = contrary + 1 if against else 0
    slipped = contrary >= SLIPPED_FRAMES
    away = hand.image_px - track.first_px
    away_px = float(np.add.reduce(np.sqrt(np.vecdot(away, away)))) / len(away)
    return replace(
        track,
        hand=hand,
        last=hand,
        lost=0,
        side_log_odds=0.0 if slipped else _side_log_odds(track, hand) if signs else track.side_log_odds,
        signing=track.signing + bool(signs),
        contrary=0 if slipped else contrary,
        arm=track.arm + (arm or 0),
        arm_frames=track.arm_frames + (arm is not None),
        captured_ns=captured_ns,
        moved=max(track.moved, away_px / max(hand.reference_px, 1.0)),
    )


def _side_log_odds(track: Track, hand: Hand) -> float:
    score = min(max(hand.presence, 0.5), 1 - 1e-9)
    step = min(math.log(score / (1 - score)), SIDE_STEP) * (1 if track.side in (None, hand.side) else SIDE_AGAINST)
    after = track.side_log_odds + (step if hand.side is Side.RIGHT else -step)
    return max(-SIDE_MOST, min(SIDE_MOST, after))


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
    return turn_rad <= LARGEST_TURN_RAD + FURTHER_TURN_RAD * further


def _ratio(first_px: float, second_px: float) -> float:
    """Of the larger to the smaller."""
    return max(first_px, second_px) / max(min(first_px, second_px), 1.0)


def refusal_of(track: Track, enrolment: Enrolment) -> Explanation | None:
    """Why this hand does not command; None while nothing speaks against it."""
    side = track.side
    if enrolment.side is not None and side is not None and side is not enrolment.side:
        values = {"side": side, "enrolled": enrolment.side, "log_odds": track.side_log_odds, "limit": SIDE_KNOWN}
        return Explanation(HandRefusal.OTHER_SIDE, values)
    if enrolment.arm_rad is not None and track.arm_frames >= LEAST_ENTRY_FRAMES:
        angle_rad = math.remainder(math.atan2(track.arm.imag, track.arm.real) - enrolment.arm_rad, math.tau)
        if abs(angle_rad) > ARM_LIMIT_RAD:
            return Explanation(HandRefusal.OTHER_ARM, {"angle_rad": abs(angle_rad), "limit_rad": ARM_LIMIT_RAD})
    age_ns = track.captured_ns - track.began_ns
    if track.moved < STILL_REFERENCES and track.signing >= UNCLEAR_FRAMES and age_ns >= STILL_NS:
        values = {"moved": track.moved, "limit": STILL_REFERENCES, "duration_s": age_ns / 1e9}
        return Explanation(HandRefusal.STILL, values)
    return None


def _is_known(track: Track, enrolment: Enrolment | None) -> bool:
    """Whether enough frames have told its side and its arm."""
    if enrolment is None:
        return True
    side = enrolment.side is None or track.side is enrolment.side
    return side and (enrolment.arm_rad is None or track.arm_frames >= LEAST_ENTRY_FRAMES)


def _commanded(tracks: Tracks, track: Track, enrolment: Enrolment | None) -> Tracks:
    """This hand commands: once it is known to be the enrolled one."""
    known = _is_known(track, enrolment)
    unclear = not known and track.side is None and track.signing >= UNCLEAR_FRAMES
    values = {"log_odds": track.side_log_odds, "limit": SIDE_KNOWN}
    refusal = Explanation(HandRefusal.SIDE_UNCLEAR, values) if unclear else None
    return replace(tracks, number=track.number, known=known, refusal=refusal)


def _decided(tracks: Tracks, enrolment: Enrolment | None) -> Tracks:
    """The tracks with the one that commands."""
    refused = {
        track.number: refusal
        for track in tracks.followed
        if enrolment is not None and (refusal := refusal_of(track, enrolment)) is not None
    }
    now = tracks.commanding
    if now is not None and now.number not in refused and _is_known(now, enrolment):
        return _commanded(tracks, now, enrolment)
    free = [track for track in tracks.followed if track.hand is not None and track.number not in refused]
    known = [track for track in free if _is_known(track, enrolment)]
    if now is not None and now.number not in refused and not known:
        return _commanded(tracks, now, enrolment)
    by_size = sorted(known or free, key=lambda track: track.last.reference_px, reverse=True)
    if len(by_size) > 1:
        share = by_size[1].last.reference_px / by_size[0].last.reference_px
        if share >= EQUAL_CLAIM:
            values = {"share": share, "limit": EQUAL_CLAIM}
            return replace(tracks, number=0, refusal=Explanation(HandRefusal.TWO_HANDS, values))
    if by_size:
        return _commanded(tracks, by_size[0], enrolment)
    visible = [track for track in tracks.followed if track.number in refused]
    largest = max(visible, key=lambda track: track.last.reference_px, default=None)
    return replace(tracks, number=0, refusal=refused[largest.number] if largest is not None else None)
