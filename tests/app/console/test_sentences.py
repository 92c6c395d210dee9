"""Control's and perception's words in the therapist's language, and the note on a push that gave nothing."""

from __future__ import annotations

import ast
import inspect
import re
from types import ModuleType

import pytest

from app.console.sentences import sentence
from app.console.state import NOTHING_PUSHED, READABLE_NS, note
from app.ipc.messages import TriggerReport
from app.text.catalogue import use_language
from kgdfa import button
from kgdfa.features import FEATURES, Feature
from logs.reason import plain

_LETTERS = re.compile("[A-Za-z]{2,}")


def _said_by(module: ModuleType) -> set[str]:
    """Every sentence in the code of a module that is not a docstring: literal strings of three words and more."""
    tree = ast.parse(inspect.getsource(module))
    docs = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    parts = {id(part) for node in ast.walk(tree) if isinstance(node, ast.JoinedStr) for part in node.values}
    return {
        node.value
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docs | parts
        if len(node.value.split()) >= 4
    } | {f"the {what} during the press" for what in ("hand was lost", "distance was lost")}


@pytest.mark.parametrize("feature", FEATURES, ids=lambda feature: feature.text)
def test_every_measure_of_a_hand_is_said_in_chinese(feature: Feature) -> None:
    use_language("zh")
    said = sentence(f"not 4: {feature.text} 0.74{feature.unit.value} > 0.53")
    assert said.startswith("不是 4：")
    assert "0.74" in said
    assert said.endswith(" > 0.53")
    assert not _LETTERS.search(said), said


@pytest.mark.parametrize(
    "said",
    ["4, not none of them", "4: closest call thumb open, 74° > 53°", "not 4: too near to 5", "not 0: tip 8 inside the "
     "inner hull", "not 6: tips 4 and 20 apart 80.0 ≤ 100 px", "not rock: too near to none of them"],
)  # fmt: skip
def test_every_kind_of_explanation_is_said_in_chinese(said: str) -> None:
    use_language("zh")
    assert not _LETTERS.search(sentence(said).replace("rock", "")), sentence(said)


@pytest.mark.parametrize("reason", sorted(_said_by(button)))
def test_everything_that_the_button_says_is_said_in_chinese(reason: str) -> None:
    use_language("zh")
    assert not _LETTERS.search(sentence(reason)), sentence(reason)


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
    seen = note(NOTHING_PUSHED, _report(), 0)
    told = note(seen, _report(press_hint=plain("push steadily")), 10)
    assert note(told, _report(), READABLE_NS).said == "push steadily"
    assert note(told, _report(), READABLE_NS + 11).said == ""
    assert note(told, _report(pressed=True), 20).said == ""


def test_a_cancel_is_told_once_and_an_old_one_of_before_is_not() -> None:
    seen = note(NOTHING_PUSHED, _report(cancel_count=3, cancel_reason=plain("old")), 0)
    assert seen.said == ""
    told = note(seen, _report(cancel_count=4, cancel_reason=plain("the hand was lost")), 10)
    assert (told.said, told.cancelled) == ("the hand was lost", True)
    assert note(told, _report(cancel_count=4, cancel_reason=plain("the hand was lost")), READABLE_NS + 20).said == ""
