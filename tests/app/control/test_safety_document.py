"""The document shows the tables that run."""

from __future__ import annotations

from app.control.events.table import TABLE
from tools import safety_tables


def test_the_generated_parts_are_current() -> None:
    text = safety_tables.DOCUMENT.read_text(encoding="utf-8")
    assert safety_tables.current(text) == text, "run: python tools/safety_tables.py"


def test_every_event_stands_in_it() -> None:
    text = safety_tables.DOCUMENT.read_text(encoding="utf-8")
    assert all(f"| {row.event.value} | {row.effect.name.lower()} |" in text for row in TABLE)


def test_the_stop_is_never_called_an_emergency_stop() -> None:
    text = " ".join(row.text for row in TABLE).lower()
    assert "emergency" not in text
