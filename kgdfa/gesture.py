"""The twelve gestures by finger, the verdict on one hand, the vote over frames. Needs no arrays.

The one home of what each finger does (Tables 1 and 2). Derived from it: Table 2 as rules, the drawings of the console,
the labels of synthetic hands. The digital hand may not import this package; a test compares its poses.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum, IntEnum
from typing import TYPE_CHECKING, Protocol

from msgspec import Struct
from msgspec.structs import replace

from kgdfa.frame_time import FRAME_NS, row_has_lasted

if TYPE_CHECKING:
    from kgdfa.hand import Hand


class Gesture(Enum):
    """The paper's twelve gestures (Table 1). "None of them" is Python's None."""

    ZERO = "0"
    ONE = "1"
    TWO = "2"
    THREE = "3"
    FOUR = "4"
    FIVE = "5"
    SIX = "6"
    SEVEN = "7"
    EIGHT = "8"
    NINE = "9"
    LOVE = "love"
    ROCK = "rock"


GESTURE_NAMED = {gesture.value: gesture for gesture in Gesture}


class Finger(IntEnum):
    """In the order of every (5,) array of this package; the names are the paper's."""

    THUMB = 0
    FORE = 1
    MIDDLE = 2
    RING = 3
    PINKY = 4


class FingerState(Enum):
    """Of one finger, as Table 2 tells them apart."""

    FOLDED = "folded"
    OPEN = "open"
    HOOKED = "hooked"  # stretched at the knuckle, bent at the middle joint: gesture 9
    PINCHED = "pinched"  # tips together: gesture 7


_F, _O, _H, _P = FingerState
FINGER_STATES: dict[Gesture, tuple[FingerState, FingerState, FingerState, FingerState, FingerState]] = {
    Gesture.ZERO: (_F, _F, _F, _F, _F),
    Gesture.ONE: (_F, _O, _F, _F, _F),
    Gesture.TWO: (_F, _O, _O, _F, _F),
    Gesture.THREE: (_F, _O, _O, _O, _F),
    Gesture.FOUR: (_F, _O, _O, _O, _O),
    Gesture.FIVE: (_O, _O, _O, _O, _O),
    Gesture.SIX: (_O, _F, _F, _F, _O),
    Gesture.SEVEN: (_P, _P, _P, _F, _F),
    Gesture.EIGHT: (_O, _O, _F, _F, _F),
    Gesture.NINE: (_F, _H, _F, _F, _F),
    Gesture.LOVE: (_O, _O, _F, _F, _O),
    Gesture.ROCK: (_F, _O, _F, _F, _O),
}


def fingers_in(gesture: Gesture, *states: FingerState) -> tuple[Finger, ...]:
    """The fingers of a gesture that are in one of these states."""
    return tuple(finger for finger in Finger if FINGER_STATES[gesture][finger] in states)


class Decision(Enum):
    """How a rule set decided: the code of an explanation. `measure` is the explanation of a constraint."""

    OVER = "over"  # gesture, rival
    OVER_BY = "over by"  # gesture, rival, measure: what keeps it from being the rival
    CLOSEST = "closest"  # gesture, measure: every constraint holds, this one by the least
    NOT = "not"  # gesture, measure: what keeps it from being that gesture
    TOO_SIMILAR = "too similar"  # rival
    NO_GESTURE = "no gesture"  # a rival that is none of the twelve
    NO_HAND = "no hand"
    ENDED = "ended"  # no more frames: the session ended, or the camera was replaced


class HandRefusal(Enum):
    """Why a hand in view does not command."""

    OTHER_SIDE = "other side"  # side, enrolled, log_odds, limit
    OTHER_ARM = "other arm"  # angle_rad, limit_rad
    SIDE_UNCLEAR = "side unclear"  # log_odds, limit
    STILL = "still"  # moved: reference segments, limit, duration_s
    TWO_HANDS = "two hands"  # share: of the larger one's size, limit
    OVERLAP = "overlap"  # apart: reference segments between the palms, limit
    JUMPED = "jumped"  # jump: what can't be, value, limit
    ALTERNATING = "alternating"  # gesture, other: read in turn


@dataclass(frozen=True, slots=True)
class Explanation:
    """A code with its values, SI or as their names say. A value may be a code or an explanation again."""

    code: Enum
    values: Mapping[str, object] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """A gesture or none, with the constraint that decided it.

    confidence: in [0, 1]; of the named gesture, or of the best one where the verdict is none.
    explanation: which constraint decided, and what it measured.
    """

    gesture: Gesture | None
    confidence: float
    explanation: Explanation


class RuleSet(Protocol):
    """A named classifier of hands: `published` or `robust`."""

    name: str

    def classify(self, hand: Hand) -> Verdict:
        """The verdict on one hand, from its keypoints alone."""


# These are frames in a row that last as long as at 30 Hz (`kgdfa/frame_time.py`).
VOTE_FRAMES = 3  # paper, gait state machine: "across three consecutive frames"
# During a press the hand is so near that fingertips leave the image and fists blur: the gesture was voted before,
# so that only another one seen for a fifth of a second, or half a second of nothing, takes it away.
PRESS_CHANGE_FRAMES = 6
PRESS_END_FRAMES = 15
LONGEST_UNSEEN_NS = (PRESS_END_FRAMES - 1) * FRAME_NS  # from the first frame without it to the last: as long at 30 Hz
END_FRAMES = 5  # a held gesture ends at the fifth frame in a row that doesn't support it
# Two gestures read in turn are a hand whose keypoints slip to and fro: MediaPipe folded and stretched one digital
# hand's ring finger, and 6 of 12 pushes of its 3 commanded 2. Nobody goes to and fro three times in so short a time.
ALTERNATIONS = 3
ALTERNATING_NS = 2_000_000_000
CHANGE_FRAMES = 2  # in a row that show another gesture: one alone is a slip, and makes no vote
# A gesture that took another one's place must have been in force for so long before it presses: keypoints that slipped
# just before a push had a 3 command 2, and nobody changes a hand and pushes it within a fifth of a second. Nor does a
# pause that is as short tell a changed hand from a slip: while keypoints slip, frames show neither gesture.
SETTLING_NS = 200_000_000


class Vote(Struct, frozen=True, kw_only=True):
    """The vote after a frame. `gesture` is in force since the frame captured at `recognised_ns`."""

    gesture: Gesture | None = None
    recognised_ns: int = 0
    replaced: bool = False  # `gesture` took another one's place, which was in force less than SETTLING_NS before
    ended: Gesture | None = None  # the newest in force that ended without another in its place
    candidate: Gesture | None = None
    candidate_ns: tuple[int, ...] = ()  # captures of frames in a row for `candidate`: the newest that last
    unsupported_ns: tuple[int, ...] = ()  # captures of frames in a row that don't support `gesture`
    decided_ns: tuple[int, ...] = ()  # captures of the frames that made `gesture`, or ended it
    read: Gesture | None = None  # by the newest CHANGE_FRAMES in a row
    read_before: Gesture | None = None
    changes_ns: tuple[int, ...] = ()  # captures at which these two took turns, the newest ALTERNATIONS

    @property
    def count(self) -> int:
        """Frames in a row for `candidate`, capped where PRESS_CHANGE_FRAMES have lasted."""
        return len(self.candidate_ns)

    @property
    def votes(self) -> int:
        """For `candidate`, up to VOTE_FRAMES, which it has when so many have lasted."""
        return VOTE_FRAMES if row_has_lasted(self.candidate_ns, VOTE_FRAMES) else min(self.count, VOTE_FRAMES - 1)

    @property
    def contradicted(self) -> bool:
        """Whether the newest frames show another gesture than the one in force, too many for a slip."""
        return self.candidate is not self.gesture and row_has_lasted(self.candidate_ns, CHANGE_FRAMES)

    def alternates(self, captured_ns: int) -> bool:
        """Whether two gestures were read in turn until now."""
        changes_ns = self.changes_ns
        return len(changes_ns) == ALTERNATIONS and captured_ns - changes_ns[0] <= ALTERNATING_NS


def update_vote(
    vote: Vote,
    current: Gesture | None,
    captured_ns: int,
    *,
    pressing: bool = False,
    approaching: bool = False,
    refuse_alternating: bool = False,
    timed: bool = False,
) -> Vote:
    """The vote after one more frame with that verdict; None: none, or no hand.

    pressing: the virtual button is down, or about to be. approaching: the hand comes nearer; another gesture then
    counts as quickly as ever, but nothing recognised ends the one in force as late as in a press. refuse_alternating:
    of two gestures read in turn neither is in force; a press, or an approach, under way is judged by its own rules.
    timed: what is not shown for LONGEST_UNSEEN_NS ends, however few frames came meanwhile.
    """
    before_ns = vote.candidate_ns if current is vote.candidate else ()
    candidate_ns = (*before_ns, captured_ns) if current is not None else ()
    if row_has_lasted(candidate_ns[1:], PRESS_CHANGE_FRAMES):
        candidate_ns = candidate_ns[1:]
    counted = replace(vote, candidate=current, candidate_ns=candidate_ns)
    pushing = pressing or approaching
    if refuse_alternating and not pushing:
        counted = _with_change(counted, captured_ns)
    alternating = refuse_alternating and counted.alternates(captured_ns)
    if alternating and not pushing:
        return _end(counted, counted.changes_ns)
    needed = PRESS_CHANGE_FRAMES if pressing else VOTE_FRAMES
    if row_has_lasted(candidate_ns, needed) and current is not vote.gesture and not alternating:
        return replace(
            counted,
            gesture=current,
            recognised_ns=captured_ns,
            replaced=_replaces(vote, current, captured_ns),
            unsupported_ns=(),
            decided_ns=candidate_ns,
        )
    return _keep_or_end(counted, captured_ns, PRESS_END_FRAMES if pushing else END_FRAMES, timed=timed)


def _replaces(vote: Vote, gesture: Gesture | None, captured_ns: int) -> bool:
    """Whether a gesture that is in force from now on takes another one's place."""
    if vote.gesture is not None:
        return True
    return vote.ended not in (None, gesture) and captured_ns - vote.decided_ns[-1] < SETTLING_NS


def _keep_or_end(vote: Vote, captured_ns: int, end_frames: int, *, timed: bool) -> Vote:
    if vote.gesture is None or vote.candidate is vote.gesture:
        return replace(vote, unsupported_ns=())
    against_ns = (*vote.unsupported_ns, captured_ns)
    overdue = timed and captured_ns - against_ns[0] >= LONGEST_UNSEEN_NS
    if overdue or row_has_lasted(against_ns, end_frames):
        return _end(vote, against_ns)
    return replace(vote, unsupported_ns=against_ns)


def _end(vote: Vote, decided_ns: tuple[int, ...]) -> Vote:
    if vote.gesture is None:
        return vote
    return replace(
        vote,
        gesture=None,
        recognised_ns=0,
        replaced=False,
        ended=vote.gesture,
        unsupported_ns=(),
        decided_ns=decided_ns,
    )


def _with_change(vote: Vote, captured_ns: int) -> Vote:
    """The vote with another gesture read, where this frame makes it one."""
    last = row_has_lasted(vote.candidate_ns, CHANGE_FRAMES)
    known = row_has_lasted(vote.candidate_ns[:-1], CHANGE_FRAMES)
    if vote.candidate is None or not last or known or vote.candidate is vote.read:
        return vote
    again = vote.changes_ns if vote.candidate is vote.read_before else ()
    changes_ns = (*again, captured_ns)[-ALTERNATIONS:] if vote.read is not None else ()
    return replace(vote, read=vote.candidate, read_before=vote.read, changes_ns=changes_ns)
