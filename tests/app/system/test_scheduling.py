"""Control and perception keep out of each other's way where there is more than one core."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from app.system.scheduling import SCHEDULING, control_core, request_low_wake_latency

ASK = "import os; from app.system import scheduling; {}; print(*sorted(os.sched_getaffinity(0)))"


def cores_after(call: str) -> set[int]:
    """The cores of a process of its own after it has called that."""
    reported = subprocess.run(
        [sys.executable, "-c", ASK.format(call)], capture_output=True, text=True, check=True, timeout=60
    ).stdout
    return {int(core) for core in reported.split()}


@pytest.mark.parametrize("cores", [1, 2])
def test_perception_leaves_control_its_core_unless_there_is_only_one(cores: int) -> None:
    allowed = sorted(os.sched_getaffinity(0))[:cores]
    within = f"os.sched_setaffinity(0, {allowed})"
    control = cores_after(f"{within}; scheduling.pin_to_control_core()")
    perception = cores_after(f"{within}; scheduling.avoid_control_core()")
    assert control | perception == set(allowed)
    assert control.isdisjoint(perception) or len(allowed) == 1


def test_the_core_is_one_of_those_allowed() -> None:
    core = control_core()
    assert core is None or core in os.sched_getaffinity(0)


def test_who_keeps_the_legs_safe_comes_first() -> None:
    fifo = [
        policy.fifo for name in ("guardian", "control", "planner", "heartbeat") if (policy := SCHEDULING[name]).fifo
    ]
    assert fifo == sorted(fifo, reverse=True)
    assert all(0 < priority < 99 for priority in fifo)
    assert len(fifo) == 4


@pytest.mark.parametrize("name", list(SCHEDULING))
def test_a_policy_is_set_or_reported_as_refused(name: str) -> None:
    reported = subprocess.run(
        [
            sys.executable,
            "-c",
            "import os; from app.system.scheduling import set_scheduling; "
            f"print(set_scheduling({name!r}), os.sched_getscheduler(0) == os.SCHED_FIFO, os.nice(0))",
        ],
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    ).stdout.split()
    policy = SCHEDULING[name]
    allowed = [str(policy.fifo is not None), str(policy.nice)]
    assert reported in (["True", *allowed], ["False", "False", str(os.nice(0))])


def test_the_request_to_stay_awake_is_held_and_reports_no_microsecond(tmp_path: Path) -> None:
    interface = tmp_path / "cpu_dma_latency"
    interface.touch()
    assert request_low_wake_latency(interface)
    assert interface.read_bytes() == bytes(4)
    held = [link for link in Path("/proc/self/fd").iterdir() if link.exists() and link.samefile(interface)]
    (request,) = held
    os.close(int(request.name))


def test_a_system_without_the_request_is_reported(tmp_path: Path) -> None:
    assert not request_low_wake_latency(tmp_path / "absent")
