"""Which of the hands in view commands: the one that did so far, else the largest, and of two equals none."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from kgdfa.hand import Hand

LOST_FRAMES = 5  # a hand gone this long is gone; fewer may be blur or the picture's edge
REACH_ANCHORS = 1.5  # how far a hand may be from where it was a frame ago, in palm anchors: 3 m/s at 30 Hz
REACH_GROWTH_ANCHORS = 0.5  # and how much farther for each frame without it
EQUAL_CLAIM = 0.75  # a second hand this large, relative to the first, claims the command as well


@dataclass(frozen=True, slots=True, kw_only=True)
class Track:
    """The commanding hand. `number` grows with every new one; `lost` counts frames without it."""

    hand: Hand | None = None
    last: Hand | None = None
    lost: int = 0
    number: int = 0
    contested: bool = False


def follow(track: Track, hands: tuple[Hand, ...]) -> Track:
    """The track after one frame. A new hand is taken only when none is followed and none claims as well."""
    last = track.last
    if last is not None:
        near = [hand for hand in hands if _reach(hand, last) <= REACH_ANCHORS + REACH_GROWTH_ANCHORS * track.lost]
        if near:
            hand = min(near, key=lambda candidate: _reach(candidate, last))
            return replace(track, hand=hand, last=hand, lost=0, contested=False)
        if track.lost < LOST_FRAMES:
            return replace(track, hand=None, lost=track.lost + 1)
    return _acquire(track, hands)


def _acquire(track: Track, hands: tuple[Hand, ...]) -> Track:
    by_size = sorted(hands, key=lambda hand: hand.anchor_px, reverse=True)
    contested = len(by_size) > 1 and by_size[1].anchor_px >= EQUAL_CLAIM * by_size[0].anchor_px
    if not by_size or contested:
        return Track(number=track.number, contested=contested)
    return Track(hand=by_size[0], last=by_size[0], number=track.number + 1)


def _reach(hand: Hand, last: Hand) -> float:
    """How far the palm has moved, in units of the larger of the two palm anchors."""
    moved_px = float(np.linalg.norm(hand.palm_centre_px - last.palm_centre_px))
    return moved_px / max(hand.anchor_px, last.anchor_px, 1.0)
