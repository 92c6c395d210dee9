"""The Camera Protocol and what a camera gives: frames with capture time, intrinsics and, if it has it, depth."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

ImageArray = NDArray[np.uint8]
DepthArray = NDArray[np.float32]


class IntrinsicsSource(Enum):
    """Where a camera's intrinsics come from; assumed ones are marked on the screen."""

    MEASURED = "measured"
    GIVEN = "given"
    ASSUMED = "assumed"


@dataclass(frozen=True, slots=True, kw_only=True)
class Intrinsics:
    """Pinhole intrinsics for one resolution, pixels; k1, k2: radial distortion as OpenCV has it, without unit."""

    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    source: IntrinsicsSource
    k1: float = 0.0
    k2: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """One picture.

    image_bgr: (height, width, 3), uint8, unmirrored.
    captured_ns: `time.monotonic_ns` of this host when the frame was captured.
    depth_m: (height, width) float32 aligned to the colour picture, or None; 0 means no measurement.
    """

    image_bgr: ImageArray
    captured_ns: int
    sequence: int
    intrinsics: Intrinsics
    depth_m: DepthArray | None = None


class Camera(Protocol):
    """A source of frames. Opened and read by the perception process alone."""

    @property
    def name(self) -> str:
        """What the operator calls it."""
        ...

    def open(self) -> None:
        """Start it. Raises HardwareError with a sentence when it can't."""
        ...

    def read(self, timeout_s: float) -> Frame | None:
        """The newest frame not yet given, or None when none came in time.

        Raises EndOfRecording after a recording's last frame, HardwareError when the device is lost.
        """
        ...

    def close(self) -> None:
        """Stop it; harmless when it isn't open."""
        ...


class EndOfRecording(Exception):  # noqa: N818 - not an error, the end of a finite source
    """A finite source has given its last frame."""
