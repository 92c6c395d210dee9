"""The virtual button: pressed by a hand that comes near, released by one that withdraws, cancelled by all else.

`published` is the paper's rule, literally: pressed while the hand is nearer than the threshold and its bounding
box covers the button, else released, and every release commands. `robust` presses only a hand that was seen
outside the threshold and crossed it with a voted gesture over the button, and commands only when that hand
withdraws; any other end of a press is a cancel with its reason. In the frame in which another source begins to measure
(depth, or the keypoints that bridge its holes) nothing is pressed, released or made ready; what was measured before is
put in the new source's terms, so that only the hand's own movement counts as an approach.
"""

from __future__ import annotations

from collections.abc import Callable

from msgspec.structs import replace

from kgdfa.button_state import (
    APPROACH_M_S,
    APPROACH_NS,
    APPROACH_SHARE,
    GAP_FRAMES,
    LONGEST_PRESS_NS,
    SHORTEST_PRESS_NS,
    STALE_NS,
    ButtonComparison,
    ButtonInput,
    ButtonMode,
    ButtonPlace,
    ButtonState,
    PressCancel,
    PressHint,
)
from kgdfa.distance import DistanceSource
from kgdfa.frame_time import FRAME_NS, have_lasted
from kgdfa.gesture import SETTLING_NS, Gesture


def advance(state: ButtonState, observed: ButtonInput, place: ButtonPlace, mode: ButtonMode) -> ButtonState:
    """The button after one more frame. A frame given twice changes nothing."""
    if observed.captured_ns == state.last_captured_ns:
        return state
    measured_m = observed.measured_m
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
    measured_m = observed.measured_m
    farthest_m = max((m for _, m in _recent(state, observed.captured_ns)), default=measured_m)
    unmeasured_ns = _unmeasured_ns(state, observed.captured_ns)
    return ButtonComparison(
        captured_ns=observed.captured_ns,
        elapsed_ns=elapsed_ns,
        distance_m=distance_m,
        previous_m=previous_m,
        threshold_m=place.threshold_m,
        release_m=place.release_m,
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
    now_ns, distance_m = observed.captured_ns, observed.measured_m
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
        if not state.ready:  # the near ones had their answer
            state = replace(state, ready=True, approach=state.approach[-1:])
        hint = PressHint.PUSH_NEARER if _turned_back(state, observed, compared, distance_m) else None
        return replace(state, far_gesture=observed.gesture, hint=hint)
    if not state.ready:
        return replace(state, hint=state.hint or PressHint.WITHDRAW_FIRST)
    reason = _no_press(state, observed, compared)
    if reason:
        return replace(state, ready=False, hint=reason)
    return _press(state, observed)


def _turned_back(state: ButtonState, observed: ButtonInput, compared: ButtonComparison, distance_m: float) -> bool:
    """Whether a hand with a gesture came into the hysteresis and withdraws as from a push, which pressed nothing."""
    nearest_m = min(m for _, m in state.approach)
    withdrawn = distance_m - nearest_m >= compared.approach_limit_m
    return observed.gesture is not None and nearest_m <= compared.release_m and withdrawn


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
    if observed.gesture is not state.far_gesture or settling or observed.contradicted:
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
    up = replace(state, pressed=False, pressed_gesture=None, ready=True, approach=state.approach[-1:], hint=None)
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


_RULES: dict[ButtonMode, Callable[[ButtonState, ButtonInput, ButtonComparison], ButtonState]] = {
    ButtonMode.PUBLISHED: _published,
    ButtonMode.ROBUST: _robust,
}
