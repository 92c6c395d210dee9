"""The page of the configuration has every key as the structs have it."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest

from app.console.keys import ALL
from app.system.config import Config
from profiles.fields import flat

ROOT = Path(__file__).resolve().parents[3]
PAGE = "docs/reference/configuration.md"


def run(tree: Path, *options: str) -> subprocess.CompletedProcess[str]:
    """The tool of a tree, on its program."""
    environment = {**os.environ, "PYTHONPATH": f"{tree}:{ROOT}"}
    command = [sys.executable, "tools/configuration_page.py", *options]
    return subprocess.run(command, cwd=tree, env=environment, check=False, capture_output=True, text=True)


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A copy of what the tool reads and writes."""
    shutil.copytree(ROOT / "app", tmp_path / "app", ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("tools/configuration_page.py", PAGE):
        (tmp_path / name).parent.mkdir(parents=True)
        shutil.copy2(ROOT / name, tmp_path / name)
    return tmp_path


def rewrite(tree: Path, name: str, old: str, new: str) -> None:
    text = (tree / name).read_text(encoding="utf-8")
    assert text.count(old) == 1
    (tree / name).write_text(text.replace(old, new), encoding="utf-8")


def row(name: str, heading: str) -> list[str]:
    """The cells of a key in the section that begins so."""
    section = (ROOT / PAGE).read_text(encoding="utf-8").split(f"\n## {heading}")[1].split("\n## ")[0]
    (line,) = [line for line in section.splitlines() if line.startswith(f"| `{name}` | ")]
    return line.removesuffix(" |").split(" | ")[1:]


def test_the_page_is_what_the_tool_writes() -> None:
    checked = run(ROOT, "--check")
    assert checked.returncode == 0, checked.stderr


def test_a_changed_limit_makes_it_old_until_it_is_written(tree: Path) -> None:
    rewrite(tree, "app/system/config.py", "Meta(ge=2, le=3600)", "Meta(ge=3, le=3600)")
    checked = run(tree, "--check")
    assert (checked.returncode, checked.stderr) == (
        1,
        "docs/reference/configuration.md is not current: run python tools/configuration_page.py\n",
    )
    assert run(tree).returncode == 0
    assert "| `unattended_s` | number | `120.0` | s | 3 to 3,600 |" in (tree / PAGE).read_text(encoding="utf-8")


def test_a_key_without_a_sentence_is_refused_and_nothing_written(tree: Path) -> None:
    before = (tree / PAGE).read_bytes()
    rewrite(
        tree, "app/system/config.py", "    press: bool = False\n", "    press: bool = False\n    step: bool = False\n"
    )
    done = run(tree)
    assert done.returncode == 1
    assert done.stderr == "sounds.step has no sentence: add it to SENTENCES in tools/configuration_page.py\n"
    assert (tree / PAGE).read_bytes() == before


def test_a_sentence_without_a_key_is_refused(tree: Path) -> None:
    rewrite(tree, "app/system/config.py", "    encrypt: bool = False", "    encrypted: bool = False")
    sentence = '"recording.encrypt": '
    rewrite(tree, "tools/configuration_page.py", sentence, f'"recording.encrypted": "Whether.", {sentence}')
    done = run(tree)
    assert done.returncode == 1
    assert done.stderr == (
        "recording.encrypt is no key of the configuration: remove it from tools/configuration_page.py\n"
    )


def test_every_key_of_the_defaults_and_every_name_of_a_console_key_stands_in_it() -> None:
    """Asked of a configuration as it is written, not of the types that the tool reads."""
    text = (ROOT / PAGE).read_text(encoding="utf-8")
    written = flat(msgspec.to_builtins(Config()))
    assert "camera.focal_px" in written
    listed = {key.split(".")[-1] for key in written if key not in {"inputs", "keys"}}
    assert [key for key in sorted(listed) if f"\n| `{key}` | " not in text] == []
    assert [one.id for one in ALL if f"\n| `{one.id}` | `{one.key}` | " not in text] == []


@pytest.mark.parametrize(
    ("heading", "name", "cells"),
    [
        ("`[camera]`", "focal_px", ["number", "none", "px", "above 0 to 100,000"]),
        ("`[camera]`", "mirrored", ["true or false", "`false`", "", ""]),
        ("`[camera]`", "seed", ["integer", "`1`", "", "0 or more"]),
        ("`[button]`", "mode", ["text", '`"robust"`', "", '`"published"`, `"robust"`']),
        ("`[recording]`", "keep_days", ["integer", "none", "days", "1 to 36,500"]),
        ("`[[inputs]]`", "role", ["text", "required", "", '`"emergency-stop"`, `"wearer"`, `"therapist"`']),
        ("`[[inputs]]`", "bus.bitrate", ["integer", "`1000000`", "bit/s", "above 0 to 8,000,000"]),
        ("`[[inputs]]`", "closed", ["integer", "none", "", "`0`, `1`"]),
        ("Above", "language", ["text", '`"en"`', "", '`"en"`, `"zh"`']),
    ],
)
def test_a_key_has_type_default_unit_and_values(heading: str, name: str, cells: list[str]) -> None:
    *found, sentence = row(name, heading)
    assert found == cells
    assert re.fullmatch(r"\S.*\S\.", sentence)
