"""One console a home, also when the first was killed."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

import pytest

from app.system.errors import AppError
from app.system.paths import Home, hold_home
from tests.support.disks import full_disk, read_only_disk

HOLD = "import sys; from pathlib import Path; from app.system.paths import Home, hold_home\n"
HOLD += "with hold_home(Home(Path(sys.argv[1]))): print('held', flush=True); sys.stdin.read()"


def test_second_console_is_refused_by_name(tmp_path: Path) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, str(tmp_path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as first:
        assert first.stdout is not None
        assert first.stdout.readline() == "held\n"
        with pytest.raises(AppError, match=f"HELD pid={first.pid}"), hold_home(Home(tmp_path)):
            pass
        first.kill()
    with hold_home(Home(tmp_path)):
        pass


def test_home_that_cannot_be_made_ends_in_a_sentence(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("")
    with pytest.raises(AppError, match="UNUSABLE"), hold_home(Home(blocked)):
        pass


@pytest.mark.parametrize("disk", [full_disk, read_only_disk])
@pytest.mark.parametrize("told", ["", "4194304\n"])
def test_a_disk_that_takes_nothing_keeps_nobody_from_a_home(
    tmp_path: Path, disk: Callable[[], AbstractContextManager[None]], told: str
) -> None:
    """told: what is left of an earlier console's number."""
    home = Home(tmp_path)
    home.lock.write_text(told)
    with disk(), hold_home(home), pytest.raises(AppError, match="HELD"), hold_home(home):
        pass


def test_the_lock_tells_the_newest_number_alone(tmp_path: Path) -> None:
    home = Home(tmp_path)
    home.lock.write_text("123456789012\n")
    with hold_home(home):
        assert home.lock.read_text() == f"{os.getpid()}\n"
