"""Every language says everything."""

from __future__ import annotations

import re
import string
from enum import Enum
from pathlib import Path

import pytest

import app.console
from app.console import keys
from app.console.guidance import CHECKS
from app.console.patient_fields import FIELDS, SECTIONS, FieldFault
from app.ipc.states import Action, Effect, GaitState
from app.system.errors import AppError
from app.system.operators import Permission, Role
from app.text.catalogue import key_of, languages, tr, use_language
from app.text.compile import entries
from hal.joints.protocol import Joint
from kgdfa.gesture import Finger, FingerState, Gesture
from profiles.palm import ReferenceSource

CODES = tuple(languages())


def fields_of(*forms: str) -> set[str]:
    """A plural form may leave the count out."""
    return {name for text in forms for _, name, _, _ in string.Formatter().parse(text) if name}


@pytest.mark.parametrize("code", CODES)
def test_each_language_has_the_same_names_and_gaps(code: str) -> None:
    english, other = entries("en"), entries(code)
    assert set(english) == set(other)
    assert {name for name in english if fields_of(*english[name]) != fields_of(*other[name])} == set()


@pytest.mark.parametrize("code", CODES)
def test_every_word_of_the_tables_is_there(code: str) -> None:
    words = entries(code)
    wanted = [
        key_of(member)
        for kind in (GaitState, Action, Effect, Gesture, Finger, Joint, Role, FieldFault, ReferenceSource)
        for member in kind
    ]
    wanted += [f"bind.{binding.id}" for binding in keys.ALL]
    wanted += [f"check.{check.name}.{part}" for check in CHECKS for part in ("name", "remedy")]
    wanted += [f"field.{field.path}" for field in FIELDS]
    wanted += [f"form.section.{section.name}" for section in SECTIONS]
    wanted += [key_of(one) for field in FIELDS for one in _members(field.choices)]
    wanted += [f"training.{one.value}" for one in FingerState]
    asked_in_the_console = (Permission.OPERATE, Permission.EDIT_PATIENTS, Permission.CALIBRATE, Permission.REVIEW)
    wanted += [key_of(one) for one in asked_in_the_console]
    guide = {name.removeprefix("guide.") for name in words if name.startswith("guide.")}
    wanted += [f"watch.{name}" for name in guide]
    assert [name for name in wanted if name not in words] == []


def test_every_word_that_the_console_asks_for_is_there() -> None:
    """Literal names in the console's sources; names put together at run time are in the test above."""
    folder = Path(app.console.__file__).parent
    sources = [path for path in folder.rglob("*.py") if not path.name.startswith("review")]
    asked = {name for path in sources for name in re.findall(r'\btr\("([a-z0-9_.]+)"', path.read_text())}
    assert asked
    assert asked - set(entries("en")) == set()


def test_an_unknown_language_names_those_that_exist() -> None:
    with pytest.raises(AppError, match=r"NO_SUCH_LANGUAGE .*en, zh"):
        use_language("xx")


def test_a_language_takes_effect_at_once() -> None:
    use_language("zh")
    assert tr("bind.help") == "帮助"


def _members(choices: type[Enum] | None) -> list[Enum]:
    return [] if choices is None else list(choices)
