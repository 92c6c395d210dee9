"""The digital hand: a camera with a rendered hand whose exact state is known."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

from hal.cameras.camera import Frame, Intrinsics, LatestFrame
from hal.cameras.digital_hand import movement as hand_motion
from hal.cameras.digital_hand.depth import DepthCamera
from hal.cameras.digital_hand.movement import HandLimit, limited, tremor_deg
from hal.cameras.digital_hand.render import Person, Scene, lens_for, person_of, render
from hal.errors import CameraFault, HardwareError

MAX_RATE_HZ = 240.0
MAX_CLICK_S = 10.0
THRESHOLD_M = 0.20
REST_M = 0.36
RENDER_WAIT_S = 0.1  # in which the rendering thread sees that it is to end
PRESS_M = 0.145  # well under the threshold, and the fingertips still in the image of the default lens


class DigitalHandCamera:
    """A Camera whose hand moves by `command`; `scene` and `render` depend on time and commands only."""

    def __init__(
        self,
        *,
        seed: int = 1,
        lens: Intrinsics | None = None,
        rate_hz: float = 30.0,
        person: Person | None = None,
        depth: bool = False,
        depth_holes: float = 0.0,
        rest_m: float = REST_M,
        press_m: float = PRESS_M,
        gesture: str = hand_motion.SETTLED,
        tremor: hand_motion.Tremor | None = None,
        limit: HandLimit = HandLimit.NONE,
        ahead: bool = False,
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        """seed chooses person, room and lamp; `person` overrides it. depth_holes: see `DepthCamera`.

        limit: what the hand can't do. ahead: a thread renders, as a camera's own does, so that it takes no time of who
        reads. Raises HardwareError for a bad rate.
        """
        if not 0 < rate_hz <= MAX_RATE_HZ:
            raise HardwareError(CameraFault.RATE_OUT_OF_RANGE, rate_hz=rate_hz, limit_hz=MAX_RATE_HZ)
        self.person = person or person_of(seed)
        self.lens = lens or lens_for()
        self._period_ns = round(1e9 / rate_hz)
        self._seed = seed
        self._limit = limit
        self._depth = DepthCamera(seed, holes=depth_holes) if depth else None
        self._clock_ns = clock_ns
        self._movement = hand_motion.begin(self.person, rest_m=rest_m, press_m=press_m, gesture=gesture, tremor=tremor)
        self._opened_ns: int | None = None
        self._sequence = 0
        self._ahead = ahead
        self._latest: LatestFrame[Frame] | None = None

    @property
    def name(self) -> str:
        return f"digital hand {self._seed}" if self._depth is None else f"digital D435i {self._seed}"

    def open(self) -> None:
        """Begin the frames. The first is due at once."""
        self._opened_ns = self._clock_ns()
        self._sequence = 0
        self.render(self._opened_ns)  # renders the room, which later frames reuse
        if self._ahead:
            lost = HardwareError(CameraFault.NO_FRAMES, camera=self.name)
            self._latest = LatestFrame(partial(self._next, RENDER_WAIT_S), lost=lost)

    def close(self) -> None:
        if self._latest is not None:
            self._latest.stop()
            self._latest = None
        self._opened_ns = None

    def read(self, timeout_s: float) -> Frame | None:
        """The newest due frame not yet given, waiting up to timeout_s. Raises HardwareError when not open."""
        if self._latest is not None:
            return self._latest.take(timeout_s)
        return self._next(timeout_s)

    def _next(self, timeout_s: float) -> Frame | None:
        """The newest due frame not yet rendered."""
        if self._opened_ns is None:
            raise HardwareError(CameraFault.NOT_OPEN, camera=self.name)
        now_ns = self._clock_ns()
        due = max(self._sequence + 1, (now_ns - self._opened_ns) // self._period_ns)
        due_ns = self._opened_ns + due * self._period_ns
        wait_s = (due_ns - now_ns) / 1e9
        if wait_s > timeout_s:
            time.sleep(timeout_s)
            return None
        if wait_s > 0:
            time.sleep(wait_s)
        self._sequence = due
        return self.render(due_ns, sequence=due)

    def command(
        self,
        *,
        gesture: str | None = None,
        press: bool | None = None,
        click_s: float | None = None,
        move_m: tuple[float, float, float] | None = None,
        at_ns: int | None = None,
    ) -> None:
        """Move the hand from now (or at_ns) on; None leaves a thing as it is.

        gesture: a name of `skeleton.POSES`, or "none" to leave the image. press: push (True) or draw back.
        click_s: push and draw back within this time. move_m: shift right, down, away from the camera.
        Raises HardwareError for a gesture or a time that does not exist.
        """
        now_ns = self._clock_ns() if at_ns is None else at_ns
        movement = self._movement
        if gesture is not None:
            movement = hand_motion.sign(movement, gesture, now_ns)
        if move_m is not None:
            movement = hand_motion.shift(movement, move_m, now_ns)
        if press is not None:
            movement = hand_motion.push(movement, press, now_ns)
        if click_s is not None:
            if not 0 < click_s <= MAX_CLICK_S:
                raise HardwareError(CameraFault.CLICK_OUT_OF_RANGE, click_s=click_s, limit_s=MAX_CLICK_S)
            movement = hand_motion.click(movement, click_s, now_ns)
        self._movement = movement

    def scene(self, captured_ns: int) -> Scene:
        """What the camera captures at a moment of the last minute, exactly."""
        angles_deg = limited(self._limit, self._movement.angles_deg(captured_ns))
        return Scene(
            person=self.person,
            lens=self.lens,
            angles_deg=angles_deg + tremor_deg(self._limit, captured_ns / 1e9),
            place=self._movement.place(captured_ns),
        )

    def render(self, captured_ns: int, *, sequence: int = 0) -> Frame:
        """The frame of a moment; the same moment gives the same image, bit for bit."""
        noise_seed = (captured_ns // 1_000_000 + 7919 * self._seed) % (1 << 31)
        rendered = render(self.scene(captured_ns), noise_seed, depth=self._depth is not None)
        depth_m = None
        if self._depth is not None and rendered.surface_m is not None:
            flipping = not self._movement.settled(captured_ns)
            depth_m = self._depth.measure(rendered.surface_m, noise_seed, flipping)
        return Frame(
            image_bgr=rendered.image_bgr,
            captured_ns=captured_ns,
            sequence=sequence,
            intrinsics=self.lens,
            depth_m=depth_m,
        )
