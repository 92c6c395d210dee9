"""Hand to camera: from the palm anchor's length in pixels (Eq. 4), and, if there, from the depth map."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from kgdfa.hand import Hand


@dataclass(frozen=True, slots=True, kw_only=True)
class Distance:
    """One measurement, metres. `safe_m` may read far, never near: the button uses it; `shown_m` is the best guess."""

    shown_m: float
    safe_m: float
    sd_m: float
    tilt_rad: float = 0.0


class RangeFinder(Protocol):
    """A named way to measure distance from a hand's keypoints: `published` or `robust`."""

    name: str

    def measure(self, hand: Hand, captured_ns: int) -> Distance | None:
        """The distance now, or None when this hand gives no measurement."""
        ...

    def reset(self) -> None:
        """Forget the past: another hand, or a gap."""
        ...
