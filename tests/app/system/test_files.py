"""Files that are replaced whole: who may read them afterwards."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from pathlib import Path

import pytest

from app.system.files import open_lock, write_whole


@pytest.fixture(autouse=True)
def umask() -> Iterator[None]:
    """A usual one, whatever the shell has."""
    former = os.umask(0o022)
    yield
    os.umask(former)


@pytest.mark.parametrize("mode", [0o600, 0o640, 0o444])
def test_a_file_that_is_replaced_keeps_its_mode(tmp_path: Path, mode: int) -> None:
    path = tmp_path / "report.html"
    path.write_bytes(b"former")
    path.chmod(mode)
    write_whole(path, b"new")
    assert path.read_bytes() == b"new"
    assert stat.S_IMODE(path.stat().st_mode) == mode
    assert list(tmp_path.iterdir()) == [path]


def test_a_new_file_has_the_mode_of_the_umask(tmp_path: Path) -> None:
    write_whole(tmp_path / "report.html", b"new")
    assert stat.S_IMODE((tmp_path / "report.html").stat().st_mode) == 0o644


@pytest.mark.parametrize("mode", [0o600, 0o644])
def test_a_lock_file_has_its_mode_whatever_the_umask(tmp_path: Path, mode: int) -> None:
    path = tmp_path / "a.lock"
    os.umask(0o077)
    os.close(open_lock(path, mode))
    assert stat.S_IMODE(path.stat().st_mode) == mode
