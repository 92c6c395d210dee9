"""The small picture for the screen: drawn on, scaled down, at the screen's own rate."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from app.ipc.messages import PerceptionCommand, Preview

Image = NDArray[np.uint8]


@dataclass(slots=True)
class PreviewPacer:
    """When the next picture is due, and how wide it shall be."""

    width_px: int = 160
    rate_hz: float = 12.0
    _next_ns: int = 0
    _sequence: int = 0

    def configure(self, command: PerceptionCommand) -> None:
        """Take the screen's wishes; what it leaves open stays."""
        self.width_px = command.preview_width_px or self.width_px
        if command.preview_hz is not None:
            self.rate_hz = command.preview_hz

    def due(self, now_ns: int) -> bool:
        """Whether to send a picture now; a rate of 0 pauses it."""
        if self.rate_hz <= 0 or now_ns < self._next_ns:
            return False
        period_ns = int(1e9 / self.rate_hz)
        self._next_ns = max(self._next_ns + period_ns, now_ns + period_ns // 2)
        return True

    def shrink(self, image_bgr: Image) -> Image:
        """(height, width, 3) scaled to the preview's width; never up."""
        height, width = image_bgr.shape[:2]
        scale = min(1.0, self.width_px / width)
        size = (max(2, round(width * scale)), max(2, round(height * scale)))
        return np.asarray(cv2.resize(image_bgr, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)

    def message(self, image_bgr: Image, captured_ns: int) -> Preview:
        """The picture as it goes to the console."""
        self._sequence += 1
        small = self.shrink(image_bgr)
        return Preview(
            sequence=self._sequence,
            captured_ns=captured_ns,
            width_px=small.shape[1],
            height_px=small.shape[0],
            rgb=np.ascontiguousarray(small[:, :, ::-1]).tobytes(),
        )
