"""What is wrong with the picture, for the therapist: judged once a second, told only when it lasts."""

from __future__ import annotations

from dataclasses import dataclass

from hal.cameras.camera import Frame
from hal.cameras.exposure import hint

LOOK_NS = 500_000_000
LASTING = 3  # looks in a row: a hand that covers the lens for a moment is not a dark room


@dataclass(slots=True)
class PictureHints:
    """Remembers the last looks."""

    told: str = ""
    _seen: str = ""
    _count: int = 0
    _next_ns: int = 0

    def of(self, frame: Frame) -> str:
        """The sentence in force after this frame; empty when the picture is good."""
        if frame.captured_ns < self._next_ns:
            return self.told
        self._next_ns = frame.captured_ns + LOOK_NS
        now = hint(frame.image_bgr)
        self._count = self._count + 1 if now == self._seen else 1
        self._seen = now
        if self._count >= LASTING:
            self.told = now
        return self.told
