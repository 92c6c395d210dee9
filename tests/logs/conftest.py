"""Small whole trails to be looked at and tampered with."""

from __future__ import annotations

from pathlib import Path

import pytest

from logs.disk import Disk
from logs.keys import ConsoleKey, load_or_make_key
from tests.support.audit_trails import Trail, write_session


@pytest.fixture
def key(tmp_path_factory: pytest.TempPathFactory) -> ConsoleKey:
    """A console's key."""
    return load_or_make_key(tmp_path_factory.mktemp("keys"))


@pytest.fixture
def trail(tmp_path: Path, key: ConsoleKey) -> Trail:
    """One closed session."""
    folder = tmp_path / "logs"
    folder.mkdir()
    return Trail(folder, write_session(folder, "s1", key, Disk()), key)


@pytest.fixture
def three(trail: Trail) -> Trail:
    """Three closed sessions of one console."""
    for name in ("s2", "s3"):
        write_session(trail.folder, name, trail.key, Disk())
    return trail
