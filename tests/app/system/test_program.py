"""Which files a rehearsal's verdict holds for."""

from __future__ import annotations

from pathlib import Path

import pytest

from app.system.program import rehearsal_identity


@pytest.mark.parametrize(
    ("changed", "holds"),
    [
        ("app/motion/path.py", False),
        ("hal/joints/guard.py", False),
        ("hal/joints/exoskeleton.toml", False),
        ("hal/minimum_jerk.py", False),
        ("app/console/app.py", True),
        ("kgdfa/distance.py", True),
        ("hal/joints/guard.pyc", True),
    ],
)
def test_a_verdict_holds_until_a_file_of_what_was_rehearsed_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, changed: str, holds: bool
) -> None:
    monkeypatch.setattr("app.system.program.ROOT", tmp_path)
    identity = rehearsal_identity.__wrapped__  # a process asks once
    file = tmp_path / changed
    file.parent.mkdir(parents=True)
    file.write_text("LIMIT = 1\n")
    before = identity()
    file.write_text("LIMIT = 2\n")
    assert (identity() == before) is holds
