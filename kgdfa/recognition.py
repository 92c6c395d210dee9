"""Vote and button of the commanding hand, frame by frame: the pipeline's pure half. Needs no arrays.

What it takes of a frame is recorded (`Frames` in `logs/records/perception.py`): `rleex audit replay` runs it again.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from kgdfa.button import advance
from kgdfa.button_state import (
    ButtonInput,
    ButtonMode,
    ButtonPlace,
    ButtonState,
    is_approaching,
    is_near,
    of_another_hand,
)
from kgdfa.distance import DistanceSource
from kgdfa.gesture import Gesture, Vote, update_vote


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameReading:
    """What one frame gives to vote and button."""

    captured_ns: int
    hand: int  # number of the track; another hand inherits neither votes nor readiness
    gesture: Gesture | None  # of this frame alone
    cut_off: bool  # partly out of the image
    distance_m: float | None  # safe distance; None: no measurement
    beside_px: float | None  # from the hand's box to the button's centre; None: no hand
    source: DistanceSource = DistanceSource.MONOCULAR  # of distance_m
    bridge_m: float | None = None  # what the keypoints would have decided by, while depth decides
    repeated: bool = False  # by the depth map of a frame before


@dataclass(frozen=True, slots=True, kw_only=True)
class Recognition:
    """Vote and button after a frame."""

    hand: int = 0
    vote: Vote = field(default_factory=Vote)
    button: ButtonState = field(default_factory=ButtonState)


def recognise(before: Recognition, reading: FrameReading, place: ButtonPlace, mode: ButtonMode) -> Recognition:
    """Both after one more frame."""
    inherited, button = before.vote, before.button
    if reading.hand != before.hand:
        inherited = Vote()
        button = of_another_hand(button) if mode is ButtonMode.ROBUST else button
    vote = _update_vote(inherited, button, reading, place, mode)
    observed = ButtonInput(
        captured_ns=reading.captured_ns,
        gesture=vote.gesture,
        recognised_ns=vote.recognised_ns,
        replaced=vote.replaced,
        contradicted=vote.contradicted,
        distance_m=reading.distance_m,
        beside_px=reading.beside_px,
        source=reading.source,
        bridge_m=reading.bridge_m,
        repeated=reading.repeated,
    )
    return Recognition(hand=reading.hand, vote=vote, button=advance(button, observed, place, mode))


def _update_vote(vote: Vote, button: ButtonState, reading: FrameReading, place: ButtonPlace, mode: ButtonMode) -> Vote:
    """A hand that outgrows the image near the button keeps its gesture: cut off, it can't be classified.

    Without a press a hole is no such cut: the camera or the chain lost frames, and their time counts.
    """
    cut = mode is ButtonMode.ROBUST and reading.cut_off
    if cut and button.pressed:
        return vote
    gesture = None if cut else reading.gesture
    pressing = is_near(button, place) or cut
    robust = mode is ButtonMode.ROBUST
    return update_vote(
        vote,
        gesture,
        reading.captured_ns,
        pressing=pressing,
        approaching=robust and is_approaching(button, place),
        refuse_alternating=robust,
        timed=robust and not button.pressed,
    )
