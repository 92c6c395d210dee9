"""Which hand commands: the enrolled one, and none while two claim it; every other is refused with its reason."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from kgdfa.gesture import Explanation, HandRefusal
from kgdfa.hand import Hand
from kgdfa.track import (
    SIDE_KNOWN,
    Detection,
    Enrolment,
    Track,
    When,
    begin_track,
    continue_tracks,
    restart_overlapping,
    without_doubles,
)

EQUAL_CLAIM = 0.75  # a second hand this large, relative to the first, claims the command as well
HINT_NS = 500_000_000  # how long the screen says that a hand is judged anew
LEAST_ENTRY_FRAMES = 3  # as many as a gesture's vote needs
ARM_LIMIT_RAD = math.radians(65)
# A hand that shows a gesture and has not moved at all in so long a time is a picture of one.
STILL_NS, STILL_REFERENCES = 2_000_000_000, 0.08
UNCLEAR_FRAMES = 15  # with a gesture, and the side is still unclear: it is told


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
    shown = (Detection(hand, signs) for hand, signs in zip(hands, signing or (True,) * len(hands), strict=True))
    when = When(captured_ns, captured_ns - tracks.captured_ns)
    followed, others = continue_tracks(tracks.followed, without_doubles(list(shown)), when, enrolment)
    made, number = tracks.made, tracks.number
    for detected in others:
        made += 1
        followed.append(begin_track(detected, made, captured_ns, enrolment))
    if enrolment is not None:
        followed = [restart_overlapping(track, followed, captured_ns) for track in followed]
        for place, track in enumerate(followed):
            if track.anew is not None and track.anew_ns == captured_ns:  # no vote is carried across
                made += 1
                number = made if track.number == number else number
                followed[place] = replace(track, number=made)
    now = Tracks(followed=tuple(followed), number=number, made=made, captured_ns=captured_ns)
    return _decided(now, enrolment)


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
