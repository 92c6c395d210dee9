"""The Camera Protocol, its frames, and the thread that keeps a device's latest frame."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Generic, Protocol, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from hal.errors import HardwareError

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
    """One image.

    image_bgr: (height, width, 3), uint8, unmirrored.
    captured_ns: `time.monotonic_ns` of this host when the frame was captured.
    depth_m: (height, width) float32 aligned to the colour image, or None; 0 means no measurement.
    depth_ns: `time.monotonic_ns` when this very map first came, with this image or one before; None: with this one.
    """

    image_bgr: ImageArray
    captured_ns: int
    sequence: int
    intrinsics: Intrinsics
    depth_m: DepthArray | None = None
    depth_ns: int | None = None


class Camera(Protocol):
    """A source of frames. Opened and read by the perception process alone."""

    @property
    def name(self) -> str:
        """What the operator calls it."""

    def open(self) -> None:
        """Start it. Raises HardwareError when it can't."""

    def read(self, timeout_s: float) -> Frame | None:
        """The newest frame not yet given, or None when none came in time.

        Raises EndOfRecording after a recording's last frame, HardwareError when the device is lost.
        """

    def close(self) -> None:
        """Stop it; does nothing when it isn't open."""


@runtime_checkable
class FiniteSource(Protocol):
    """A camera that can play a recording."""

    @property
    def finite(self) -> bool:
        """Whether it does: opened again, it begins anew."""


class EndOfRecording(Exception):  # noqa: N818 - not an error, the end of a finite source
    """A finite source has given its last frame."""


@runtime_checkable
class CommandedHand(Protocol):
    """A camera whose hand moves by command, as the digital hand's does."""

    def command(
        self,
        *,
        gesture: str | None = None,
        press: bool | None = None,
        click_s: float | None = None,
        move_m: tuple[float, float, float] | None = None,
        at_ns: int | None = None,
    ) -> None:
        """Move the hand from now (or at_ns) on; None changes nothing. Raises HardwareError."""


T = TypeVar("T")

FIRST_FRAME_S = 10.0  # without one for so long after opening a camera gives none
SILENCE_S = 2.0  # without a frame for so long a device counts as lost
AWAY_S = 1.0  # between two `take`, beyond their timeout: no more counts as silence
JOIN_S = 1.0
LATE_NS = 200_000_000  # an image that is later than usual by more was waiting while this process stood still
# Late for longer, and by as many images in a row, is another base of the stamps: what waited comes at once.
LATE_ROW_NS, LATE_ROW = 500_000_000, 3
DRIFT_SHARE = 1000  # of the time: by so little the usual delay grows, more than two clocks drift apart


class UsualDelay:
    """The least delay of a camera's images so far.

    Compared with it, an image that waited in a driver's buffer stands out, while a slow camera's images don't, nor do
    those whose stamps begin at another moment than this host's clock. Where that moment changes, as librealsense's does
    when this host's date is set, and where a camera without stamps becomes slow, images are late for half a second.
    """

    def __init__(self) -> None:
        self._least_ns: int | None = None
        self._updated_ns = 0
        self._late: list[int] = []  # when each image came since all have been late

    def exceeded(self, delay_ns: int, now_ns: int, by_ns: int = LATE_NS) -> bool:
        """Whether this image's delay is longer than usual by more than that; never the first one's."""
        least_ns = delay_ns
        if self._least_ns is not None:
            least_ns = min(delay_ns, self._least_ns + (now_ns - self._updated_ns) // DRIFT_SHARE)
        late = delay_ns - least_ns > by_ns
        self._late = [*self._late, now_ns] if late else []
        if len(self._late) >= LATE_ROW and now_ns - self._late[0] > LATE_ROW_NS:
            late, least_ns, self._late = False, delay_ns, []
        self._least_ns, self._updated_ns = least_ns, now_ns
        return late


class LatestFrame(Generic[T]):
    """Calls `grab` again and again in a thread, so that a driver that hangs blocks nothing else.

    `take` gives what came last, once.
    """

    def __init__(self, grab: Callable[[], T | None], *, lost: HardwareError, silence_s: float = SILENCE_S) -> None:
        """grab: blocks for the next frame, None when none came, HardwareError when the device is gone.

        lost: raised when nothing came for silence_s, or no first value for FIRST_FRAME_S. That is counted while
        somebody takes: else the whole process may have stood still.
        """
        self._grab = grab
        self._lost = lost
        self._silence_s = silence_s
        self._limit_s = FIRST_FRAME_S
        self._changed = threading.Condition()
        self._value: T | None = None
        self._error: HardwareError | EndOfRecording | None = None
        self._stopped = False
        self._received_s = self._taken_s = time.monotonic()
        self._thread = threading.Thread(target=self._run, name="camera-reader", daemon=True)
        self._thread.start()

    def take(self, timeout_s: float) -> T | None:
        """The newest value not yet taken, or None in time. Raises HardwareError when the device is lost."""
        with self._changed:
            self._changed.wait_for(lambda: self._value is not None or self._error is not None, timeout_s)
            now_s = time.monotonic()
            paused_s = max(0.0, now_s - self._taken_s - timeout_s - AWAY_S)
            self._taken_s, self._received_s = now_s, min(self._received_s + paused_s, now_s)
            if self._value is not None:
                value, self._value = self._value, None
                return value
            if self._error is not None:
                raise self._error
            if now_s - self._received_s > self._limit_s:
                raise self._lost
            return None

    def stop(self) -> bool:
        """End the thread; False when the driver hangs and its thread was abandoned."""
        self._stopped = True
        self._thread.join(JOIN_S)
        return not self._thread.is_alive()

    def _run(self) -> None:
        while not self._stopped:
            try:
                value = self._grab()
            except (HardwareError, EndOfRecording) as error:
                with self._changed:
                    self._error = error
                    self._changed.notify_all()
                return
            if value is None:
                continue
            with self._changed:
                self._value = value
                self._received_s, self._limit_s = time.monotonic(), self._silence_s
                self._changed.notify_all()
