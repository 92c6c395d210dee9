"""A command line that is not understood: one sentence in the language in use, and exit status 2."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer
from typer.core import TyperCommand, TyperGroup

from app.cli import main, tree
from app.text.catalogue import tr, use_language

WRONG: dict[str, tuple[str, dict[str, object]]] = {
    "demo --seed x": ("WHOLE_NUMBER", {"parameter": "--seed", "value": "x"}),
    "demo --seed 1.5": ("WHOLE_NUMBER", {"parameter": "--seed", "value": "1.5"}),
    "demo --load -1": ("TOO_SMALL", {"parameter": "--load", "value": "-1", "least": 0}),
    "demo --joints foo": ("ONE_OF", {"parameter": "--joints", "value": "foo", "known": "simulated, can"}),
    "demo --nosuch": ("NO_SUCH_OPTION", {"option": "--nosuch"}),
    "demo one": ("TOO_MANY", {}),
    "demo --record=3": ("OPTION_VALUE", {"option": "--record"}),
    "run --patient": ("OPTION_VALUE", {"option": "--patient"}),
    "evaluate idle --left-out nan": ("NUMBER", {"parameter": "--left-out", "value": "nan"}),
    "evaluate idle --left-out 7": ("TOO_LARGE", {"parameter": "--left-out", "value": "7", "most": 0.9}),
    "profile show": ("MISSING", {"parameter": "PATIENT"}),
    "audit nosuch": ("NO_SUCH_COMMAND", {"name": "nosuch"}),
    "nosuch": ("NO_SUCH_COMMAND", {"name": "nosuch"}),
}


def status_of(monkeypatch: pytest.MonkeyPatch, line: str) -> int:
    monkeypatch.setattr(sys, "argv", ["rleex", *line.split()])
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0)


@pytest.mark.parametrize("language", ["en", "zh"])
@pytest.mark.parametrize("line", WRONG)
def test_it_is_refused_in_one_sentence_that_names_what_is_wrong(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], line: str, language: str
) -> None:
    assert status_of(monkeypatch, f"--language {language} {line}") == 2
    code, values = WRONG[line]
    words = [word for word in line.split() if not word.startswith("-")]
    known = {"profile", "show", "audit", "evaluate", "idle", "demo", "run"}
    path = " ".join(["rleex", *(word for word in words if word in known)])
    use_language(language)
    expected = tr(f"UsageFault.{code}", help=f"`{path} --help`", **values)
    assert capsys.readouterr() == ("", f"rleex: {expected}\n")


def test_a_folder_of_data_that_is_not_there_is_named(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    data, out = tmp_path / "data", tmp_path / "out"
    assert status_of(monkeypatch, f"evaluate paper --data {data} --out {out}") == 2
    assert capsys.readouterr() == ("", f"rleex: There is no folder {data}. Name one that is there.\n")
    assert not out.exists()


def parameters(part: TyperCommand | TyperGroup) -> Iterator[Any]:
    yield from part.params
    for inner in getattr(part, "commands", {}).values():
        yield from parameters(inner)


def test_no_parameter_can_be_refused_in_another_way() -> None:
    """A new kind of parameter needs its sentence."""
    descriptors = [parameter.type_descriptor for parameter in parameters(tree.command())]
    assert not any(one.parameter_info.exists for one in descriptors)
    kinds = {one.annotation for one in descriptors if one.choices is None}
    never_refused = {Path, str, bool, list[str], list[Path]}
    assert kinds - never_refused == {int, float}


def test_a_question_without_an_answer_ends_with_a_word_in_the_language_in_use(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def asked() -> None:
        raise typer.Abort

    built = typer.Typer()
    built.command()(asked)
    monkeypatch.setattr(tree, "command", lambda _: typer.main.get_command(built))
    assert status_of(monkeypatch, "--language zh") == 1
    assert capsys.readouterr() == ("", "rleex: 已取消。\n")


def test_a_commands_own_exit_status_is_the_programs(monkeypatch: pytest.MonkeyPatch) -> None:
    def tampered() -> None:
        raise typer.Exit(1)

    built = typer.Typer()
    built.command()(tampered)
    monkeypatch.setattr(tree, "command", lambda _: typer.main.get_command(built))
    assert status_of(monkeypatch, "") == 1


def test_a_group_without_a_command_shows_its_help(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert status_of(monkeypatch, "audit") == 2
    assert "verify" in capsys.readouterr().out
