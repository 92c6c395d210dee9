"""What a user can get wrong on the command line: one sentence, exit status 2, never a traceback."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest

from app.cli import main

RLEEX = [sys.executable, "-c", "from app.cli import main; main()"]


class Done(NamedTuple):
    """How a command ended, and what it printed."""

    returncode: object
    stdout: str
    stderr: str


@pytest.fixture
def rleex(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., Done]:
    """`rleex` with a home of its own, in this process; test_bad_options starts it as one."""
    monkeypatch.setenv("RLEEX_HOME", str(tmp_path))
    monkeypatch.setenv("PIP_NO_INDEX", "1")

    def run(*arguments: str) -> Done:
        monkeypatch.setattr(sys, "argv", ["rleex", *arguments])
        with pytest.raises(SystemExit) as ended:
            main()
        return Done(ended.value.code or 0, *capsys.readouterr())

    return run


def assert_one_sentence(done: Done, named: str) -> None:
    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr
    assert done.stderr.startswith("rleex: ")
    assert len(done.stderr.strip().splitlines()) == 1
    assert named in done.stderr


def test_no_network_names_what_is_missing_and_how_to_give_a_path(rleex: Callable[..., Done]) -> None:
    assert_one_sentence(rleex("model"), "`model` in config.toml")


def test_a_broken_configuration_names_the_field(tmp_path: Path, rleex: Callable[..., Done]) -> None:
    (tmp_path / "config.toml").write_text("[camera]\nrate_hz = 'fast'\n")
    assert_one_sentence(rleex("model"), "camera.rate_hz")


def test_a_missing_model_path_is_named(tmp_path: Path) -> None:
    (tmp_path / "config.toml").write_text("model = '/nowhere/hand.task'\n")
    environment = {**os.environ, "RLEEX_HOME": str(tmp_path)}
    done = subprocess.run([*RLEEX, "demo"], capture_output=True, text=True, env=environment, timeout=60, check=False)
    assert_one_sentence(Done(done.returncode, done.stdout, done.stderr), "/nowhere/hand.task")


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
def test_wrong_arguments_are_named(rleex: Callable[..., Done], arguments: tuple[str, ...], named: str) -> None:
    done = rleex(*arguments)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert named in (done.stderr + done.stdout).replace("\n", "")


def test_version_and_places(tmp_path: Path, rleex: Callable[..., Done]) -> None:
    assert rleex("--version").stdout.startswith("rleex ")
    assert str(tmp_path) in rleex("locate").stdout.replace("\n", "")
