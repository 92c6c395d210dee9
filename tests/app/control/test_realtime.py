"""Control and perception keep out of each other's way where there is more than one core."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from app.control.realtime import core_of_control

ASK = "import os; from app.control import realtime; {}; print(*sorted(os.sched_getaffinity(0)))"


def cores_after(call: str) -> set[int]:
    """The cores of a process of its own after it has called that."""
    told = subprocess.run(
        [sys.executable, "-c", ASK.format(call)], capture_output=True, text=True, check=True, timeout=60
    ).stdout
    return {int(core) for core in told.split()}


@pytest.mark.parametrize("cores", [1, 2])
def test_perception_leaves_control_its_core_unless_there_is_only_one(cores: int) -> None:
    allowed = sorted(os.sched_getaffinity(0))[:cores]
    within = f"os.sched_setaffinity(0, {allowed})"
    control = cores_after(f"{within}; realtime.take_core()")
    perception = cores_after(f"{within}; realtime.leave_core_to_control()")
    assert control | perception == set(allowed)
    assert control.isdisjoint(perception) or len(allowed) == 1


def test_the_core_is_one_of_those_allowed() -> None:
    core = core_of_control()
    assert core is None or core in os.sched_getaffinity(0)
