"""The console's words: one TOML a language under `locales/`, looked up by dotted name."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from functools import cache
from pathlib import Path

from app.system.errors import AppError

_LOCALES = Path(__file__).with_name("locales")
_current: dict[str, str] = {}
_code = "en"


def languages() -> dict[str, str]:
    """Code → the language's own name, of every language file."""
    return {path.stem: words_of(path.stem)["language.name"] for path in sorted(_LOCALES.glob("*.toml"))}


def use_language(wanted: str) -> None:
    """Speak this language from now on. Raises AppError naming those that exist."""
    global _code, _current
    if not (_LOCALES / f"{wanted}.toml").exists():
        known = ", ".join(sorted(path.stem for path in _LOCALES.glob("*.toml")))
        raise AppError(f"There is no language {wanted!r}; set `language` in the configuration to one of {known}.")
    _code, _current = wanted, words_of(wanted)


def code() -> str:
    """The language that is spoken."""
    return _code


def tr(name: str, /, **values: object) -> str:
    """The words called `name`, with values put in; the name itself where there are none."""
    words = (_current or words_of("en")).get(name, name)
    return words.format(**values) if values else words


def knows(name: str) -> bool:
    """Whether the language has words of this name."""
    return name in (_current or words_of("en"))


@cache
def words_of(code: str) -> dict[str, str]:
    """Every name and its words in one language."""
    return dict(_flatten("", tomllib.loads((_LOCALES / f"{code}.toml").read_text(encoding="utf-8"))))


def _flatten(prefix: str, table: Mapping[str, object]) -> list[tuple[str, str]]:
    found: list[tuple[str, str]] = []
    for key, value in table.items():
        if isinstance(value, Mapping):
            found += _flatten(f"{prefix}{key}.", value)
        else:
            found.append((f"{prefix}{key}", str(value)))
    return found
