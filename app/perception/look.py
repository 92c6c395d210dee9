"""A camera that only looks: in a process of its own, with its own capture thread, pipeline and rate.

It commands nothing; whoever compares it takes its newest `CameraSample`. Its process yields to the one that commands.
"""

from __future__ import annotations

import os
import time
from contextlib import closing, suppress
from dataclasses import dataclass
from enum import Enum, auto
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING

from app.ipc.messages import HandCommand, Preview
from app.system.config import SessionSetup
from app.system.diagnostics_log import discard_output
from app.system.errors import AppError
from app.system.scheduling import pin_to_control_core
from logs.reason import Reason, reason, reason_of
from profiles.schema import DistanceUsed

if TYPE_CHECKING:
    from hal.cameras.camera import Camera, DepthArray, Frame, ImageArray, Intrinsics
    from kgdfa.button_state import ButtonPlace
    from kgdfa.keypoints import HandDetector
    from kgdfa.pipeline import Pipeline, Report

NICENESS = 19  # of a camera that only looks, beside one that commands
FRAME_TIMEOUT_S = 0.1
END_S = 3.0
PREVIEW_PX = 96
PREVIEW_HZ = 8.0
PUSH_EVERY_S = 4.0  # what a digital hand does by itself: all cameras' at the same moments
PUSH_S = 1.0
COLOURS_M = (0.15, 1.2)  # nearest and farthest depth that the false colours tell apart


class LookFault(Enum):
    """Why two cameras can't be compared, one that looks gives nothing more, or what was compared is not kept."""

    SAME_DEVICE = auto()  # first, second
    RATE_OUT_OF_RANGE = auto()  # rate_hz, least_hz, most_hz
    NO_FRAME = auto()  # camera, why
    DIED = auto()
    NOT_KEPT = auto()  # path, detail


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraSample:
    """What one camera measured in one frame; counts run from its first frame on, so that a missed sample loses none.

    hand: one is in view, whether or not it may command. lost: frames without one after the first with one.
    safe_m: by which its button decides.
    """

    camera: str
    captured_ns: int
    frames: int
    lost: int
    latency_ms: float
    distance_m: float | None
    safe_m: float | None
    pressed: bool
    presses: int
    by_depth: bool = False
    why: Reason | None = None  # no distance, or no picture


class Looker:
    """The process that looks, held by whoever compares."""

    def __init__(self, setup: SessionSetup, *, niceness: int = NICENESS) -> None:
        """setup: its configuration's camera and its profile's distance are those to look with. Starts at once."""
        context = get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self.ended = False
        self._why: Reason | None = None  # the newest reason, until a frame comes
        self._process = context.Process(target=look, args=(theirs, setup, niceness), daemon=True)
        self._process.start()
        theirs.close()

    def receive(self) -> list[CameraSample | Preview | Reason]:
        """What came since the last call. A reason: why there is no picture; if it has ended, why there will be none."""
        received: list[CameraSample | Preview | Reason] = []
        try:
            while not self.ended and self._pipe.poll():
                message = self._pipe.recv()
                self._why = message if isinstance(message, Reason) else None
                received.append(message)
        except (EOFError, OSError):
            self.ended = True
            received.append(self._why or reason(LookFault.DIED))
        return received

    def move_hand(self, command: HandCommand) -> None:
        """A digital hand follows the session's."""
        with suppress(OSError):
            self._pipe.send(command)

    def close(self) -> None:
        """End it, whatever its driver does."""
        self._pipe.close()
        self._process.join(END_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()


def look(pipe: Connection, setup: SessionSetup, niceness: int) -> None:
    """Frames through the chain until the other end closes; a fault is sent and the camera is opened again."""
    os.nice(niceness)
    if niceness:  # only control is there, which goes before it; beside a camera that commands it costs that one frames
        pin_to_control_core(setup.config.control_core)
    discard_output()
    from app.perception.pipeline import make_camera, make_detector
    from hal.errors import HardwareError
    from kgdfa.errors import KgdfaError

    try:
        camera = make_camera(setup)
        with make_detector(setup) as detector:
            _Look(pipe, setup, camera, detector).run()
    except (AppError, HardwareError, KgdfaError) as error:
        pipe.send(reason_of(error))
    except (BrokenPipeError, EOFError):
        pass  # nobody compares any more


class _Look:
    """Camera, chain and counts of one process."""

    def __init__(self, pipe: Connection, setup: SessionSetup, camera: Camera, detector: HandDetector) -> None:
        from app.perception.camera import CameraSupervisor
        from app.perception.reporting import PreviewPacer

        self._pipe, self._setup, self._detector = pipe, setup, detector
        self._camera = CameraSupervisor(camera, on_fault=pipe.send)
        self._pacer = PreviewPacer(width_px=PREVIEW_PX, rate_hz=PREVIEW_HZ)
        self._chain: tuple[Pipeline, ButtonPlace] | None = None
        self._lens: tuple[str, Intrinsics] | None = None  # the camera that the chain is built for
        self._frames = self._lost = self._presses = 0
        self._pressed = self._had_hand = False
        self._next_push_s = 0.0
        self._by_itself = True

    def run(self) -> None:
        """Until the pipe breaks, or the camera has ended: then why is sent last."""
        with closing(self._camera):
            while not self._camera.ended:
                self._handle_commands()
                frame = self._camera.read(time.monotonic(), FRAME_TIMEOUT_S)
                if frame is not None:
                    self._take(frame)
                elif self._camera.fault:
                    time.sleep(FRAME_TIMEOUT_S)
            self._pipe.send(self._camera.fault)

    def _handle_commands(self) -> None:
        from app.perception.camera import move_hand
        from hal.cameras.camera import CommandedHand

        camera = self._camera.camera
        while self._pipe.poll():
            move_hand(camera, self._pipe.recv())
            self._by_itself = False
        if self._by_itself and isinstance(camera, CommandedHand):
            now_s = time.monotonic()
            if now_s >= self._next_push_s:  # at whole multiples: every camera's hand pushes at the same moment
                first = not self._next_push_s
                self._next_push_s = (now_s // PUSH_EVERY_S + 1) * PUSH_EVERY_S
                camera.command(gesture="5" if first else None, click_s=None if first else PUSH_S)

    def _take(self, frame: Frame) -> None:
        from app.perception.pipeline import make_pipeline
        from kgdfa.draw import draw
        from kgdfa.pipeline import PipelineInput

        lens = self._camera.camera.name, frame.intrinsics
        if self._chain is None or self._lens != lens:
            self._chain, self._lens = make_pipeline(self._setup, self._detector, frame, lens[0]), lens
        pipeline, place = self._chain
        source = PipelineInput(
            image_bgr=frame.image_bgr,
            captured_ns=frame.captured_ns,
            depth_m=frame.depth_m,
            depth_ns=frame.depth_ns,
        )
        report = pipeline.process(source)
        self._pipe.send(self._sample(report))
        if self._pacer.due(time.monotonic_ns()):
            by_depth = self._setup.profile.distance_source is DistanceUsed.DEPTH and frame.depth_m is not None
            image = false_colours(frame.depth_m) if by_depth and frame.depth_m is not None else frame.image_bgr
            self._pipe.send(
                self._pacer.message(image, frame.captured_ns, lambda small, scale: draw(small, report, place, scale))
            )

    def _sample(self, report: Report) -> CameraSample:
        hand, distance, button = report.hand is not None or report.refusal is not None, report.distance, report.button
        self._frames += 1
        self._had_hand = self._had_hand or hand
        self._lost += self._had_hand and not hand
        self._presses += button.pressed and not self._pressed
        self._pressed = button.pressed
        return CameraSample(
            camera=self._camera.camera.name,
            captured_ns=report.captured_ns,
            frames=self._frames,
            lost=self._lost,
            latency_ms=(time.monotonic_ns() - report.captured_ns) / 1e6,
            distance_m=distance.shown_m if distance else None,
            safe_m=distance.safe_m if distance else None,
            pressed=button.pressed,
            presses=self._presses,
            by_depth=distance is not None and report.depth_distance is distance,
            why=_why(report) if distance is None else None,
        )


def _why(report: Report) -> Reason | None:
    """Why there is no distance: the hand does not command, or its depth can't be used."""
    if report.refusal is not None:
        return reason_of(report.refusal)
    return reason(report.depth_fault) if report.depth_fault else None


def false_colours(depth_m: DepthArray) -> ImageArray:
    """(h, w, 3) uint8: near red, far blue, and black where nothing was measured."""
    import cv2
    import numpy as np

    near_m, far_m = COLOURS_M
    measured = np.isfinite(depth_m) & (depth_m > 0)
    share = np.clip((far_m - np.where(measured, depth_m, 0.0)) / (far_m - near_m), 0, 1)
    coloured = cv2.applyColorMap((255 * share).astype(np.uint8), cv2.COLORMAP_TURBO)
    coloured[~measured] = 0
    return np.asarray(coloured, np.uint8)
