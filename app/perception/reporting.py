"""What perception sends: the report for control, the records for the trail, the preview for the screen."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from typing import Any

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from app.ipc.messages import PerceptionCommand, Preview, TriggerReport
from app.ipc.recording import HandFrame
from kgdfa.button_state import ButtonState
from kgdfa.gesture import Decision, Gesture
from kgdfa.pipeline import Report
from logs.reason import reason, reason_of
from logs.records import Body, Cancel, GestureOnset, Hint, Press, Release

FPS_WINDOW = 30  # frames


def with_report(message: TriggerReport, report: Report) -> TriggerReport:
    """The message of one frame."""
    return _with_button(_with_hand(message, report), report)


def with_counts(message: TriggerReport, last: Report | None) -> TriggerReport:
    """The message while no frame comes: no hand, and the counts of the last frame, since one that falls acts twice."""
    if last is None:
        return message
    return msgspec.structs.replace(_with_button(message, last), pressed=False, press_hint=None)


def hand_frame(message: TriggerReport, report: Report | None, lost: int) -> HandFrame:
    """One frame for the recording; lost: frames that it has missed."""
    hand = report.hand if report is not None else None
    if hand is None:
        return HandFrame(report=message, lost=lost)
    return HandFrame(
        report=message,
        lost=lost,
        image_px=np.asarray(hand.image_px, dtype=np.float64).tobytes(),
        world_m=np.asarray(hand.world_m, dtype=np.float64).tobytes(),
    )


def _with_hand(message: TriggerReport, report: Report) -> TriggerReport:
    verdict, distance, depth = report.verdict, report.distance, report.depth_distance
    return msgspec.structs.replace(
        message,
        captured_ns=report.captured_ns,
        hand=report.hand is not None,
        hand_refusal=reason_of(report.refusal) if report.refusal else None,
        gesture=report.gesture,
        recognised_ns=report.recognised_ns,
        raw_gesture=verdict.gesture if verdict else None,
        confidence=verdict.confidence if verdict else 0.0,
        explanation=reason_of(verdict.explanation) if verdict else None,
        votes=report.votes,
        distance_m=distance.shown_m if distance else None,
        distance_sd_m=distance.sd_m if distance else 0.0,
        safe_distance_m=distance.safe_m if distance else None,
        distance_source=distance.source if distance else None,
        depth_distance_m=depth.shown_m if depth else None,
        depth_fault=reason(report.depth_fault) if report.depth_fault else None,
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
        released_pressed_ns=button.released_pressed_ns,
        cancel_count=button.cancel_count,
        cancel_reason=reason(button.cancel_reason) if button.cancel_reason else None,
        press_hint=reason(button.hint) if button.hint else None,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Scale:
    """What turns pixels into metres: the reference segment and the focal length, and where each is from."""

    anchor_m: float
    anchor_method: str
    focal_px: float
    focal_source: str


def records_between(before: Report | None, now: Report, scale: Scale) -> Iterator[Body]:
    """What changed from one frame to the next that the trail must hold, each with what the decision compared."""
    for kind, fields in _changes(before, now):
        yield kind(**_decided(now, scale) | fields)


def _changes(before: Report | None, now: Report) -> Iterator[tuple[Callable[..., Body], dict[str, Any]]]:
    """Each record's kind, and the fields that it has beside those of `_decided`, or in their place."""
    if now.gesture is not (before.gesture if before else None):
        yield (
            GestureOnset,
            {
                "gesture": _value(now.gesture),
                "confidence": now.verdict.confidence if now.verdict else 0.0,
                "explanation": reason_of(now.verdict.explanation) if now.verdict else reason(Decision.NO_HAND),
                "votes": now.votes,
            },
        )
    if now.refusal and (before is None or before.refusal is None or now.refusal.code is not before.refusal.code):
        yield Hint, {"reason": reason_of(now.refusal), "gesture": _value(now.gesture)}
    old, button = before.button if before else ButtonState(), now.button
    if button.hint is not None and button.hint is not old.hint:
        yield Hint, {"reason": reason(button.hint), "gesture": _value(now.gesture)}
    if button.pressed and not old.pressed:
        yield Press, {"gesture": _value(button.pressed_gesture)}
    if button.release_count > old.release_count:
        yield (
            Release,
            {
                "gesture": _value(button.released_gesture),
                "number": button.release_count,
                "pressed_ns": button.pressed_captured_ns,
                "recognised_ns": button.released_recognised_ns,
                "captured_ns": button.released_ns,
            },
        )
    if button.cancel_count > old.cancel_count:
        yield (
            Cancel,
            {
                "reason": reason(button.cancel_reason) if button.cancel_reason else None,
                "gesture": _value(old.pressed_gesture),
                "pressed_ns": old.pressed_captured_ns,
                "recognised_ns": old.pressed_recognised_ns,
            },
        )


def _decided(now: Report, scale: Scale) -> dict[str, Any]:
    """The fields that all records of a decision share."""
    compared = now.button.compared
    values = {} if compared is None else msgspec.structs.asdict(compared)
    values.pop("captured_ns", None)
    source = values.pop("source", None)
    return {
        "captured_ns": now.captured_ns,
        "recognised_ns": now.recognised_ns,
        "vote_ns": now.vote_ns,
        "distance_m": now.distance.shown_m if now.distance else None,
        "safe_distance_m": values.pop("distance_m", None),
        "distance_source": source.value if source else "",
        **values,
        **asdict(scale),
    }


def _value(gesture: Gesture | None) -> str | None:
    return gesture.value if gesture else None


def frames_per_second(captures_ns: list[int]) -> float:
    """The rate over the newest capture times, 1/s; 0 while there are fewer than two."""
    recent = captures_ns[-FPS_WINDOW:]
    if len(recent) < 2 or recent[-1] == recent[0]:
        return 0.0
    return (len(recent) - 1) * 1e9 / (recent[-1] - recent[0])


@dataclass(slots=True)
class MeasuredRate:
    """The camera's rate over all captures since the first, but for the times in which it was lost."""

    frames: int = 0
    lasts_ns: int = 0  # of all intervals
    _intervals: int = 0
    _opening: int = 0
    _last_ns: int = 0

    def add(self, captured_ns: int, opening: int) -> None:
        """One more capture; opening: number of the camera's opening that it is of."""
        if self.frames and opening == self._opening:
            self.lasts_ns += captured_ns - self._last_ns
            self._intervals += 1
        self._opening, self._last_ns = opening, captured_ns
        self.frames += 1

    @property
    def hz(self) -> float | None:
        """1/s; None before the second capture."""
        return self._intervals * 1e9 / self.lasts_ns if self.lasts_ns > 0 else None


Image = NDArray[np.uint8]
Draw = Callable[[Image, float], None]  # onto an image of this scale


@dataclass(slots=True)
class PreviewPacer:
    """When the next image is due, and how wide it shall be."""

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
        """Whether to send an image now; a rate of 0 pauses it."""
        if self.rate_hz <= 0 or now_ns < self._next_ns:
            return False
        period_ns = int(1e9 / self.rate_hz)
        self._next_ns = max(self._next_ns + period_ns, now_ns + period_ns // 2)
        return True

    def message(self, image_bgr: Image, captured_ns: int, draw: Draw | None = None) -> Preview:
        """The image as it goes to the console; draw: draws onto it, given its scale.

        It is sampled at twice the preview's width, drawn on, and averaged, which keeps lines fine. To draw at the
        camera's size, or to average all of its pixels, takes several times as long.
        """
        self._sequence += 1
        large = _resized(image_bgr, 2 * self.width_px, cv2.INTER_LINEAR)
        if draw is not None:
            draw(large, large.shape[1] / image_bgr.shape[1])
        small = _resized(large, self.width_px, cv2.INTER_AREA)
        return Preview(
            sequence=self._sequence,
            captured_ns=captured_ns,
            width_px=small.shape[1],
            height_px=small.shape[0],
            rgb=cv2.cvtColor(small, cv2.COLOR_BGR2RGB).tobytes(),
        )


def _resized(image_bgr: Image, width_px: int, interpolation: int) -> Image:
    """A copy of (height, width, 3), scaled to this width; never up."""
    height, width = image_bgr.shape[:2]
    scale = min(1.0, width_px / width)
    size = (max(2, round(width * scale)), max(2, round(height * scale)))
    return np.asarray(cv2.resize(image_bgr, size, interpolation=interpolation), dtype=np.uint8)
