"""Every command's help is there in every language."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

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


def unexplained(part: object, path: str = "rleex") -> Iterator[str]:
    """Commands and parameters without a help."""
    assert isinstance(part, TyperCommand | TyperGroup)
    if not part.help:
        yield path
    yield from (f"{path} {one.name}" for one in part.params if not getattr(one, "help", None))
    for name, inner in getattr(part, "commands", {}).items():
        yield from unexplained(inner, f"{path} {name}")


def test_every_command_and_parameter_is_explained() -> None:
    assert list(unexplained(command())) == []


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


def test_what_typer_writes_around_a_help_is_translated(capsys: pytest.CaptureFixture[str]) -> None:
    use_language("zh")
    for arguments in (["profile", "--help"], ["profile", "set", "--help"]):
        command(arguments).main(arguments, prog_name="rleex", standalone_mode=False)
    shown = capsys.readouterr().out
    assert [word for word in ("Options", "Arguments", "Commands", "Show this message") if word in shown] == []
    assert all(word in shown for word in ("选项", "参数", "命令", "显示此帮助并退出"))


@pytest.mark.parametrize(("encoding", "shown"), [("latin-1", "\\u505c"), ("utf-8", "停")])
def test_an_encoding_without_a_character_gets_its_code(encoding: str, shown: str) -> None:
    command = [sys.executable, "-c", "from app.cli import main; main()", "evaluate", "voice", "--help"]
    paths = {"PYTHONPATH": str(Path(__file__).parents[3]), "PYTHONIOENCODING": encoding}
    done = subprocess.run(command, capture_output=True, env={**os.environ, **paths}, check=False)
    assert (done.returncode, done.stderr) == (0, b"")
    assert f'"stop" and {shown} stop' in done.stdout.decode(encoding)
