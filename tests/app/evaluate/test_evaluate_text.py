"""Every text that the evaluations ask for is in both catalogues, and a missing extra is named."""

from __future__ import annotations

import ast
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from app.cli import evaluate as commands
from app.cli import main
from app.evaluate import harness
from app.evaluate.harness import EvaluateFault, require_extra
from app.evaluate.trigger.push_results import ButtonPhase, PushFault
from app.system.errors import AppError
from app.text.catalogue import key_of, knows, render, use_language
from tests.support.catalogues import entries

ROOT = Path(__file__).parents[3]
FILES = [*Path(harness.__file__).parent.rglob("*.py"), Path(commands.__file__)]


def keys_of(file: Path) -> Iterator[str]:
    """What a file asks for with constant strings: texts, tables with their columns, plots, progress."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
            if node.targets[0].id.lower() == "columns" and isinstance(node.value, ast.Constant):
                yield from _columns(str(node.value.value))
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            text = [one.value for one in node.args if isinstance(one, ast.Constant) and isinstance(one.value, str)]
            if node.func.id == "tr":
                yield from text
            elif node.func.id == "_bar":
                yield from (f"evaluate.progress.{one}" for one in text)
            elif node.func.id == "decorate":
                yield from (f"evaluate.plot.{one}" for one in text)
            elif node.func.id == "table" and text:
                yield f"evaluate.{text[0]}"
                yield from _columns(" ".join(text[1:]))


def _columns(listed: str) -> Iterator[str]:
    yield from (f"evaluate.column.{one}" for one in listed.split() if one != "empty")


@pytest.mark.parametrize("language", ["en", "zh"])
def test_every_text_is_in_the_catalogue(language: str) -> None:
    use_language(language)
    keys = {key for file in FILES for key in keys_of(file)} | {
        key_of(one) for one in (*EvaluateFault, *PushFault, *ButtonPhase)
    }
    assert len(keys) > 130
    assert not [key for key in keys if not knows(key)]


def test_no_bar_has_a_label_that_no_catalogue_has() -> None:
    calls = [
        node
        for file in Path(commands.__file__).parents[1].rglob("*.py")
        for node in ast.walk(ast.parse(file.read_text("utf-8")))
    ]
    labels = [node.args[1] for node in calls if isinstance(node, ast.Call) and ast.unparse(node.func) == "bar"]
    assert labels
    assert [label.value for label in labels if isinstance(label, ast.Constant)] == []


@pytest.mark.parametrize(("module", "extra"), [("sklearn.metrics", "evaluate"), ("duckdb", "analysis")])
def test_a_command_without_its_extra_ends_with_one_sentence(
    module: str, extra: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def command(_: list[str], **_options: object) -> None:
        raise ModuleNotFoundError(name=module)

    monkeypatch.setattr("app.cli.tree.command", lambda _: command)
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    wanted = f"rleex: This command needs more than make run installs (the extra {extra}): run make check once"
    assert capsys.readouterr().err.startswith(wanted)


def test_a_missing_extra_ends_with_how_to_install_it() -> None:
    require_extra("evaluate", "json")
    with pytest.raises(AppError) as caught:
        require_extra("evaluate", "no_such_module")
    assert "(the extra evaluate): run make check once, which installs it." in render(caught.value)


# The text → the extra whose packages it names.
INSTALLED_BY_HAND = {
    "CameraFault.NO_REALSENSE_LIBRARY": "realsense",
    "StopInputFault.EXTRA_MISSING": "inputs",
    "MicrophoneFault.EXTRA_MISSING": "voice",
    "VoiceState.NO_EXTRA": "voice",
}


@pytest.mark.parametrize("language", ["en", "zh"])
def test_no_text_installs_what_the_lock_leaves_out(language: str) -> None:
    """`pip install "rleex[…]"` resolves mediapipe anew: another cv2 over the locked one (tools/overrides.txt)."""
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    texts = entries(language)
    assert [key for key, forms in texts.items() if any("rleex[" in form for form in forms)] == []
    for key, extra in INSTALLED_BY_HAND.items():
        packages = " ".join(re.split(r"[<>=]", one)[0] for one in extras[extra])
        assert f".venv/bin/python -m pip install --no-deps {packages}" in texts[key][0]
    by_pip = {key for key, forms in texts.items() if any("pip install" in form for form in forms)}
    assert by_pip == set(INSTALLED_BY_HAND)
    assert "make check" in texts["EvaluateFault.EXTRA_MISSING"][0]
    assert "rleex[evaluate,analysis,build]" in extras["dev"], "what make check installs"


def test_no_document_and_no_remedy_in_code_does_either() -> None:
    files = [ROOT / "README.md", *(file for room in ("docs", "app", "hal") for file in (ROOT / room).rglob("*.*"))]
    texts = {file: file.read_text(encoding="utf-8") for file in files if file.suffix in {".md", ".py"}}
    assert len(texts) > 300
    assert [file for file, text in texts.items() if re.search(r"pip install(?! --no-deps)", text)] == []
