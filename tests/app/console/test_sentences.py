"""Control's and perception's words in the therapist's language, and the note on a push that gave nothing."""

from __future__ import annotations

from app.console.sentences import sentence
from app.console.state import NOTHING_PUSHED, READABLE_NS, note
from app.ipc.messages import TriggerReport
from app.text.catalogue import render, use_language
from kgdfa.button import PressCancel, PressHint
from logs.reason import reason

PUSH, LOST = reason(PressHint.PUSH_STEADILY), reason(PressCancel.HAND_LOST)


def test_what_the_catalogue_has_not_stays_as_it_was_said() -> None:
    for code in ("en", "zh"):
        use_language(code)
        assert sentence("Quite another thing.") == "Quite another thing."


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
    observed = note(NOTHING_PUSHED, _report(), 0)
    told = note(observed, _report(press_hint=PUSH), 10)
    assert note(told, _report(), READABLE_NS).said == render(PUSH)
    assert note(told, _report(), READABLE_NS + 11).said == ""
    assert note(told, _report(pressed=True), 20).said == ""


def test_a_cancel_is_told_once_and_an_old_one_of_before_is_not() -> None:
    observed = note(NOTHING_PUSHED, _report(cancel_count=3, cancel_reason=LOST), 0)
    assert observed.said == ""
    told = note(observed, _report(cancel_count=4, cancel_reason=LOST), 10)
    assert (told.said, told.cancelled) == (render(LOST), True)
    assert note(told, _report(cancel_count=4, cancel_reason=LOST), READABLE_NS + 20).said == ""
