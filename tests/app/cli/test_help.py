"""Every command's help is there in every language."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from typer.core import TyperCommand, TyperGroup

from app.cli.tree import command
from app.text.catalogue import languages, use_language


def helps(part: TyperCommand | TyperGroup) -> Iterator[str]:
    """The help of a command, of its parameters and of the commands in it."""
    yield part.help or ""
    yield from (getattr(parameter, "help", None) or "" for parameter in part.params)
    for inner in getattr(part, "commands", {}).values():
        assert isinstance(inner, TyperCommand | TyperGroup)
        yield from helps(inner)


@pytest.mark.parametrize("language", sorted(languages().keys() - {"en"}))
def test_every_help_is_translated(language: str) -> None:
    english = list(helps(command()))
    use_language(language)
    translated = list(helps(command()))
    assert len(english) == len(translated) > 150
    assert [text for text, other in zip(english, translated, strict=True) if text and text == other] == []
