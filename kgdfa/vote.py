"""The paper's vote, three frames in a row, and the hysteresis that keeps a held gesture from flickering.

A new gesture needs exactly the paper's three frames, held or not: hysteresis only delays the *end*. Frames
that say nothing (blur, two lost frames, a finger out of the picture) end a gesture after `END_FRAMES`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from kgdfa.hand import Gesture
from kgdfa.verdict import Verdict

VOTE_FRAMES = 3  # paper, gait state machine: "across three consecutive frames"
# During a press the hand is so near that fingertips leave the picture and fists blur: the gesture was voted before,
# so that only another one seen for a fifth of a second, or half a second of nothing, takes it away.
PRESS_CHANGE_FRAMES = 6
PRESS_END_FRAMES = 15
END_FRAMES = 5  # a held gesture ends at the fifth frame in a row that doesn't support it


@dataclass(frozen=True, slots=True, kw_only=True)
class Vote:
    """The vote after a frame. `gesture` is in force since the frame captured at `recognised_ns`."""

    gesture: Gesture | None = None
    recognised_ns: int = 0
    candidate: Gesture | None = None
    count: int = 0  # frames in a row for `candidate`, capped at PRESS_CHANGE_FRAMES
    unsupported: int = 0  # frames in a row that don't support `gesture`


def cast(vote: Vote, verdict: Verdict | None, captured_ns: int, *, pressing: bool = False) -> Vote:
    """The vote after one more frame; None: no hand seen. pressing: the virtual button is down."""
    said = verdict.gesture if verdict else None
    count = 0 if said is None else vote.count + 1 if said is vote.candidate else 1
    counted = replace(vote, candidate=said, count=min(count, PRESS_CHANGE_FRAMES))
    needed = PRESS_CHANGE_FRAMES if pressing else VOTE_FRAMES
    if said is not None and count >= needed and said is not vote.gesture:
        return replace(counted, gesture=said, recognised_ns=captured_ns, unsupported=0)
    return _keep_or_end(counted, PRESS_END_FRAMES if pressing else END_FRAMES)


def _keep_or_end(vote: Vote, end_frames: int) -> Vote:
    if vote.gesture is None or vote.candidate is vote.gesture:
        return replace(vote, unsupported=0)
    if vote.unsupported + 1 >= end_frames:
        return replace(vote, gesture=None, recognised_ns=0, unsupported=0)
    return replace(vote, unsupported=vote.unsupported + 1)
