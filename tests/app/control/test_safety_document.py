"""The document shows the tables that run."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from app.control.events.table import TABLE
from app.control.gait.table import TABLE as GAIT_TABLE
from app.text.catalogue import key_of, load

ROOT = Path(__file__).resolve().parents[3]


def test_the_generated_parts_are_current() -> None:
    checked = subprocess.run(
        [sys.executable, "tools/safety_tables.py", "--check"], cwd=ROOT, env={**os.environ, "PYTHONPATH": str(ROOT)},
        check=False, capture_output=True, text=True,
    )  # fmt: skip
    assert checked.returncode == 0, checked.stderr


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


def test_the_stop_is_never_called_an_emergency_stop() -> None:
    text = " ".join(load("en").gettext(key_of(row.event)) for row in TABLE).lower()
    assert "emergency" not in text
