"""Figures are written before they are shown: a stdout that is full or closed costs none of them."""

from __future__ import annotations

import ast
import errno
import io
import os
import subprocess
import sys
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest

from app.cli import audit, recording, run, sessions, simulate
from app.cli import evaluate as commands
from app.cli.common import shown_after
from app.cli.evaluate.common import status_line
from app.cli.tree import command
from app.evaluate.gestures.images import save_hands
from app.evaluate.harness import EvaluateFault, write_json
from app.evaluate.loop.rehearsal import NORM_FILE, NORM_SPEED
from app.evaluate.readings import DetectedImage, LabelledImage
from app.recording.schemas import TOPICS
from app.recording.writer import RecordingWriter
from app.system.errors import AppError
from kgdfa.gesture import Gesture
from testing.trails import write_sample
from tests.kgdfa.hands import STATES, drawn_hand
from tests.support.disks import full_disk

SOURCES = [
    *(file for group in (audit, commands) for file in Path(str(group.__file__)).parent.glob("*.py")),
    *(Path(str(one.__file__)) for one in (recording, run, sessions, simulate)),
]
SHOWING = {"show", "print", "print_text", "echo"}
WRITING = {"write_json", "_write_findings"}


class FullStdout(io.StringIO):
    """As `> /dev/full`."""

    def write(self, _text: str) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def calls(node: ast.AST) -> set[str]:
    """What it calls itself, not in the functions within."""
    within = [one for one in ast.walk(node) if isinstance(one, ast.FunctionDef) and one is not node]
    later = {one for function in within for one in ast.walk(function)}
    return {ast.unparse(one.func) for one in ast.walk(node) if isinstance(one, ast.Call) and one not in later}


FUNCTIONS = {
    f"{file.stem}.{node.name}": node
    for file in sorted(SOURCES)
    for node in ast.parse(file.read_text("utf-8")).body
    if isinstance(node, ast.FunctionDef) and WRITING & calls(node)
}


def test_every_command_with_figures_is_tried() -> None:
    assert len(FUNCTIONS) >= 20
    assert {"verify.verify", "recording.info"} <= FUNCTIONS.keys()


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_command_writes_its_figures_before_it_shows_them(name: str) -> None:
    blocks = [one for one in ast.walk(FUNCTIONS[name]) if isinstance(one, ast.With)]
    (within,) = [one for one in blocks if any("shown_after" in calls(item) for item in one.items)]
    ours = ("write_", "plot_", "_write_")
    written = {what for what in calls(FUNCTIONS[name]) if what.rpartition(".")[2].startswith(ours)}
    assert WRITING & written
    assert written <= set().union(*map(calls, within.body))
    assert not SHOWING & {what.rpartition(".")[2] for what in calls(FUNCTIONS[name])}


def test_a_full_stdout_stops_no_work_that_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdout", FullStdout())
    with status_line() as status:
        status("fold")


def test_a_full_stdout_costs_no_figure_of_a_rehearsal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rows = "".join(f"{percent},1,{percent},1,{percent},{NORM_SPEED}\n" for percent in (0, 50, 100))
    (tmp_path / NORM_FILE).write_text(f"gait_pct,hip_sd,hip_mean,knee_sd,knee_mean,speed\n{rows}")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "stdout", FullStdout())
    with pytest.raises(OSError, match="No space left"):
        command().main(["simulate", "walk", "--gait", ".", "--json", "o.json", "--home", "."], standalone_mode=False)
    assert msgspec.json.decode(Path("o.json").read_bytes())[0]["patient"] == "demo"


@pytest.mark.parametrize(
    ("arguments", "files"),
    [
        (("gestures", ".", "--png", "o.png", "--errors", "wrong"), {"o.json", "o.png", "wrong"}),
        (("side", "."), {"o.json"}),
    ],
)
def test_a_full_stdout_costs_no_figure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], files: set[str]
) -> None:
    labelled = LabelledImage(path="x.png", label="3", source="s", group="g")
    cv2.imwrite(str(tmp_path / "x.png"), np.zeros((40, 40, 3), np.uint8))
    (tmp_path / "labels.csv").write_text("path,label,source,group\nx.png,3,s,g\n")
    save_hands([DetectedImage(image=labelled, hands=(drawn_hand(STATES[Gesture.FIVE]),))], tmp_path / "k.npz")
    before = {one.name for one in tmp_path.iterdir()}
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "stdout", FullStdout())
    with pytest.raises(OSError, match="No space left"):
        command().main(["evaluate", *arguments, "--keypoints", "k.npz", "--json", "o.json"], standalone_mode=False)
    assert {one.name for one in tmp_path.iterdir()} - before == files
    assert msgspec.json.decode((tmp_path / "o.json").read_bytes())


FINDINGS = [(("audit", "verify", "--home", "."), "exit"), (("recording", "info", "x.mcap"), "hash")]


@pytest.mark.parametrize(("arguments", "named"), FINDINGS)
def test_a_full_stdout_costs_no_finding(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], named: str
) -> None:
    monkeypatch.chdir(tmp_path)
    write_sample(tmp_path, minutes=0.1)
    RecordingWriter(Path("x.mcap"), TOPICS, 0).finish()
    monkeypatch.setattr(sys, "stdout", FullStdout())
    with pytest.raises(OSError, match="No space left"):
        command().main([*arguments, "--json", "o.json"], standalone_mode=False)
    assert named in msgspec.json.decode(Path("o.json").read_bytes())


@pytest.mark.parametrize(("arguments", "named"), FINDINGS)
def test_a_reader_who_has_had_enough_changes_no_exit_status(
    tmp_path: Path, arguments: tuple[str, ...], named: str
) -> None:
    write_sample(tmp_path, minutes=0.1)
    RecordingWriter(tmp_path / "x.mcap", TOPICS, 0).finish()
    reads, writes = os.pipe()
    os.close(reads)
    line = [sys.executable, "-c", "from app.cli import main; main()", *arguments, "--json", "o.json"]
    environment = {**os.environ, "PYTHONPATH": str(Path(commands.__file__).parents[3])}
    done = subprocess.run(line, stdout=writes, stderr=subprocess.PIPE, cwd=tmp_path, env=environment, check=False)
    os.close(writes)
    assert (done.returncode, done.stderr.strip()) == (0, b"")  # the progress bar ends its line
    assert named in msgspec.json.decode((tmp_path / "o.json").read_bytes())


def test_what_can_not_be_written_is_shown(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with full_disk(1), pytest.raises(AppError), shown_after(["macro-F1 0.98"]):
        write_json({"macro_f1": 0.98}, tmp_path / "o.json")
    assert capsys.readouterr().out == "macro-F1 0.98\n"


def test_outcomes_that_can_not_be_written_are_shown_and_the_error_names_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write_sample(tmp_path, minutes=0.1, patient="P-017")
    with full_disk(1), pytest.raises(AppError) as refused:
        command().main(["outcomes", "last", "--json", "o.json", "--home", "."], standalone_mode=False)
    assert (refused.value.code, refused.value.values["file"]) == (EvaluateFault.FILE_UNWRITABLE, Path("o.json"))
    assert "P-017" in capsys.readouterr().out
