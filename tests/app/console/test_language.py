"""Every language says everything."""

from __future__ import annotations

import ast
import re
import string
from collections import Counter
from collections.abc import Iterator
from enum import Enum
from pathlib import Path

import pytest

import app.console
from app.console import keys
from app.console.guidance import CHECKS
from app.console.patient_fields import FIELDS, SECTIONS, FieldFault, Kind
from app.ipc.states import Action, Effect, GaitState
from app.system.errors import AppError
from app.system.operators import Permission, Role
from app.text.catalogue import key_of, tr, use_language
from hal.joints.protocol import Joint
from kgdfa.gesture import Finger, FingerState, Gesture
from profiles.palm import ReferenceSource
from tests.support.catalogues import entries

CODES = ("en", "zh")  # complete; a language that is not falls back to English (test_third_language.py)


def fields_of(*forms: str) -> set[str]:
    """A plural form may leave the count out."""
    return {name for text in forms for _, name, _, _ in string.Formatter().parse(text) if name}


@pytest.mark.parametrize("code", CODES)
def test_each_language_has_the_same_names_and_gaps(code: str) -> None:
    english, other = entries("en"), entries(code)
    assert set(english) == {
        key for key in other if re.fullmatch(r"[\w.-]*\w", key)
    }  # else help, in English its own key
    assert {name for name in english if fields_of(*english[name]) != fields_of(*other[name])} == set()


@pytest.mark.parametrize("code", CODES)
def test_every_row_of_the_tables_is_there(code: str) -> None:
    text = entries(code)
    wanted = [
        key_of(member)
        for kind in (GaitState, Action, Effect, Gesture, Finger, Joint, Role, FieldFault, ReferenceSource)
        for member in kind
    ]
    wanted += [f"bind.{binding.id}" for binding in keys.ALL]
    wanted += [f"check.{check.name}.{part}" for check in CHECKS for part in ("name", "remedy")]
    wanted += [f"field.{field.path}" for field in FIELDS]
    wanted += [f"form.section.{section}" for section in SECTIONS]
    wanted += [key_of(one) for field in FIELDS if field.kind is Kind.CHOICE for one in _members(field.choices)]
    wanted += [f"training.{one.value}" for one in FingerState]
    asked_in_the_console = (Permission.OPERATE, Permission.EDIT_PATIENTS, Permission.CALIBRATE, Permission.REVIEW)
    wanted += [key_of(one) for one in asked_in_the_console]
    guide = {name.removeprefix("guide.") for name in text if name.startswith("guide.")}
    wanted += [f"watch.{name}" for name in guide]
    assert [name for name in wanted if name not in text] == [], f"texts of app/text/locales/{code}"


ROOMS = ("app", "hal", "kgdfa", "logs", "profiles")
ROOT = Path(app.console.__file__).parents[2]
SOURCES = [path.read_text(encoding="utf-8") for room in ROOMS for path in (ROOT / room).rglob("*.py")]
# Keys put together at run time, by what they begin with; every other key stands in a source as it is.
DYNAMIC = set(re.findall(r"""f["']([a-z0-9_.-]+\.)\{""", "\n".join(SOURCES))) | {
    "Record.",
    "sign_in.",
    "first.",
    "unlock.",
    "take_over.",
}
# Only trails of earlier programs hold them.
FORMER = {"PressCancel": {"WITHDRAWAL_UNSEEN"}, "RecordingFault": {"DISK", "DISK_LOW", "SLOW"}}


def enums() -> Iterator[tuple[str, set[str]]]:
    """Name and members of every Enum of the product."""
    for source in SOURCES:
        for node in ast.walk(ast.parse(source)):
            if isinstance(node, ast.ClassDef) and any("Enum" in ast.unparse(base) for base in node.bases):
                names = [name for line in node.body if isinstance(line, ast.Assign) for name in line.targets]
                yield node.name, {name.id for name in names if isinstance(name, ast.Name) and name.id.isupper()}


def enum_members() -> dict[str, set[str]]:
    """The members of every Enum of the product, by its name."""
    found: dict[str, set[str]] = {}
    for name, members in enums():
        found.setdefault(name, set()).update(members)
    return found


def test_no_wording_is_that_of_two_enums() -> None:
    keys = Counter(f"{name}.{member}" for name, members in enums() for member in members)
    assert {key for key, count in keys.items() if count > 1 and key in entries("en")} == set(), "rename an Enum"


def test_an_enum_that_has_text_has_it_for_each_member_and_no_other() -> None:
    members = enum_members()
    wording = {tuple(key.split(".")) for key in entries("en") if re.fullmatch(r"[A-Z]\w+\.[A-Z0-9_]+", key)}
    worded = {kind: {member for of, member in wording if of == kind} for kind, _ in wording if kind in members}
    wanted = {kind: members[kind] | FORMER.get(kind, set()) for kind in worded}
    assert worded == wanted, "in each catalogue of app/text/locales"


def test_every_literal_key_is_there() -> None:
    product = "\n".join(SOURCES)
    asked = set(re.findall(r'\btr\(\s*"([A-Za-z0-9_.-]+)"', product)) | set(re.findall(r'"(bind\.[\w.]+)"', product))
    asked |= {f"help.{page}" for page in re.findall(r'HELP_PAGE = "(\w+)"', product)}
    assert {"bind.cancel", "help.health", "machine.waiting"} <= asked
    assert asked - set(entries("en")) == set(), "texts of app/text/locales"


# Keys whose last part is put together too: `evaluate.plot.paper_3`.
COMPOSED = re.compile(
    r"borg\.\d+|key\.f12|patients\.(un)?archive_(title|text)|evaluate\.sequence\.\w+"
    r"|evaluate\.plot\.(ankle|paper|paper_title)_\w+|evaluate\.column\.(monocular|d435i|plain|squared)_\w+"
)


def parts_of_keys() -> set[str]:
    """What a key that is put together may end with: words of strings, classes, members of enums."""
    found = {member for members in enum_members().values() for member in members}
    found |= {member.lower() for member in found}
    for source in SOURCES:
        for node in ast.walk(ast.parse(source)):
            if isinstance(node, ast.ClassDef):
                found.add(node.name)
            elif isinstance(node, ast.Constant) and isinstance(node.value, str) and not node.value.endswith("."):
                found |= set(re.findall(r"[\w-]+", node.value))  # a docstring ends with a full stop
    templates = (path.read_text(encoding="utf-8") for room in ROOMS for path in (ROOT / room).rglob("*.j2"))
    return found | {word for template in templates for word in re.findall(r"[\w-]+", template)}


def test_no_key_is_unused() -> None:
    literal = {key for source in SOURCES for key in re.findall(r"""["']([a-z0-9_.-]+)["']""", source)}
    members = re.compile(r"[A-Z]\w+\.[A-Z0-9_]+")
    unused = {key for key in set(entries("en")) - literal if not members.fullmatch(key)}
    parts = parts_of_keys()
    used = {key for key in unused if COMPOSED.fullmatch(key) or key.rpartition(".")[2] in parts}
    assert {key for key in unused if not key.startswith(tuple(DYNAMIC))} == set()
    assert unused - used == set()


NAMED_KEYS = re.compile(
    r"acknowledge\.text|check\.(clear|patient|stop_inputs|vocabulary)\.remedy|distance\.proposed|picture\.paused"
    r"|help\.(session|patients|stop)|patients\.(search|title)|sign_in\.may_not|sign_out\.session"
    r"|VocabularyStatus\..*|Event\.NO_PREFLIGHT"
)


@pytest.mark.parametrize("code", CODES)
def test_a_key_that_can_be_remapped_is_named_by_its_place_in_the_table(code: str) -> None:
    letter = re.compile(r"(?<![A-Za-z{'])[b-z](?![A-Za-z}])|\bF\d|(?<= )/(?= )|space bar|空格", re.ASCII)
    found = {key: texts for key, texts in entries(code).items() if NAMED_KEYS.fullmatch(key)}
    assert len(found) > 15
    assert {key: letter.findall(text) for key, texts in found.items() for text in texts if letter.search(text)} == {}
    named = {name for texts in found.values() for name in fields_of(*texts)}
    assert {"stop", "acknowledge", "confirm", "patients_search", "patients_vocabulary", "sign_out"} <= named


def test_an_unknown_language_names_those_that_exist() -> None:
    with pytest.raises(AppError, match=r"NO_SUCH_LANGUAGE .*en, zh"):
        use_language("xx")


def test_a_language_takes_effect_at_once() -> None:
    use_language("zh")
    assert tr("bind.help") == "帮助"


def _members(choices: type[Enum] | None) -> list[Enum]:
    return [] if choices is None else list(choices)
