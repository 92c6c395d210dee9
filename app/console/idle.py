"""When an untouched console locks: after the configured time, and never while legs move. Pure."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True, slots=True, kw_only=True)
class Idle:
    """The last touch; `limit_s` 0: never lock."""

    touched_s: float
    limit_s: float

    def touched(self, now_s: float) -> Idle:
        """After a key or a click."""
        return replace(self, touched_s=now_s)

    def must_lock(self, now_s: float, *, moving: bool) -> bool:
        """Whether to lock now; motion counts as being watched."""
        return self.limit_s > 0 and not moving and now_s - self.touched_s >= self.limit_s
