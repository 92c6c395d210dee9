"""Whom the kernel ends first when memory runs out: what is started again, before what holds the legs."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

# Linux's oom_score_adj, −1000 to 1000. Higher ones may be taken by anybody, lower ones only with the privilege.
SCORES = {
    "perception": 700,  # the largest, and started again: the running action ends, no further one by gesture
    "planner": 500,
    "bus-log": 400,
    "audit": 200,
    "guardian": -900,
    "control": -900,
}
_MINE = Path("/proc/self/oom_score_adj")


def stand_in_line(name: str) -> None:
    """Take this process's place; without the privilege the two that hold the legs keep the place they were born to."""
    score = SCORES.get(name)
    if score is not None:
        with suppress(OSError):
            _MINE.write_text(f"{score}\n", encoding="ascii")
