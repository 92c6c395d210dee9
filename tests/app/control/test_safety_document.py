"""The document shows the tables that run."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from app.control.events.table import TABLE
from app.control.gait.table import TABLE as GAIT_TABLE
from app.ipc.states import Event
from app.text.catalogue import key_of, load

ROOT = Path(__file__).resolve().parents[3]


def test_the_generated_parts_are_current() -> None:
    checked = subprocess.run(
        [sys.executable, "tools/safety_tables.py", "--check"], cwd=ROOT, env={**os.environ, "PYTHONPATH": str(ROOT)},
        check=False, capture_output=True, text=True,
    )  # fmt: skip
    assert checked.returncode == 0, checked.stderr


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A copy of what the tool reads and writes; of its catalogue of events, only the source is newer."""
    shutil.copytree(ROOT / "app", tmp_path / "app", ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("tools/safety_tables.py", "docs/safety.md"):
        (tmp_path / name).parent.mkdir()
        shutil.copy2(ROOT / name, tmp_path / name)
    return tmp_path


def rewrite(tree: Path, old: str, new: str) -> subprocess.CompletedProcess[str]:
    """The tool in the copy, after a change of its catalogue of events."""
    catalogue = tree / "app/text/locales/en/LC_MESSAGES/control.po"
    text = catalogue.read_text(encoding="utf-8")
    assert text.count(old) == 1
    catalogue.write_text(text.replace(old, new), encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": f"{tree}:{ROOT}"}
    command = [sys.executable, "tools/safety_tables.py"]
    return subprocess.run(command, cwd=tree, env=environment, check=False, capture_output=True, text=True)


def test_a_wording_that_was_just_written_is_in_it(tree: Path) -> None:
    done = rewrite(tree, 'msgid "Event.STOP"\nmsgstr "', 'msgid "Event.STOP"\nmsgstr "Just written. ')
    assert (done.returncode, done.stderr) == (0, "")
    text = (tree / "docs" / "safety.md").read_text(encoding="utf-8")
    assert "| stop | hold | until acknowledged, always | everybody | Just written. STOP: " in text


def test_without_a_wording_it_is_not_written(tree: Path) -> None:
    before = (tree / "docs" / "safety.md").read_bytes()
    done = rewrite(tree, 'msgid "Event.STOP"\n', 'msgid "Event.UNWORDED"\n')
    assert done.returncode == 1
    assert done.stderr == "Event.STOP has no wording: add it to app/text/locales/en/LC_MESSAGES/control.po\n"
    assert (tree / "docs" / "safety.md").read_bytes() == before


def test_every_event_stands_in_it() -> None:
    text = (ROOT / "docs" / "safety.md").read_text(encoding="utf-8")
    assert all(f"| {row.event.value} | {row.effect.name.lower()} |" in text for row in TABLE)


def test_the_gait_diagram_shows_every_row() -> None:
    text = (ROOT / "docs" / "safety.md").read_text(encoding="utf-8")
    diagram = text[text.index("stateDiagram-v2\n") :]
    for row in GAIT_TABLE:
        assert f"    {row.source.name} --> {(row.through or row.to).name}: " in diagram
    assert "LEFT_FORWARD --> STANDING: gesture 6, latched" in diagram
    assert "STANDING --> LEFT_FORWARD: gesture 5" in diagram
    assert "RIGHT_HIGH_STEP --> STANDING: completed" in diagram


def test_only_what_is_wired_in_hardware_is_called_an_emergency_stop() -> None:
    """ISO 13850: a software stop is none."""
    found = {row.event for row in TABLE if "emergency" in load("en").gettext(key_of(row.event)).lower()}
    assert found == {Event.HARDWIRED_STOP, Event.HARDWIRED_STOP_SANK}
