"""What perception sends: the report for control, the records for the trail, the preview for the screen."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from app.ipc.messages import PerceptionCommand, Preview, TriggerReport
from kgdfa.gesture import Decision
from kgdfa.pipeline import Report
from kgdfa.press_zone import PressZone
from logs.reason import Reason, reason, reason_of
from logs.records import Body, Cancel, GestureOnset, Press, Release

FPS_WINDOW = 30  # frames


@dataclass(frozen=True, slots=True, kw_only=True)
class Context:
    """What the message carries beside the hand."""

    incarnation: int
    sequence: int
    sent_ns: int
    camera: str
    threshold_m: float
    fps: float
    camera_fault: Reason | None = None
    hint: Reason | None = None
    detector_ready: bool = True
    press_zone: PressZone | None = None


def to_message(report: Report | None, context: Context, captured_ns: int) -> TriggerReport:
    """The trigger report of one frame; without a pipeline report, "no hand" with the reason why."""
    if report is None:
        return _without_hand(context, captured_ns)
    return _with_button(_with_hand(_without_hand(context, report.captured_ns), report), report)


def _without_hand(context: Context, captured_ns: int) -> TriggerReport:
    return TriggerReport(
        incarnation=context.incarnation,
        sequence=context.sequence,
        captured_ns=captured_ns,
        sent_ns=context.sent_ns,
        hand=False,
        gesture=None,
        threshold_m=context.threshold_m,
        fps=context.fps,
        camera=context.camera,
        camera_fault=context.camera_fault,
        hint=context.hint,
        detector_ready=context.detector_ready,
        press_zone=context.press_zone,
    )


def _with_hand(message: TriggerReport, report: Report) -> TriggerReport:
    verdict, distance, depth = report.verdict, report.distance, report.depth_distance
    return msgspec.structs.replace(
        message,
        hand=report.hand is not None,
        gesture=report.gesture,
        recognised_ns=report.recognised_ns,
        raw_gesture=verdict.gesture if verdict else None,
        confidence=verdict.confidence if verdict else 0.0,
        explanation=reason_of(verdict.explanation) if verdict else None,
        votes=report.votes,
        distance_m=distance.shown_m if distance else None,
        distance_sd_m=distance.sd_m if distance else 0.0,
        safe_distance_m=distance.safe_m if distance else None,
        depth_distance_m=depth.shown_m if depth else None,
    )


def _with_button(message: TriggerReport, report: Report) -> TriggerReport:
    button = report.button
    return msgspec.structs.replace(
        message,
        pressed=button.pressed,
        release_count=button.release_count,
        released_gesture=button.released_gesture,
        released_recognised_ns=button.released_recognised_ns,
        released_ns=button.released_ns,
        cancel_count=button.cancel_count,
        cancel_reason=reason(button.cancel_reason) if button.cancel_reason else None,
        press_hint=reason(button.hint) if button.hint else None,
        depth_pressed=report.depth_button.pressed if report.depth_button else False,
    )


def records_between(before: Report | None, now: Report, threshold_m: float) -> Iterator[Body]:
    """What changed from one frame to the next that the trail must hold; threshold_m: of the press."""
    distance_m = now.distance.shown_m if now.distance else None
    if now.gesture is not (before.gesture if before else None):
        yield GestureOnset(
            gesture=now.gesture.value if now.gesture else None,
            confidence=now.verdict.confidence if now.verdict else 0.0,
            explanation=reason_of(now.verdict.explanation) if now.verdict else reason(Decision.NO_HAND),
            votes=now.votes,
            captured_ns=now.captured_ns,
            distance_m=distance_m,
        )
    old = before.button if before else None
    button = now.button
    if button.pressed and not (old and old.pressed):
        gesture = button.pressed_gesture.value if button.pressed_gesture else None
        yield Press(gesture=gesture, captured_ns=now.captured_ns, distance_m=distance_m, threshold_m=threshold_m)
    if button.release_count > (old.release_count if old else 0):
        yield Release(
            gesture=button.released_gesture.value if button.released_gesture else None,
            recognised_ns=button.released_recognised_ns,
            captured_ns=button.released_ns,
            distance_m=distance_m,
            number=button.release_count,
        )
    if button.cancel_count > (old.cancel_count if old else 0):
        pressed = old.pressed_gesture if old else None
        yield Cancel(
            reason=reason(button.cancel_reason) if button.cancel_reason else None,
            gesture=pressed.value if pressed else None,
            captured_ns=now.captured_ns,
        )


def frames_per_second(captures_ns: list[int]) -> float:
    """The rate over the newest capture times, 1/s; 0 while there are fewer than two."""
    recent = captures_ns[-FPS_WINDOW:]
    if len(recent) < 2 or recent[-1] == recent[0]:
        return 0.0
    return (len(recent) - 1) * 1e9 / (recent[-1] - recent[0])


Image = NDArray[np.uint8]


@dataclass(slots=True)
class PreviewPacer:
    """When the next picture is due, and how wide it shall be."""

    width_px: int = 160
    rate_hz: float = 12.0
    _next_ns: int = 0
    _sequence: int = 0

    def configure(self, command: PerceptionCommand) -> None:
        """Take the screen's settings; what it leaves open stays."""
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
