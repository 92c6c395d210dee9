"""Sentences that control and perception say in English, in the therapist's language.

Events are found by their name, every other sentence by its pattern. `{…}` stands for what is kept as it is, unless its
name begins with one of `_HOLES`: an action, a state, a gesture or a finger is said in its own words, `{said}` is a part
that has a pattern of its own. What the language file has not is shown as it was said: an English sentence helps more
than none. The files are `locales/sentences/<language>.toml`.
"""

from __future__ import annotations

import re
import tomllib
from dataclasses import dataclass
from enum import Enum
from functools import cache, lru_cache
from pathlib import Path

from app.ipc.states import Action, GaitState
from app.text.catalogue import language, tr
from kgdfa.gesture import Finger, Gesture

_FOLDER = Path(__file__).with_name("locales") / "sentences"
_HOLE = re.compile(r"\\\{(\w+)\\\}")
# What a hole may hold, by how its name begins; any other holds anything.
_HOLES = {
    "number": r"[-+]?[\d.]+°?",
    "finger": "|".join(one.name.lower() for one in Finger),
    "gesture": "|".join(one.value for one in Gesture),
}
_DETAIL = re.compile(r"\s*\(([^()]*)\)$")


@dataclass(frozen=True, slots=True)
class _Catalogue:
    """Of one language: events by name, other sentences by pattern."""

    events: dict[str, str]
    patterns: tuple[tuple[re.Pattern[str], str], ...]


def learn_events() -> None:
    """Load control's table of events, which brings numpy: before a sentence asks for it."""
    _event_names()


def event_words(name: str, said: str) -> str:
    """An event by its name; the numbers in brackets at the end of what control said are kept."""
    words = _catalogue(language()).events.get(name)
    if words is None:
        return said
    detail = _DETAIL.search(said)
    return f"{words} ({sentence(detail[1])})" if detail else words


def sentence(said: str) -> str:
    """A refusal, a hint, a reason: in the therapist's language where it is known."""
    return _said_in(language(), said)


@lru_cache(maxsize=1024)  # the panels ask for the same few twenty times a second
def _said_in(language: str, said: str) -> str:
    catalogue = _catalogue(language)
    for pattern, words in catalogue.patterns:
        found = pattern.fullmatch(said)
        if found is not None:
            return words.format(**{name: _term(name, value) for name, value in found.groupdict().items()})
    return _event_by_sentence(catalogue, said)


def _event_by_sentence(catalogue: _Catalogue, said: str) -> str:
    """A refusal that quotes an event of control."""
    if not catalogue.events:
        return said
    detail = _DETAIL.search(said)
    name = _event_names().get(_DETAIL.sub("", said))
    if name is None or name not in catalogue.events:
        return said
    return catalogue.events[name] + (f" ({sentence(detail[1])})" if detail else "")


def _term(name: str, value: str) -> str:
    """What a hole of this name held, in the language."""
    if name.startswith("said"):
        return sentence(value)
    if name.startswith("finger"):
        return tr(Finger[value.upper()])
    terms: tuple[tuple[type[Enum], str], ...] = ((Action, "action"), (GaitState, "state"), (Gesture, "gesture"))
    for kind, prefix in terms:
        if name.startswith(prefix):
            for one in kind:
                if one.value == value:
                    return tr(one)
    return value


@cache
def _catalogue(language: str) -> _Catalogue:
    path = _FOLDER / f"{language}.toml"
    if not path.exists():
        return _Catalogue({}, ())
    read = tomllib.loads(path.read_text(encoding="utf-8"))
    patterns = tuple((_pattern(str(one["said"])), str(one["words"])) for one in read["sentence"])
    return _Catalogue({str(name): str(words) for name, words in read["event"].items()}, patterns)


def _pattern(said: str) -> re.Pattern[str]:
    return re.compile(_HOLE.sub(lambda hole: f"(?P<{hole[1]}>{_held(hole[1])})", re.escape(said)))


def _held(name: str) -> str:
    return next((pattern for prefix, pattern in _HOLES.items() if name.startswith(prefix)), ".+?")


@cache
def _event_names() -> dict[str, str]:
    from app.control.events.table import TABLE  # its facts bring numpy: only for who needs it

    return {row.text: row.event.value for row in TABLE}
