"""Which hand commands: every hand in view is followed, and refused with a reason unless it is the enrolled one.

A hand's side is voted over its frames that show a gesture, with hysteresis; where its arm came from is what its first
frames showed. Both end with the track, and begin anew where one hand can't have moved so (`kgdfa/continuity.py`) or two
overlap: there the detector may follow from the one hand to the other. The size of a hand tells nobody from another: one
camera sees size over distance, and MediaPipe's world landmarks give every palm about the same size (docs/decisions.md).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from kgdfa.button import GAP_FRAMES
from kgdfa.continuity import DOUBTFUL_FRAMES, FRAME_NS, MOST_FRAMES, Jump, jump_between
from kgdfa.gesture import Explanation, HandRefusal
from kgdfa.hand import FloatArray, Hand, Keypoint, Side

LOST_FRAMES = 5  # a hand gone this long is gone; fewer may be blur or the image's edge
REACH_REFERENCES = 1.5  # how far a hand may be from where it was a frame ago, in reference segments: 3 m/s at 30 Hz
REACH_GROWTH_REFERENCES = 0.5  # and how much farther for each frame without it
# From frame to frame at 30 Hz, and in each further 30th of a second since a hand was found: more is another hand in its
# place. Of the arm's direction, and of the palm's size, which a push of 0.3 s makes 1.3 times as large.
LARGEST_ARM_TURN_RAD, FURTHER_ARM_TURN_RAD = math.radians(60), math.radians(15)
LARGEST_GROWTH, FURTHER_GROWTH = 1.6, 1.35
EQUAL_CLAIM = 0.75  # a second hand this large, relative to the first, claims the command as well
# Log-odds of the side, as the detector's scores give them: what one frame may add, from where the side counts as known
# (two sure frames), and what all frames together may reach. A hand that is followed can't change its side, but the
# detector may err for a moment, so frames against a known side count half. As many sure ones in a row as make a vote
# let the hand be judged anew: the tracker may have slipped onto another. What would let a refused hand command counts
# only from a higher score: a left 5 that came near the camera was read as a right one at 0.85, frame after frame.
SIDE_STEP, SIDE_KNOWN, SIDE_MOST, SIDE_AGAINST = 2.0, 4.0, 12.0, 0.5
CONTRARY_FRAMES, SURE, SURE_ENROLLED = 3, 0.8, 0.95
OVERLAP_REFERENCES = REACH_REFERENCES  # two palms this near touch, and may be taken for one another in the next frame
SAME_POINTS_REFERENCES = 0.5  # two detections whose keypoints are this near on average are one hand, found twice
HINT_NS = 500_000_000  # how long the screen says that a hand is judged anew
ENTRY_FRAMES = 10  # of a track show where its arm comes from
LEAST_ENTRY_FRAMES = 3  # as many as a gesture's vote needs
ARM_LIMIT_RAD = math.radians(65)
SHORT_ARM = 0.5  # reference segments from wrist to knuckles: a hand that points at the camera shows no arm
# A hand that shows a gesture and has not moved at all in so long a time is a picture of one.
STILL_NS, STILL_REFERENCES = 2_000_000_000, 0.08
UNCLEAR_FRAMES = 15  # with a gesture, and the side is still unclear: it is told


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
    anew: why, and anew_ns: when it was last judged anew.
    """

    hand: Hand | None = None
    last: Hand
    lost: int = 0
    in_row: int = 0
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
    trusted: Hand
    doubtful: int = 0
    anew: Explanation | None = None
    anew_ns: int = 0

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
    captured_ns: int = 0

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
    signing: Sequence[bool] = (),
) -> Tracks:
    """The tracks after one frame. A hand that commands keeps the command until it is lost or refused.

    enrolment: None refuses nobody; the largest hand is taken, unless another claims as well. signing: which hands
    show a gesture, () for all; only then their side counts: at rest it may be either.
    """
    hands = _without_doubles(hands)
    shows = {id(hand): signs for hand, signs in zip(hands, signing, strict=False)}
    enrolled = enrolment.side if enrolment is not None else None
    followed, others = _continued(tracks, hands, captured_ns, shows, enrolled)
    made, number = tracks.made, tracks.number
    for hand in others:
        made += 1
        followed.append(_advanced(_begun(hand, made, captured_ns), hand, captured_ns, 0, shows, enrolled=enrolled))
    if enrolment is not None:
        followed = [_overlapping(track, followed, captured_ns) for track in followed]
        for place, track in enumerate(followed):
            if track.anew is not None and track.anew_ns == captured_ns:  # no vote is carried across
                made += 1
                number = made if track.number == number else number
                followed[place] = replace(track, number=made)
    now = Tracks(followed=tuple(followed), number=number, made=made, captured_ns=captured_ns)
    return _decided(now, enrolment)


def _continued(
    tracks: Tracks, hands: tuple[Hand, ...], captured_ns: int, shows: dict[int, bool], enrolled: Side | None
) -> tuple[list[Track], list[Hand]]:
    """Every track with its hand, the nearest pairs first; and the hands that belong to none.

    A track of one frame comes last: it may be a slip of the tracker, which the hand's own track refused.
    """
    followed, elapsed_ns = tracks.followed, captured_ns - tracks.captured_ns
    pairs = sorted(
        (track.began_ns == track.captured_ns, reach, place, number)
        for place, track in enumerate(followed)
        for number, hand in enumerate(hands)
        if (reach := _reach(hand, track.last)) <= REACH_REFERENCES + REACH_GROWTH_REFERENCES * track.lost
        and _same_hand(hand, track, captured_ns)
    )
    found: dict[int, int] = {}
    for _, _, place, number in pairs:
        if place not in found and number not in found.values():
            found[place] = number
    continued = [
        _advanced(track, hands[found[place]], captured_ns, elapsed_ns, shows, enrolled=enrolled)
        if place in found
        else replace(track, hand=None, lost=track.lost + 1)
        for place, track in enumerate(followed)
    ]
    others = [hand for number, hand in enumerate(hands) if number not in found.values()]
    return [track for track in continued if track.lost <= LOST_FRAMES], others


def _without_doubles(hands: tuple[Hand, ...]) -> tuple[Hand, ...]:
    """Without a second detection of one hand."""
    return tuple(
        hand
        for place, hand in enumerate(hands)
        if all(_apart(hand, one) > SAME_POINTS_REFERENCES for one in hands[:place])
    )


def _apart(hand: Hand, other: Hand) -> float:
    """Mean distance of their keypoints, reference segments."""
    return _mean_px(hand.image_px - other.image_px) / max(hand.reference_px, other.reference_px, 1.0)


def _mean_px(shifts_px: FloatArray) -> float:
    return float(np.add.reduce(np.sqrt(np.vecdot(shifts_px, shifts_px)))) / len(shifts_px)


def _begun(hand: Hand, number: int, captured_ns: int) -> Track:
    return Track(
        last=hand,
        number=number,
        first_px=hand.image_px,
        began_ns=captured_ns,
        captured_ns=captured_ns,
        trusted=hand,
    )


def _advanced(
    track: Track, hand: Hand, captured_ns: int, elapsed_ns: int, shows: dict[int, bool], *, enrolled: Side | None
) -> Track:
    """The track with its hand of one more frame; judged anew where that hand can't have come of those before.

    A hand that may not have come of those before counts for two frames, then as none for as long as a press survives
    without one: what slipped back by then is the hand of before, and nothing was pressed or released meanwhile.
    """
    signs = shows.get(id(hand), True)
    unsure = track.side not in {None, hand.side} and hand.side is enrolled and hand.presence < SURE_ENROLLED
    tells = signs and not unsure
    followed = replace(
        track,
        hand=hand,
        last=hand,
        lost=0,
        in_row=1 if track.hand is None else track.in_row + 1,
        signing=track.signing + signs,
        captured_ns=captured_ns,
        moved=max(track.moved, _mean_px(hand.image_px - track.first_px) / max(hand.reference_px, 1.0)),
    )
    jump = jump_between(track.trusted, hand, elapsed_ns, track.lost)
    if jump is not None and jump.code is not Jump.UNSEEN:
        if track.doubtful < DOUBTFUL_FRAMES:
            return replace(followed, doubtful=track.doubtful + 1)
        if track.lost < GAP_FRAMES:
            return replace(followed, hand=None, lost=track.lost + 1, doubtful=track.doubtful + 1)
    contrary = _contrary(track, hand) if tells else track.contrary
    if jump is None and contrary >= CONTRARY_FRAMES:
        jump = Explanation(Jump.SIDE, {"value": contrary, "limit": CONTRARY_FRAMES})
    followed = replace(followed, doubtful=0, trusted=hand, contrary=0 if jump is not None else contrary)
    if jump is not None:
        return _anew(followed, Explanation(HandRefusal.JUMPED, {"jump": jump.code, **jump.values}), captured_ns)
    arm = _arm(hand) if track.arm_frames < ENTRY_FRAMES else None
    return replace(
        followed,
        side_log_odds=_side_log_odds(track, hand) if tells else track.side_log_odds,
        arm=track.arm + (arm or 0),
        arm_frames=track.arm_frames + (arm is not None),
    )


def _contrary(track: Track, hand: Hand) -> int:
    """Frames in a row that are sure of the other side; unsure ones change nothing."""
    if track.side is None or hand.presence < SURE:
        return track.contrary
    return track.contrary + 1 if hand.side is not track.side else 0


def _anew(track: Track, why: Explanation, captured_ns: int) -> Track:
    return replace(track, side_log_odds=0.0, arm=0j, arm_frames=0, anew=why, anew_ns=captured_ns)


def _overlapping(track: Track, followed: list[Track], captured_ns: int) -> Track:
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
    """This hand commands: once it is known to be the enrolled one, and while it may be the same one."""
    known = _is_known(track, enrolment)
    refusal = None
    if not known and tracks.captured_ns - track.anew_ns <= HINT_NS:
        refusal = track.anew
    elif not known and track.side is None and track.signing >= UNCLEAR_FRAMES:
        values = {"log_odds": track.side_log_odds, "limit": SIDE_KNOWN}
        refusal = Explanation(HandRefusal.SIDE_UNCLEAR, values)
    known = known and (enrolment is None or not track.doubtful)
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
