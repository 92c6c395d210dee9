"""The configuration changed by two commands at once."""

from __future__ import annotations

import multiprocessing
from multiprocessing.synchronize import Barrier
from pathlib import Path

from app.system.config import Config, load_config
from app.system.configure import change_config
from app.system.paths import Home
from logs.journal import CHANGES
from logs.read import records
from logs.records import Change
from testing.authors import signed_in

CHANGES_EACH = 20  # one pair alone might not meet
LIMIT_S = 60.0


def set_keys(root: Path, name: str, barrier: Barrier) -> None:
    """One field after the other, each at the same moment as the other process sets its own."""
    for number in range(CHANGES_EACH):
        barrier.wait(LIMIT_S)
        change_config(signed_in(Home(root)), {f"keys.{name}{number}": "f9"})


def test_changes_made_at_once_are_all_in_the_file_as_they_are_on_record(tmp_path: Path) -> None:
    home, spawn = Home(tmp_path), multiprocessing.get_context("spawn")
    barrier = spawn.Barrier(2)
    both = [spawn.Process(target=set_keys, args=(tmp_path, name, barrier), daemon=True) for name in "ab"]
    for one in both:
        one.start()
    for one in both:
        one.join(LIMIT_S)
    assert [one.exitcode for one in both] == [0, 0]
    wanted = {f"{name}{number}": "f9" for name in "ab" for number in range(CHANGES_EACH)}
    assert load_config(home.config) == Config(keys=wanted)
    recorded = [record.body for record in records(home.logs / CHANGES)]
    digests = [one.values["sha256"] for one in recorded if isinstance(one, Change)]
    assert [before for before, _ in digests[1:]] == [after for _, after in digests[:-1]], "each from the one before"
