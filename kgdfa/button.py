"""The virtual button: pressed by a hand that comes near, released by one that withdraws, cancelled by all else.

`published` is the paper's rule, literally: pressed while the hand is nearer than the threshold and its bounding
box covers the button, else released, and every release commands. `robust` presses only a hand that was seen
outside the threshold and crossed it with a voted gesture over the button, and commands only when that hand
withdraws; any other end of a press is a cancel with its reason. In the frame in which another source begins to measure
(depth, or the keypoints that bridge its holes) nothing is pressed, released or made ready; what was measured before is
put in the new source's terms, so that only the hand's own movement counts as an approach.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

from msgspec import Struct
from msgspec.structs import replace

from kgdfa.distance import DistanceSource
from kgdfa.frame_time import FRAME_NS, have_lasted
from kgdfa.gesture import Gesture

if TYPE_CHECKING:
    from kgdfa.hand import Box

HYSTERESIS = 0.20  # a press ends, and a new one may begin, beyond this share over the threshold: three sd of keypoints
APPROACH_M_S = 3.5  # a 0.3 s press from 36 cm peaks at 2.7 m/s, its safe distance at a tenth more; faster is a slip
# Press to release, two frames: keypoints that slip for a frame slip back in the next. Where that one is lost, or comes
# later than this, time alone does not tell: a second frame has to see the hand near (`measured_near`).
SHORTEST_PRESS_NS = 50_000_000
# `rleex evaluate` pushes and withdraws in 3 s at most; a slow hand gets three times as long. What one that stays longer
# still means, nobody knows: cut off by the image's edge it keeps its gesture unread.
LONGEST_PRESS_NS = 10_000_000_000
RADIUS_SHARE = 0.06  # the button's radius, of the picture's width: a coin held at arm's length
GAP_FRAMES = 2  # in a row without a hand or a distance that a press and an approach survive, as long as at 30 Hz
STALE_NS = 250_000_000  # frames further apart than this don't tell what happened between them
# A press begins with an approach: within five frames the distance fell by this share of the threshold. A hand that
# hovers about the threshold crosses it more slowly; a push of 0.8 s from 7 cm outside is three times as fast.
APPROACH_NS = 170_000_000
APPROACH_SHARE = 0.15
# A gesture that took another one's place must have been in force for so long before it presses: keypoints that slipped
# just before a push had a 3 command 2, and nobody changes a hand and pushes it within a fifth of a second.
SETTLING_NS = 200_000_000


class PressCancel(Enum):
    """Why a press ended without a command."""

    HAND_LOST = "hand lost"
    DISTANCE_LOST = "distance lost"
    GESTURE_CHANGED = "gesture changed"
    LEFT_SIDEWAYS = "left sideways"
    TOO_SHORT = "too short"
    TOO_LONG = "too long"
    CAMERA_PAUSED = "camera paused"
    ENDED = "ended"  # no more frames: the session ended, or the camera was replaced


class PressHint(Enum):
    """Why a hand that is near does not press: what to do."""

    WITHDRAW_FIRST = "withdraw first"
    PUSH_STEADILY = "push steadily"
    APPROACH_FIRST = "approach first"  # it hovers: the distance fell too slowly
    MORE_IMAGES = "more images"  # they are further apart than an approach lasts: none can be measured
    GESTURE_FIRST = "gesture first"
    KEEP_GESTURE = "keep gesture"
    OVER_BUTTON = "over button"


class ButtonMode(Enum):
    """Which rule the button follows."""

    PUBLISHED = "published"
    ROBUST = "robust"


@dataclass(frozen=True, slots=True, kw_only=True)
class ButtonPlace:
    """Where the button is on the picture and how near is pressed."""

    x_px: float
    y_px: float
    radius_px: float
    threshold_m: float

    @classmethod
    def in_the_middle(cls, width_px: float, height_px: float, threshold_m: float) -> ButtonPlace:
        """Of a picture of that size."""
        return cls(x_px=width_px / 2, y_px=height_px / 2, radius_px=RADIUS_SHARE * width_px, threshold_m=threshold_m)

    def beside_px(self, box: Box) -> float:
        """How far the button's centre is from the box, along the farther axis; 0 inside."""
        aside_px = max(box.left_px - self.x_px, self.x_px - box.right_px)
        return max(aside_px, box.top_px - self.y_px, self.y_px - box.bottom_px, 0.0)


class ButtonInput(Struct, frozen=True, kw_only=True):
    """What one frame gives to the button."""

    captured_ns: int
    gesture: Gesture | None  # voted
    recognised_ns: int  # capture of the frame whose vote made `gesture`
    replaced: bool = False  # it took another gesture's place then
    distance_m: float | None  # safe distance; None: no measurement
    beside_px: float | None  # from the box of the 22 points to the button's centre, see `ButtonPlace`; None: no hand
    source: DistanceSource = DistanceSource.MONOCULAR  # of distance_m
    bridge_m: float | None = None  # what the keypoints would have decided by, while depth decides
    repeated: bool = False  # by the depth map of a frame before


class ButtonComparison(Struct, frozen=True, kw_only=True):
    """What one frame's decision compared: each value beside its limit. None: not measured."""

    captured_ns: int
    elapsed_ns: int  # since the frame before; 0: it is the first
    distance_m: float | None  # safe distance
    previous_m: float | None  # the newest before it, over a gap as well
    threshold_m: float  # nearer is pressed
    release_m: float  # farther is released, and ready for a press
    nearer_m: float | None  # how much nearer the hand came since the measurement before
    nearer_limit_m: float
    beside_px: float | None  # from the box to the button's centre; 0: the box covers it
    beside_limit_px: float  # 0 for a press, the radius while pressed
    held_ns: int  # since the press; 0: not pressed
    gap_frames: int  # in a row without a measurement, before this frame
    approached_m: float | None  # how far the distance fell from its farthest in the last APPROACH_NS
    approach_limit_m: float  # a press needs at least this much
    elapsed_limit_ns: int = STALE_NS  # later, the camera paused
    held_limit_ns: int = SHORTEST_PRESS_NS  # shorter is no press; of one that was too long the longest
    gap_limit_frames: int = GAP_FRAMES  # more lose the hand; above 30 Hz, and after STALE_NS, as many as there were
    source: DistanceSource = DistanceSource.MONOCULAR  # of distance_m
    source_changed: bool = False  # since the measurement before: nothing is pressed or released


class ButtonState(Struct, frozen=True, kw_only=True):
    """The button after a frame. Counts only grow, so a lost report loses no release."""

    pressed: bool = False
    pressed_gesture: Gesture | None = None
    pressed_captured_ns: int = 0
    measured_near: bool = False  # since the frame that pressed, another one measured the hand within release_m
    release_count: int = 0
    released_gesture: Gesture | None = None
    released_recognised_ns: int = 0
    released_pressed_ns: int = 0
    released_ns: int = 0
    cancel_count: int = 0
    cancel_reason: PressCancel | None = None
    ready: bool = False  # the hand has been seen outside the threshold since the last release or cancel
    last_captured_ns: int = 0
    pressed_recognised_ns: int = 0
    far_gesture: Gesture | None = None  # voted while the hand was last outside: what a press may mean
    last_distance_m: float | None = None  # the newest measurement; None: none since the hand was lost
    gap_frames: int = 0  # frames in a row without a measurement
    approach: tuple[tuple[int, float], ...] = ()  # (captured_ns, distance_m) of the last APPROACH_NS, oldest first
    hint: PressHint | None = None  # why a hand that is near does not press
    source: DistanceSource | None = None  # of the newest measurement
    bridge_ratio: float | None = None  # newest depth over what the keypoints then measured; None: not both
    compared: ButtonComparison | None = None  # in the newest frame; None before the first


def advance(state: ButtonState, observed: ButtonInput, place: ButtonPlace, mode: ButtonMode) -> ButtonState:
    """The button after one more frame. A frame given twice changes nothing."""
    if observed.captured_ns == state.last_captured_ns:
        return state
    measured_m = _measured(observed)
    changed = measured_m is not None and state.source is not None and observed.source is not state.source
    if changed or observed.bridge_m is not None:
        state = _in_terms_of(state, observed, measured_m, changed=changed)
    compared = _compare(state, observed, place, changed=changed)
    after = _RULES[mode](state, observed, compared)
    if after.cancel_count > state.cancel_count and after.cancel_reason is PressCancel.TOO_LONG:
        compared = replace(compared, held_limit_ns=LONGEST_PRESS_NS)
    source = state.source if measured_m is None else observed.source
    return replace(after, last_captured_ns=observed.captured_ns, compared=compared, source=source)


def _in_terms_of(state: ButtonState, observed: ButtonInput, measured_m: float | None, *, changed: bool) -> ButtonState:
    """What was measured before, as the source of this frame would have measured it; forgotten where nobody knows."""
    now_m = observed.bridge_m
    ratio = measured_m / now_m if measured_m is not None and now_m is not None and now_m > 0 else state.bridge_ratio
    if not changed:
        return replace(state, bridge_ratio=ratio)
    if ratio is None:
        return replace(state, approach=(), last_distance_m=None)
    factor = ratio if observed.source is DistanceSource.DEPTH else 1 / ratio
    last_m = None if state.last_distance_m is None else state.last_distance_m * factor
    approach = tuple((captured_ns, metres * factor) for captured_ns, metres in state.approach)
    return replace(state, bridge_ratio=ratio, last_distance_m=last_m, approach=approach)


def _compare(state: ButtonState, observed: ButtonInput, place: ButtonPlace, *, changed: bool) -> ButtonComparison:
    elapsed_ns = observed.captured_ns - state.last_captured_ns if state.last_captured_ns else 0
    distance_m, previous_m = observed.distance_m, state.last_distance_m
    measured_m = _measured(observed)
    farthest_m = max((m for _, m in _recent(state, observed.captured_ns)), default=measured_m)
    unmeasured_ns = _unmeasured_ns(state, observed.captured_ns)
    return ButtonComparison(
        captured_ns=observed.captured_ns,
        elapsed_ns=elapsed_ns,
        distance_m=distance_m,
        previous_m=previous_m,
        threshold_m=place.threshold_m,
        release_m=_outside_m(place),
        nearer_m=None if previous_m is None or distance_m is None else previous_m - distance_m,
        nearer_limit_m=APPROACH_M_S * max(elapsed_ns, min(FRAME_NS, unmeasured_ns)) / 1e9,
        beside_px=observed.beside_px,
        beside_limit_px=place.radius_px if state.pressed else 0.0,
        held_ns=observed.captured_ns - state.pressed_captured_ns if state.pressed else 0,
        gap_frames=state.gap_frames,
        gap_limit_frames=state.gap_frames if unmeasured_ns > STALE_NS else max(GAP_FRAMES, state.gap_frames),
        approached_m=None if measured_m is None or farthest_m is None else max(farthest_m - measured_m, 0.0),
        approach_limit_m=APPROACH_SHARE * place.threshold_m,
        source=observed.source,
        source_changed=changed,
    )


def _published(state: ButtonState, observed: ButtonInput, compared: ButtonComparison) -> ButtonState:
    near = compared.distance_m is not None and compared.distance_m < compared.threshold_m
    pressed = near and compared.beside_px == 0.0
    if pressed == state.pressed or compared.source_changed:
        return replace(state, ready=True)
    return _press(state, observed) if pressed else _release(state, observed, observed.gesture or state.pressed_gesture)


def _robust(state: ButtonState, observed: ButtonInput, compared: ButtonComparison) -> ButtonState:
    if state.last_captured_ns and not 0 < compared.elapsed_ns <= STALE_NS:
        state = _end(state, PressCancel.CAMERA_PAUSED)
    elif compared.held_ns > LONGEST_PRESS_NS:
        state = _end(state, PressCancel.TOO_LONG)
    now_ns, distance_m = observed.captured_ns, _measured(observed)
    if state.gap_frames and _unmeasured_ns(state, now_ns) > STALE_NS:
        state = _lost(state, observed)
    if distance_m is None:
        return _gap(state, observed)
    state = replace(state, gap_frames=0, approach=(*_recent(state, now_ns), (now_ns, distance_m)))
    rule = _while_pressed if state.pressed else _while_up
    return replace(rule(state, observed, compared, distance_m), last_distance_m=distance_m)


def _while_pressed(
    state: ButtonState, observed: ButtonInput, compared: ButtonComparison, distance_m: float
) -> ButtonState:
    if observed.gesture is not state.pressed_gesture:
        return _end(state, PressCancel.GESTURE_CHANGED)
    if compared.beside_px is None or compared.beside_px > compared.beside_limit_px:
        return _end(state, PressCancel.LEFT_SIDEWAYS)
    if distance_m <= compared.release_m or compared.source_changed:
        own = not (compared.source_changed or observed.repeated)
        return replace(state, measured_near=state.measured_near or own)
    if compared.held_ns < SHORTEST_PRESS_NS or not state.measured_near:  # keypoints that slip near slip back
        return _end(state, PressCancel.TOO_SHORT)
    if compared.gap_frames:  # it hid the withdrawal: the next frame has to see the hand outside as well
        return state
    return _release(state, observed, state.pressed_gesture)


def _while_up(state: ButtonState, observed: ButtonInput, compared: ButtonComparison, distance_m: float) -> ButtonState:
    if compared.source_changed:
        return _at_change(state, compared, distance_m)
    if distance_m >= compared.threshold_m:
        if distance_m <= compared.release_m:
            return state
        return replace(state, ready=True, far_gesture=observed.gesture, hint=None)
    if not state.ready:
        return replace(state, hint=state.hint or PressHint.WITHDRAW_FIRST)
    reason = _no_press(state, observed, compared)
    if reason:
        return replace(state, ready=False, hint=reason)
    return _press(state, observed)


def _at_change(state: ButtonState, compared: ButtonComparison, distance_m: float) -> ButtonState:
    """A hand that only the former source saw outside has not been outside."""
    farthest_m = distance_m + (compared.approached_m or 0.0)
    if farthest_m >= compared.threshold_m or not state.ready:
        return state
    return replace(state, ready=False, hint=PressHint.WITHDRAW_FIRST)


def _no_press(state: ButtonState, observed: ButtonInput, compared: ButtonComparison) -> PressHint | None:
    """Why a hand that is near and was outside does not press; None when it does."""
    if compared.nearer_m is None or compared.nearer_m > compared.nearer_limit_m:  # not seen coming, or it slipped
        return PressHint.PUSH_STEADILY
    if compared.approached_m is None or compared.approached_m < compared.approach_limit_m:
        return PressHint.MORE_IMAGES if compared.elapsed_ns > APPROACH_NS else PressHint.APPROACH_FIRST
    if observed.gesture is None:
        return PressHint.GESTURE_FIRST
    settling = observed.replaced and observed.captured_ns - observed.recognised_ns < SETTLING_NS
    if observed.gesture is not state.far_gesture or settling:
        return PressHint.KEEP_GESTURE
    return None if compared.beside_px == 0.0 else PressHint.OVER_BUTTON


def _recent(state: ButtonState, now_ns: int) -> tuple[tuple[int, float], ...]:
    """The measurements of the last APPROACH_NS before this frame; a clock that went back leaves none."""
    return tuple(one for one in state.approach if 0 < now_ns - one[0] <= APPROACH_NS)


def _unmeasured_ns(state: ButtonState, now_ns: int) -> int:
    """How long ago the newest measurement was; negative, where none is known: then the frames count alone."""
    return now_ns - state.approach[-1][0] if state.approach else -1


def _gap(state: ButtonState, observed: ButtonInput) -> ButtonState:
    """A frame without a measurement: short gaps are blur, longer ones end the press and the readiness."""
    gap_frames = state.gap_frames + 1
    if not have_lasted(gap_frames, GAP_FRAMES + 1, _unmeasured_ns(state, observed.captured_ns)):
        return replace(state, gap_frames=gap_frames)
    return _lost(state, observed)


def _lost(state: ButtonState, observed: ButtonInput) -> ButtonState:
    """After too long a gap, which a frame with a measurement may end."""
    lost = PressCancel.HAND_LOST if observed.beside_px is None else PressCancel.DISTANCE_LOST
    return replace(_end(state, lost), last_distance_m=None)


def _press(state: ButtonState, observed: ButtonInput) -> ButtonState:
    return replace(
        state,
        pressed=True,
        measured_near=False,
        pressed_gesture=observed.gesture,
        pressed_captured_ns=observed.captured_ns,
        pressed_recognised_ns=observed.recognised_ns,
        ready=False,
        hint=None,
    )


def _release(state: ButtonState, observed: ButtonInput, gesture: Gesture | None) -> ButtonState:
    """Up again, by withdrawal: the command goes out, once. Without a gesture there is no command to give."""
    up = replace(state, pressed=False, pressed_gesture=None, ready=True, hint=None)
    if gesture is None:
        return up
    return replace(
        up,
        release_count=state.release_count + 1,
        released_gesture=gesture,
        released_recognised_ns=state.pressed_recognised_ns or observed.recognised_ns,
        released_pressed_ns=state.pressed_captured_ns,
        released_ns=observed.captured_ns,
    )


def _end(state: ButtonState, reason: PressCancel) -> ButtonState:
    """No longer ready, and no hint for a hand that may have left; a press is cancelled: no command, its reason kept."""
    state = replace(state, approach=(), hint=None)
    if not state.pressed:
        return replace(state, ready=False)
    return replace(
        state,
        pressed=False,
        pressed_gesture=None,
        ready=False,
        cancel_count=state.cancel_count + 1,
        cancel_reason=reason,
    )


def of_another_hand(state: ButtonState) -> ButtonState:
    """Without what only the hand before was seen doing; its press, if any, ends by the other one's empty vote."""
    return replace(
        state,
        ready=False,
        far_gesture=None,
        last_distance_m=None,
        approach=(),
        hint=None,
        source=None,
        bridge_ratio=None,
    )


def _measured(observed: ButtonInput) -> float | None:
    """The distance where there is a hand and a real one; 0, negative and non-finite are no measurement."""
    if observed.beside_px is None or observed.distance_m is None:
        return None
    return observed.distance_m if math.isfinite(observed.distance_m) and observed.distance_m > 0 else None


def is_near(state: ButtonState, place: ButtonPlace) -> bool:
    """Whether the hand is pressing or about to: there a gesture is held by more than three frames."""
    return state.pressed or (state.last_distance_m is not None and state.last_distance_m <= _outside_m(place))


def is_approaching(state: ButtonState, place: ButtonPlace) -> bool:
    """Whether the hand has come nearer, in the last APPROACH_NS, by half of what a press needs."""
    last_m = state.last_distance_m
    if last_m is None:
        return False
    nearer_m = max((distance_m for _, distance_m in state.approach), default=last_m) - last_m
    return nearer_m >= APPROACH_SHARE / 2 * place.threshold_m


def _outside_m(place: ButtonPlace) -> float:
    return place.threshold_m * (1 + HYSTERESIS)


_RULES: dict[ButtonMode, Callable[[ButtonState, ButtonInput, ButtonComparison], ButtonState]] = {
    ButtonMode.PUBLISHED: _published,
    ButtonMode.ROBUST: _robust,
}
