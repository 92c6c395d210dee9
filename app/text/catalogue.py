"""Text in the language in use: gettext catalogues, one a room, looked up by code and filled with values.

Messages have keys as msgid (`Refusal.NOT_ARMED`, `stop.idle`), so English is a catalogue like any other. Values are
SI; a message converts them by its format: `{angle_rad:deg}`, `{distance_m:cm.1}`, `{share:percent}`. A message with a
plural form is chosen by its value `count`.
"""

from __future__ import annotations

import gettext
from collections.abc import Mapping, Sequence
from enum import Enum
from functools import cache, lru_cache
from math import degrees
from pathlib import Path
from string import Formatter
from typing import Any

from app.system.errors import AppError
from logs.reason import Reason, key_of, reason_of

__all__ = [
    "ask_language",
    "be_strict",
    "key_of",
    "knows",
    "language",
    "languages",
    "load",
    "render",
    "tr",
    "use_configured",
    "use_language",
]

LOCALES = Path(__file__).with_name("locales")
COMPLETE = "en"  # the language that has every message
# Of each unit a message may ask for: from SI, and the digits shown unless it says otherwise.
_UNITS = {
    "deg": (degrees, 0),
    "cm": (lambda m: m * 100, 0),
    "mm": (lambda m: m * 1000, 0),
    "percent": (lambda x: x * 100, 0),
    "ns_as_ms": (lambda ns: ns / 1e6, 3),
}


class TextFault(Enum):
    """Why a language can't be used."""

    NO_SUCH_LANGUAGE = "no such language"
    NOT_COMPILED = "not compiled"


class MissingTextError(LookupError):
    """A key that no catalogue has. Raised only while `strict` is set, as the tests do."""


class _State:
    language = "en"
    asked = ""  # on the command line; goes before the configuration's
    strict = False


@cache
def languages() -> dict[str, str]:
    """Code → the language's own name, of every catalogue."""
    return {folder.name: load(folder.name).gettext("language.name") for folder in sorted(LOCALES.iterdir())}


def use_language(wanted: str) -> None:
    """Speak this language from now on. Raises AppError naming those that exist."""
    known = sorted(folder.name for folder in LOCALES.iterdir())  # the others' catalogues stay unread
    if wanted not in known:
        raise AppError(TextFault.NO_SUCH_LANGUAGE, language=wanted, known=", ".join(known))
    load(wanted)
    _State.language = wanted


def ask_language(wanted: str) -> None:
    """Speak this language whatever the configuration names; empty: the configuration's. Raises as `use_language`."""
    if wanted:
        use_language(wanted)
    _State.asked = wanted


def use_configured(configured: str) -> None:
    """Speak the configuration's language, unless another was asked for. Raises as `use_language`."""
    use_language(_State.asked or configured)


def language() -> str:
    """The code of the language in use."""
    return _State.language


def be_strict(on: bool = True) -> None:
    """Raise for a missing key instead of showing it: a gap fails a test, never a session."""
    _State.strict = on


def knows(key: str) -> bool:
    """Whether the language in use has this key; the empty one is a catalogue's own header."""
    return bool(key) and load(_State.language).gettext(key) != key


def tr(key: str | Enum, /, **values: object) -> str:
    """The text of a key, or of an Enum member, with values put in."""
    wanted = key_of(key) if isinstance(key, Enum) else key
    count = values.get("count")
    text = load(_State.language).ngettext(wanted, wanted, count) if isinstance(count, int) else wanted
    text = _message(_State.language, wanted) if text == wanted else text  # no plural form
    if text == wanted:
        return _missing(wanted, values)
    if not values and "{" not in text:
        return text
    try:
        return _FORMATTER.vformat(text, (), values)
    except (LookupError, ValueError, TypeError, AttributeError):  # a recording's values, of another version's wording
        if _State.strict:
            raise
        return _missing(wanted, values)


def render(what: object) -> str:
    """A reason, a code, or an object with code and values (an error, an explanation), as text."""
    if isinstance(what, Enum):
        return tr(what)
    if isinstance(what, BaseException) and not isinstance(getattr(what, "code", None), Enum):
        return str(what)  # until every error carries an Enum's member
    found = what if isinstance(what, Reason) else reason_of(what)
    return tr(found.code, **found.values)


@cache
def load(code: str) -> gettext.NullTranslations:
    """All catalogues of a language as one; what it lacks, English says. Raises AppError when none was compiled."""
    files = sorted((LOCALES / code / "LC_MESSAGES").glob("*.mo"))
    if not files:
        raise AppError(TextFault.NOT_COMPILED, language=code)
    first, *others = (_read(file) for file in files)
    for other in others:
        first.add_fallback(other)
    if code != COMPLETE:
        first.add_fallback(load(COMPLETE))
    return first


@lru_cache(maxsize=4096)
def _message(code: str, key: str) -> str:
    """As gettext finds it, which asks one catalogue after the other: a screen shows the same hundred all the time."""
    return load(code).gettext(key)


def _read(file: Path) -> gettext.GNUTranslations:
    with file.open("rb") as opened:
        return gettext.GNUTranslations(opened)


def _missing(key: str, values: dict[str, object]) -> str:
    if _State.strict:
        raise MissingTextError(f"no text for {key} {values} in app/text/locales/{_State.language}")
    return " ".join([key, *(f"{name}={_text(value)}" for name, value in values.items())])


def _text(value: object) -> str:
    if isinstance(value, Enum | Reason | BaseException) or isinstance(getattr(value, "code", None), Enum):
        return render(value)
    if isinstance(value, tuple | list):
        return tr("list.separator").join(_text(each) for each in value)
    return str(value)


_ABSENT = object()  # the detail of an event that had none in an older trail


class _Units(Formatter):
    """`str.format` with units, with codes inside, and `{detail:in_brackets}` for what may be empty."""

    def get_value(self, key: int | str, args: Sequence[Any], kwargs: Mapping[str, Any]) -> object:
        return kwargs.get(key, _ABSENT) if key == "detail" else super().get_value(key, args, kwargs)

    def format_field(self, value: object, format_spec: str) -> str:
        if format_spec == "in_brackets":
            text = "" if value is _ABSENT else _text(value).rstrip(".。")
            return tr("text.in_brackets", text=text) if text else ""
        if value is _ABSENT:
            raise KeyError("detail")
        unit, _, digits = format_spec.partition(".")
        if unit in _UNITS and isinstance(value, int | float):
            convert, usual = _UNITS[unit]
            return f"{convert(value):.{int(digits or usual)}f}"
        if isinstance(value, int | float) and not isinstance(value, Enum):
            return format(value, format_spec)
        return _text(value)  # formats are for numbers: what was not measured is shown as it is


_FORMATTER = _Units()
