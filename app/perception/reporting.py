"""From a pipeline report to the message for control and the records for the trail. Pure folds."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import msgspec

from app.ipc.messages import PressRange, TriggerReport
from kgdfa.pipeline import Report
from logs.records import Body, Cancel, GestureOnset, Press, Release

FPS_WINDOW = 30  # frames


@dataclass(frozen=True, slots=True, kw_only=True)
class Surroundings:
    """What the message says beside the hand."""

    incarnation: int
    sequence: int
    sent_ns: int
    camera: str
    threshold_m: float
    fps: float
    camera_fault: str = ""
    hint: str = ""
    detector_ready: bool = True
    press_zone: PressRange | None = None


def to_message(report: Report | None, around: Surroundings, captured_ns: int) -> TriggerReport:
    """The trigger report of one frame; without a pipeline report, "no hand" with the reason why."""
    if report is None:
        return _without_hand(around, captured_ns)
    return _with_button(_with_hand(_without_hand(around, report.captured_ns), report), report)


def _without_hand(around: Surroundings, captured_ns: int) -> TriggerReport:
    return TriggerReport(
        incarnation=around.incarnation,
        sequence=around.sequence,
        captured_ns=captured_ns,
        sent_ns=around.sent_ns,
        hand=False,
        gesture=None,
        threshold_m=around.threshold_m,
        fps=around.fps,
        camera=around.camera,
        camera_fault=around.camera_fault,
        hint=around.hint,
        detector_ready=around.detector_ready,
        press_zone=around.press_zone,
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
        explanation=verdict.explanation if verdict else "",
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
        released_captured_ns=button.released_captured_ns,
        cancel_count=button.cancel_count,
        cancel_reason=button.cancel_reason,
        press_hint=button.hint,
        depth_pressed=report.depth_button.pressed if report.depth_button else False,
    )


def records_between(before: Report | None, now: Report) -> Iterator[Body]:
    """What changed from one frame to the next that the trail must hold."""
    distance_m = now.distance.shown_m if now.distance else None
    if now.gesture is not (before.gesture if before else None):
        yield GestureOnset(
            gesture=now.gesture.value if now.gesture else None,
            confidence=now.verdict.confidence if now.verdict else 0.0,
            explanation=now.verdict.explanation if now.verdict else "no hand",
            votes=now.votes,
            captured_ns=now.captured_ns,
            distance_m=distance_m,
        )
    old = before.button if before else None
    button = now.button
    if button.pressed and not (old and old.pressed):
        gesture = button.pressed_gesture.value if button.pressed_gesture else None
        yield Press(gesture=gesture, captured_ns=now.captured_ns, distance_m=distance_m)
    if button.release_count > (old.release_count if old else 0):
        yield Release(
            gesture=button.released_gesture.value if button.released_gesture else None,
            recognised_ns=button.released_recognised_ns,
            captured_ns=button.released_captured_ns,
            distance_m=distance_m,
            number=button.release_count,
        )
    if button.cancel_count > (old.cancel_count if old else 0):
        yield Cancel(reason=button.cancel_reason, captured_ns=now.captured_ns)


def frames_per_second(captures_ns: list[int]) -> float:
    """The rate over the newest capture times, 1/s; 0 while there are fewer than two."""
    recent = captures_ns[-FPS_WINDOW:]
    if len(recent) < 2 or recent[-1] == recent[0]:
        return 0.0
    return (len(recent) - 1) * 1e9 / (recent[-1] - recent[0])
