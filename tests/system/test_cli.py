"""What a user can get wrong on the command line: one sentence, exit status 2, never a traceback."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

RLEEX = [sys.executable, "-c", "from app.cli import main; main()"]


def rleex(*arguments: str, home: Path) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "RLEEX_HOME": str(home), "PIP_NO_INDEX": "1"}
    return subprocess.run(
        [*RLEEX, *arguments], capture_output=True, text=True, env=environment, timeout=60, check=False
    )


def assert_one_sentence(done: subprocess.CompletedProcess[str], named: str) -> None:
    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr
    assert done.stderr.startswith("rleex: ")
    assert len(done.stderr.strip().splitlines()) == 1
    assert named in done.stderr


def test_no_network_names_what_is_missing_and_how_to_give_a_path(tmp_path: Path) -> None:
    assert_one_sentence(rleex("model", home=tmp_path), "`model` in config.toml")


def test_a_broken_configuration_names_the_field(tmp_path: Path) -> None:
    (tmp_path / "config.toml").write_text("[camera]\nrate_hz = 'fast'\n")
    assert_one_sentence(rleex("model", home=tmp_path), "camera.rate_hz")


def test_a_missing_model_path_is_named(tmp_path: Path) -> None:
    (tmp_path / "config.toml").write_text("model = '/nowhere/hand.task'\n")
    assert_one_sentence(rleex("demo", home=tmp_path), "/nowhere/hand.task")


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("demo", "--joints", "steam"), "steam"),
        (("evaluate", "response", "--seeds", "1,x"), "1,x"),
        (("run", "--camera", "periscope"), "periscope"),
        (("audit", "verify", "/nowhere.jsonl"), "/nowhere.jsonl"),
        (("evaluate", "gestures", "/nowhere"), "/nowhere"),
        (("evaluate", "distance", "/nowhere"), "/nowhere"),
    ],
)
def test_wrong_arguments_are_named(tmp_path: Path, arguments: tuple[str, ...], named: str) -> None:
    done = rleex(*arguments, home=tmp_path)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert named in (done.stderr + done.stdout).replace("\n", "")


def test_version_and_places(tmp_path: Path) -> None:
    assert rleex("--version", home=tmp_path).stdout.startswith("rleex ")
    assert str(tmp_path) in rleex("locate", home=tmp_path).stdout.replace("\n", "")
