"""Every command's help is there in every language."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import rich.text
import typer
from typer.core import TyperCommand, TyperGroup

from app.cli.tree import command, tree
from app.text.catalogue import languages, use_language


def helps(part: object) -> Iterator[str]:
    """The help of a command, of its parameters and of the commands in it."""
    assert isinstance(part, TyperCommand | TyperGroup)
    yield part.help or ""
    yield from (getattr(parameter, "help", None) or "" for parameter in part.params)
    for inner in getattr(part, "commands", {}).values():
        yield from helps(inner)


def test_brackets_in_a_help_are_shown() -> None:
    """Rich takes [inputs] for a style and leaves it out."""
    english = [text for text in helps(typer.main.get_command(tree())) if "[" in text]
    shown = [rich.text.Text.from_markup(text).plain for text in helps(command()) if "[" in text]
    assert "Its name in [[inputs]] of config.toml." in shown
    assert shown == english


@pytest.mark.parametrize("language", sorted(languages().keys() - {"en"}))
def test_every_help_is_translated(language: str) -> None:
    english = list(helps(command()))
    use_language(language)
    translated = list(helps(command()))
    assert len(english) == len(translated) > 150
    assert [text for text, other in zip(english, translated, strict=True) if text and text == other] == []
