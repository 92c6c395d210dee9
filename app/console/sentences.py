"""Sentences that perception says in English, in the therapist's language.

Sentences are found by pattern. `{…}` stands for what is kept as it is, unless its
name begins with one of `_HOLES`: an action, a state, a gesture or a finger is said in its own words, `{said}` is a part
that has a pattern of its own. What the language file has not is shown as it was said: an English sentence helps more
than none. The files are `locales/sentences/<language>.toml`.
"""

from __future__ import annotations

import re
import tomllib
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


def sentence(said: str) -> str:
    """A refusal, a hint, a reason: in the therapist's language where it is known."""
    return _said_in(language(), said)


@lru_cache(maxsize=1024)  # the panels ask for the same few twenty times a second
def _said_in(language: str, said: str) -> str:
    for pattern, words in _patterns(language):
        found = pattern.fullmatch(said)
        if found is not None:
            return words.format(**{name: _term(name, value) for name, value in found.groupdict().items()})
    return said


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
def _patterns(language: str) -> tuple[tuple[re.Pattern[str], str], ...]:
    path = _FOLDER / f"{language}.toml"
    if not path.exists():
        return ()
    read = tomllib.loads(path.read_text(encoding="utf-8"))
    return tuple((_pattern(str(one["said"])), str(one["words"])) for one in read["sentence"])


def _pattern(said: str) -> re.Pattern[str]:
    return re.compile(_HOLE.sub(lambda hole: f"(?P<{hole[1]}>{_held(hole[1])})", re.escape(said)))


def _held(name: str) -> str:
    return next((pattern for prefix, pattern in _HOLES.items() if name.startswith(prefix)), ".+?")
