"""Distances that jump further than a hand can move are no measurements until they have stayed."""

from __future__ import annotations

from dataclasses import dataclass, replace

MAX_SPEED_M_S = 2.0  # of a hand along the view: the fastest reaching is about that
SLACK_M = 0.04
SLACK_SHARE = 0.10  # of the distance: keypoints scatter in proportion to it
# A push slows down before the lens: from one frame to the next the fastest, 0.3 s there and back from 36 cm, comes
# nearer by less than a third.
MOST_NEARER = 0.40
FORGET_NS = 300_000_000
# One more than the gap that a press survives (button.GAP_FRAMES): a jump that stays ends the press before it is
# believed, and a hand that jumps near has not come from outside.
CONFIRM_FRAMES = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class JumpGuard:
    """What was accepted last, and a candidate that differs too much to be believed at once."""

    last_m: float | None = None
    last_ns: int = 0
    candidate_m: float = 0.0
    count: int = 0


def accept(guard: JumpGuard, distance_m: float, captured_ns: int) -> tuple[JumpGuard, bool]:
    """Whether a moving hand can explain this distance, or it has stayed for CONFIRM_FRAMES."""
    accepted = JumpGuard(last_m=distance_m, last_ns=captured_ns)
    elapsed_ns = captured_ns - guard.last_ns
    if guard.last_m is None or not 0 <= elapsed_ns <= FORGET_NS:
        return accepted, True
    slack_m = max(SLACK_M, SLACK_SHARE * guard.last_m)
    reach_m = slack_m + MAX_SPEED_M_S * elapsed_ns * 1e-9
    if max(-reach_m, -MOST_NEARER * guard.last_m) <= distance_m - guard.last_m <= reach_m:
        return accepted, True
    stays = guard.count > 0 and abs(distance_m - guard.candidate_m) <= slack_m
    count = guard.count + 1 if stays else 1
    if count >= CONFIRM_FRAMES:
        return accepted, True
    return replace(guard, candidate_m=distance_m, count=count), False
