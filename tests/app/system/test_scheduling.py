"""Control and perception keep out of each other's way where there is more than one core."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from app.system import scheduling
from app.system.scheduling import (
    SCHEDULING,
    autogroup_nice,
    control_core,
    pin_to_control_core,
    request_low_wake_latency,
    set_autogroup_nice,
)

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


def test_the_guardian_shares_controls_core_only_where_it_does_not_go_before_control() -> None:
    control = cores_after("scheduling.pin_to_control_core()")
    assert cores_after("scheduling.place_guardian(real_time=False)") == control
    beside = cores_after("scheduling.place_guardian(real_time=True)")
    assert beside == cores_after("scheduling.avoid_control_core()")


def test_the_core_is_one_of_those_allowed() -> None:
    core = control_core()
    assert core is None or core in os.sched_getaffinity(0)


@pytest.mark.skipif(len(os.sched_getaffinity(0)) < 2, reason="with one core there is nothing to choose")
def test_the_configured_core_is_controls_if_it_is_there() -> None:
    first, *_, last = sorted(os.sched_getaffinity(0))
    assert cores_after(f"scheduling.pin_to_control_core({first})") == {first}
    assert first not in cores_after(f"scheduling.avoid_control_core({first})")
    assert control_core(last + 1) == control_core()


@pytest.mark.parametrize(
    ("wanted", "refused", "core"), [(None, set(), 7), (6, set(), 6), (4, set(), 7), (None, {7}, 6), (6, {6, 7}, 1)]
)
def test_an_isolated_core_is_controls_though_no_process_inherits_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, wanted: int | None, refused: set[int], core: int
) -> None:
    isolated = tmp_path / "isolated"
    isolated.write_text("6-7\n")
    now = [{0, 1}]

    def move(_thread: int, cores: set[int]) -> None:
        if cores <= refused:
            raise OSError
        now.append(cores)

    monkeypatch.setattr(scheduling, "_ISOLATED", isolated)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: now[-1])
    monkeypatch.setattr(os, "sched_setaffinity", move)
    assert control_core(wanted) == core
    assert now[-1] == {0, 1}
    assert pin_to_control_core(wanted) == core
    assert now[-1] == {core}


def test_who_keeps_the_legs_safe_comes_first() -> None:
    names = ("guardian", "control", "planner", "heartbeat", "console")
    fifo = [policy.fifo for name in names if (policy := SCHEDULING[name]).fifo]
    assert fifo == sorted(fifo, reverse=True)
    assert all(0 < priority < 99 for priority in fifo)
    assert len(fifo) == 5


CHILDREN = """
import os, subprocess, sys, threading
from app.system.scheduling import set_scheduling
set_scheduling(sys.argv[1])
def report():
    print(os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK, os.getpriority(os.PRIO_PROCESS, 0), flush=True)
report()
thread = threading.Thread(target=report)
thread.start()
thread.join()
"""


@pytest.mark.parametrize("name", ["console", "heartbeat"])
def test_what_the_console_starts_does_not_go_before_everything_usual(name: str) -> None:
    """A rehearsal of half a minute would keep perception from its core; the links' threads must."""
    command = [sys.executable, "-c", CHILDREN, name]
    lines = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout.splitlines()
    own, thread = ([int(value) for value in line.split()] for line in lines)
    if own[0] == os.SCHED_FIFO and name == "console":
        assert thread == [os.SCHED_OTHER, 0]
    else:  # or not allowed
        assert thread == own


AUTOGROUP = Path("/proc/self/autogroup")


@pytest.mark.skipif(not AUTOGROUP.exists(), reason="this kernel doesn't group processes by login session")
def test_a_session_weighs_more_than_another_terminal_where_that_is_allowed() -> None:
    allowed, group = subprocess.run(
        [
            sys.executable,
            "-c",
            "from app.system.scheduling import set_autogroup_nice; print(set_autogroup_nice('session')); "
            f"print(open({str(AUTOGROUP)!r}).read())",
        ],
        capture_output=True,
        text=True,
        check=True,
        start_new_session=True,
        timeout=60,
    ).stdout.split(maxsplit=1)
    assert group.split()[-1] == (str(SCHEDULING["session"].nice) if allowed == "True" else "0")


def test_a_kernel_without_groups_refuses(tmp_path: Path) -> None:
    missing = tmp_path / "missing" / "autogroup"
    assert not set_autogroup_nice("session", missing)
    with autogroup_nice("console", missing) as allowed:
        assert not allowed


def test_a_terminals_group_weighs_as_before_once_the_console_has_ended(tmp_path: Path) -> None:
    group = tmp_path / "autogroup"
    group.write_text("/autogroup-7 nice 3\n")
    with autogroup_nice("console", group) as allowed:
        assert allowed
        assert group.read_text() == f"{SCHEDULING['console'].nice}\n"
    assert group.read_text() == "3\n"


@pytest.mark.parametrize("name", list(SCHEDULING))
def test_a_policy_is_set_or_reported_as_refused(name: str) -> None:
    reported = subprocess.run(
        [
            sys.executable,
            "-c",
            "import os; from app.system.scheduling import set_scheduling; "
            f"print(set_scheduling({name!r}), bool(os.sched_getscheduler(0) & os.SCHED_FIFO), os.nice(0))",
        ],
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    ).stdout.split()
    policy = SCHEDULING[name]
    real_time, before = policy.fifo is not None, str(os.nice(0))
    accepted = [["True", str(real_time), str(policy.nice)], ["False", "False", before]]
    if real_time:  # one of the two privileges alone
        accepted += [["True", "True", before], ["False", "False", str(policy.nice)]]
    assert reported in accepted


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


LINKS = """
import os, time
from pathlib import Path
from app.ipc.links import start_links
from app.system.scheduling import call_with_scheduling
def name_of(task):
    try:
        return Path(f"/proc/self/task/{task}/comm").read_text()
    except OSError:  # the thread that began them has just ended
        return ""
def links():  # a thread names itself, a moment after it was made
    made = set(os.listdir("/proc/self/task")) - before
    return [int(task) for task in made if name_of(task).startswith("ZMQ")]
before = set(os.listdir("/proc/self/task"))
call_with_scheduling("heartbeat", start_links)
limit_s = time.monotonic() + 30
while len(links()) < 2 and time.monotonic() < limit_s:
    time.sleep(0.01)
print(os.sched_getscheduler(0), *{os.sched_getscheduler(task) for task in links()}, len(links()))
"""


def test_the_links_threads_carry_stop_before_other_programs_and_their_process_stays_as_it_was() -> None:
    reported = subprocess.run([sys.executable, "-c", LINKS], capture_output=True, text=True, check=True, timeout=60)
    own, links, threads = map(int, reported.stdout.split())
    assert own == os.sched_getscheduler(0)
    assert links in {os.SCHED_FIFO, own}  # where it is not allowed, as their process
    assert threads == 2
