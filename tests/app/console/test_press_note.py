"""The note on a push that gave no command."""

from __future__ import annotations

import pytest

from app.console.state import NO_NOTE, READABLE_NS, note
from app.console.widgets.gesture import _figure, gesture_lines
from app.console.widgets.panel import cells
from app.ipc.messages import TriggerReport
from app.perception.camera import PerceptionNote
from app.text.catalogue import render
from kgdfa.button_state import PressCancel, PressHint
from kgdfa.continuity import Jump
from kgdfa.gesture import HandRefusal
from logs.reason import reason
from tests.app.console.test_sizes import with_report

PUSH, LOST = reason(PressHint.PUSH_STEADILY), reason(PressCancel.HAND_LOST)


def _report(**more: object) -> TriggerReport:
    base: dict[str, object] = {
        "incarnation": 1,
        "sequence": 1,
        "captured_ns": 0,
        "sent_ns": 0,
        "hand": True,
        "gesture": None,
    }
    return TriggerReport(**(base | more))  # type: ignore[arg-type]


def test_a_hint_stays_to_be_read_until_time_or_a_press_wipes_it_out() -> None:
    seen = note(NO_NOTE, _report(), 0)
    noted = note(seen, _report(press_hint=PUSH), 10)
    assert note(noted, _report(), READABLE_NS).reason == PUSH
    assert note(noted, _report(), READABLE_NS + 11).reason is None
    assert note(noted, _report(pressed=True), 20).reason is None


def test_a_cancel_is_noted_once_and_an_old_one_of_before_is_not() -> None:
    seen = note(NO_NOTE, _report(cancel_count=3, cancel_reason=LOST), 0)
    assert seen.reason is None
    noted = note(seen, _report(cancel_count=4, cancel_reason=LOST), 10)
    assert (noted.reason, noted.cancelled) == (LOST, True)
    assert note(noted, _report(cancel_count=4, cancel_reason=LOST), READABLE_NS + 20).reason is None


@pytest.mark.parametrize(("width", "mark"), [(60, "lens assumed"), (26, "≈")])
def test_an_assumed_focal_length_is_marked_beside_the_distance(width: int, mark: str) -> None:
    for assumed in (True, False):
        figure = _figure(
            _report(safe_distance_m=0.32, distance_m=0.3, distance_sd_m=0.01, focal_assumed=assumed), width
        )
        text = "".join(part for part, _ in figure)
        assert (mark in text) is assumed
        assert cells(text) <= width


def test_a_calibration_that_is_not_in_use_hides_no_explanation() -> None:
    why, hint = reason(HandRefusal.JUMPED, jump=Jump.UNSEEN), reason(PerceptionNote.CALIBRATION_UNUSED, camera="webcam")
    for hand, shown in ((True, why), (False, hint)):
        state = with_report(hand=hand, gesture=None, hand_refusal=None, explanation=why, hint=hint)
        ((text, _),) = gesture_lines(state, 200)[-1]
        assert text == render(shown)
