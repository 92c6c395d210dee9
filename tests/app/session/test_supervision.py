"""Perception is started again when it died or froze, with patience, and not for ever; how processes are ended."""

from __future__ import annotations

import errno
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from contextlib import ExitStack
from itertools import pairwise
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import cast

import msgspec
import pytest

from app.audit.process import GIVE_UP_S
from app.audit.sink import AuditSink
from app.ipc.streams import SESSION
from app.session import supervise
from app.session.child import AWAY_S, BACK_OFF_S, LOADING_S, SILENCE_S, STEADY_S, Supervisor, output_of
from app.session.launch import START_ORDER, Launch, launch
from app.session.setup import make_setup
from app.session.shared import encode, take_lease
from app.session.supervise import SessionProcesses, end_child
from app.system.config import Config, JointsConfig
from app.system.errors import AppError
from app.system.paths import Home
from hal.errors import HardwareError
from logs.reason import Reason
from logs.records import Body, ProcessEnd
from profiles.schema import DEMO_PATIENT


def test_a_reporting_perception_is_left_alone() -> None:
    supervisor = Supervisor()
    assert not any(supervisor.must_restart(0.1 * i, alive=True, reported=True) for i in range(1000))


def test_a_dead_one_is_started_again_and_given_up_in_the_end() -> None:
    supervisor = Supervisor()
    restarts = [t for i in range(10_000) if supervisor.must_restart(t := i * 0.1, alive=False, reported=False)]
    assert len(restarts) == len(BACK_OFF_S)
    pauses = [after - before for before, after in pairwise(restarts)]
    assert pauses == sorted(pauses)


@pytest.mark.parametrize(("reports_s", "restarts"), [(STEADY_S + 1, 7), (STEADY_S - 1, len(BACK_OFF_S))])
def test_only_failures_in_a_row_are_counted_against_it(reports_s: float, restarts: int) -> None:
    supervisor, now_s = Supervisor(), 0.0
    for _ in range(7):
        for _ in range(int(reports_s) + 1):
            assert not supervisor.must_restart(now_s, alive=True, reported=True)
            now_s += 1.0
        moments = [now_s + i for i in range(int(BACK_OFF_S[-1]))]
        now_s = next((t for t in moments if supervisor.must_restart(t, alive=False, reported=False)), 0.0)
        if not now_s:
            break
    assert supervisor.restarts == restarts


def restarted_s(supervisor: Supervisor, from_s: float, to_s: float) -> float | None:
    """When it restarts one that lives and does not report, asked as often as in a session; None: not in that time."""
    period_s = 1 / SESSION.rate_hz
    moments = (from_s + i * period_s for i in range(1, round((to_s - from_s) / period_s) + 1))
    return next((t for t in moments if supervisor.must_restart(t, alive=True, reported=False)), None)


def test_a_frozen_one_is_started_again_after_its_timeout() -> None:
    supervisor = Supervisor()
    assert not supervisor.must_restart(0.0, alive=True, reported=True)
    assert restarted_s(supervisor, 0.0, SILENCE_S * 1.1) == pytest.approx(SILENCE_S, abs=0.1)


@pytest.mark.parametrize(("ready", "pause_s"), [(True, 6.0), (True, 600.0), (False, 60.0)])
def test_a_pause_of_the_supervisor_itself_is_no_silence(ready: bool, pause_s: float) -> None:
    """A computer that stood still: a healthy perception had been killed when it woke, before it could report."""
    supervisor = Supervisor()
    assert not supervisor.must_restart(0.0, alive=True, reported=True, ready=ready)
    assert not supervisor.must_restart(pause_s, alive=True, reported=False)
    limit_s = pause_s + (SILENCE_S if ready else LOADING_S)
    after_s = restarted_s(supervisor, pause_s, limit_s)
    assert after_s is not None, "one that is really silent is started again"
    assert after_s == pytest.approx(limit_s - AWAY_S, abs=0.1)


def test_a_supervisor_that_is_always_slow_still_finds_a_silent_one() -> None:
    supervisor = Supervisor()
    assert not supervisor.must_restart(0.0, alive=True, reported=True)
    assert any(supervisor.must_restart(2.0 * i, alive=True, reported=False) for i in range(1, 8))


def test_loading_the_model_is_not_mistaken_for_a_freeze() -> None:
    supervisor = Supervisor()
    assert not supervisor.must_restart(0.0, alive=True, reported=False)
    assert restarted_s(supervisor, 0.0, LOADING_S * 1.1) == pytest.approx(LOADING_S, abs=0.1)


def test_a_silence_while_the_hand_model_is_loading_is_no_failure() -> None:
    supervisor = Supervisor()
    assert not supervisor.must_restart(0.0, alive=True, reported=True, ready=False)
    assert restarted_s(supervisor, 0.0, LOADING_S * 0.9) is None
    assert not supervisor.must_restart(LOADING_S * 0.9, alive=True, reported=True, ready=True)
    after_s = restarted_s(supervisor, LOADING_S * 0.9, LOADING_S * 2)
    assert after_s == pytest.approx(LOADING_S * 0.9 + SILENCE_S, abs=0.1)


class SlowChild:
    """Ends so long after it was asked to."""

    def __init__(self, takes_s: float) -> None:
        self.left_s = takes_s
        self.asked = self.killed = False

    def terminate(self) -> None:
        self.asked = True

    def join(self, timeout: float | None = None) -> None:
        assert self.asked
        self.left_s -= self.left_s if timeout is None else min(timeout, self.left_s)

    def is_alive(self) -> bool:
        return self.left_s > 0 and not self.killed

    def kill(self) -> None:
        self.killed = True


@pytest.mark.parametrize(
    ("name", "takes_s", "killed"),
    [("perception", 1.9, False), ("perception", 9.0, True), ("audit", 4 * GIVE_UP_S, False), ("audit", 99.0, True)],
)
def test_a_process_that_does_not_end_is_killed_audit_long_after_it_gives_up_by_itself(
    name: str, takes_s: float, killed: bool
) -> None:
    child = SlowChild(takes_s)
    end_child(name, cast("BaseProcess", child))
    assert not child.is_alive()
    assert child.killed is killed


class Clock:
    """Stands in for the module `time`: it goes on by what is slept."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def monotonic(self) -> float:
        return self.now_s

    def monotonic_ns(self) -> int:
        return int(self.now_s * 1e9)

    def sleep(self, duration_s: float) -> None:
        self.now_s += duration_s


class Child:
    """Lives until it is ended."""

    pid = 1

    def __init__(self) -> None:
        self.exitcode: int | None = None

    def is_alive(self) -> bool:
        return self.exitcode is None

    def kill(self) -> None:
        self.exitcode = -9

    def terminate(self) -> None:
        self.exitcode = 0

    def join(self, timeout: float | None = None) -> None:
        pass


class Trail:
    """Keeps what is recorded."""

    def __init__(self) -> None:
        self.recorded: list[Body] = []

    def emit(self, body: Body) -> None:
        self.recorded.append(body)

    def close(self) -> None:
        """Nothing is open."""


class ShortOfMemory(SessionProcesses):
    """A session on a computer that has no memory for another process at so many attempts."""

    def __init__(self, launch: Launch, clock: Clock, refusals: int) -> None:
        super().__init__(launch)
        self.clock, self.refusals = clock, refusals
        self.attempts_s: list[float] = []
        self._sink.close()
        self.trail = Trail()
        self._sink = cast("AuditSink", self.trail)
        self.children = {name: Child() for name in launch.order}
        self._children = cast("dict[str, BaseProcess]", self.children)

    def _spawn(self, name: str) -> None:
        self.attempts_s.append(self.clock.now_s)
        if len(self.attempts_s) <= self.refusals:
            raise BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN))
        self.children[name] = Child()

    def _must_end(self) -> bool:
        return super()._must_end() or self.clock.now_s > LOADING_S  # a new one would have to report


@pytest.mark.parametrize(("refusals", "attempts"), [(1, 2), (99, len(BACK_OFF_S))])
def test_a_perception_that_can_not_be_started_again_ends_no_session(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, refusals: int, attempts: int
) -> None:
    setup = make_setup(Home(tmp_path), Config(), DEMO_PATIENT, None)
    clock = Clock()
    monkeypatch.setattr(supervise, "time", clock)
    order = ("perception", "control")
    processes = ShortOfMemory(Launch(setup=setup, entry="app.session.child:run_process", order=order), clock, refusals)
    try:
        processes.children["perception"].kill()
        processes.run()
        assert clock.now_s > LOADING_S
        assert processes.children["control"].is_alive()
        assert processes.children["perception"].is_alive() is (attempts > refusals)
        assert len(processes.attempts_s) == attempts
        cause = Reason("ProcessFault.EXITED", {"exit_code": -9})
        assert processes.trail.recorded == [ProcessEnd(pid=1, ended="perception", reason=cause)]
        pauses_s = [after - before for before, after in pairwise(processes.attempts_s)]
        assert pauses_s == pytest.approx([one - 1.0 for one in BACK_OFF_S[1:attempts]], abs=2 / SESSION.rate_hz)
    finally:
        processes.close()


RUN = """
import os, sys
from pathlib import Path
from app.session import child
from app.session.setup import make_setup
from app.system.config import Config
from app.system.paths import Home
from profiles.schema import DEMO_PATIENT
name, folder = sys.argv[1], Path(sys.argv[2])
child.ENTRY_POINTS[name] = "builtins:repr"
child.run_process(name, make_setup(Home(folder), Config(), DEMO_PATIENT, None))
(folder / "leads").write_text(str(os.getsid(0) == os.getpid()))
"""


@pytest.mark.parametrize(
    ("name", "leads"), [("control", True), ("guardian", True), ("audit", True), ("perception", False)]
)
def test_who_is_needed_in_time_does_not_share_its_group_of_processes_with_perception(
    tmp_path: Path, name: str, *, leads: bool
) -> None:
    subprocess.run([sys.executable, "-c", RUN, name, str(tmp_path)], check=True, timeout=60)
    assert (tmp_path / "leads").read_text() == str(leads)


def test_a_session_ends_in_order_though_its_file_can_not_be_removed(tmp_path: Path) -> None:
    home = Home(tmp_path / "home")
    setup = make_setup(home, Config(), DEMO_PATIENT, None)
    take_lease(setup.links)
    launch = Launch(setup=setup, entry="app.session.child:run_process", order=())
    command = [sys.executable, "-m", "app.session.supervise"]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    with subprocess.Popen(command, stdin=subprocess.PIPE, env=environment) as process:
        assert process.stdin is not None
        process.stdin.write(encode(launch))
        process.stdin.close()
        limit_s = time.monotonic() + 60.0
        while not home.session_file.exists():
            assert time.monotonic() < limit_s
            time.sleep(0.01)
        home.session_file.unlink()
        home.session_file.mkdir()
        process.send_signal(signal.SIGTERM)
        assert process.wait(60.0) == 0
    assert not setup.links.path.exists()


def test_what_printed_nothing_leaves_no_file(tmp_path: Path) -> None:
    setup = make_setup(Home(tmp_path), Config(), DEMO_PATIENT, None)
    launched = Launch(setup=setup, entry="app.session.child:run_process", order=("perception", "control"))
    processes = ShortOfMemory(launched, Clock(), 0)
    for name, printed in (("perception", ""), ("control", "a library's warning")):
        output_of(setup, name).parent.mkdir(exist_ok=True)
        output_of(setup, name).write_text(printed)
    processes.close()
    assert [path.name for path in (tmp_path / "diagnostics").iterdir()] == [output_of(setup, "control").name]


def test_a_session_s_own_process_that_printed_nothing_leaves_no_file(tmp_path: Path) -> None:
    home = Home(tmp_path / "home")
    setup = make_setup(home, Config(), DEMO_PATIENT, None)
    process = launch(setup, "app.session.child:run_process", frozenset(START_ORDER))
    limit_s = time.monotonic() + 60.0
    while not home.session_file.exists():
        assert time.monotonic() < limit_s
        time.sleep(0.01)
    assert output_of(setup, "session").exists()
    process.end(60.0)
    process.close()
    assert not output_of(setup, "session").exists()


def test_a_session_whose_process_can_not_be_started_leaves_nothing_open(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    setup = make_setup(Home(tmp_path), Config(), DEMO_PATIENT, None)
    monkeypatch.setattr(sys, "executable", str(tmp_path / "gone"))
    before = set(Path("/proc/self/fd").iterdir())
    with pytest.raises(FileNotFoundError):
        launch(setup, "app.session.child:run_process", frozenset())
    assert set(Path("/proc/self/fd").iterdir()) == before
    shutil.rmtree(setup.links.path)


@pytest.mark.parametrize("room", [1, 2])
def test_a_session_that_runs_out_of_descriptors_leaves_none_open(tmp_path: Path, room: int) -> None:
    setup = make_setup(Home(tmp_path), Config(), DEMO_PATIENT, None)
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    with ExitStack() as stack:
        highest = max(int(one.name) for one in Path("/proc/self/fd").iterdir())
        while (last := stack.enter_context(Path("/dev/null").open()).fileno()) < highest:
            pass
        before = set(Path("/proc/self/fd").iterdir())
        stack.callback(resource.setrlimit, resource.RLIMIT_NOFILE, limits)
        resource.setrlimit(resource.RLIMIT_NOFILE, (last + 1 + room, limits[1]))
        with pytest.raises((OSError, AppError)):
            launch(setup, "app.session.child:run_process", frozenset())
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)
        assert set(Path("/proc/self/fd").iterdir()) == before
    shutil.rmtree(setup.links.path)


GONE = "/gone.toml"
UNUSABLE = [
    JointsConfig(device=GONE),
    JointsConfig(kind="can", interface="local", channel="43113", device=GONE),
    JointsConfig(kind="can", interface="local", channel="43113", motors=GONE),
]


@pytest.mark.parametrize("joints", UNUSABLE)
def test_joints_that_can_not_be_used_are_named_before_anything_starts(
    tmp_path: Path, joints: JointsConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    setup = msgspec.structs.replace(
        make_setup(Home(tmp_path), Config(), DEMO_PATIENT, None), config=Config(joints=joints)
    )
    monkeypatch.setattr(sys, "executable", GONE)
    with pytest.raises(HardwareError, match="gone"):
        launch(setup, "app.session.child:run_process", frozenset())
    shutil.rmtree(setup.links.path)


def test_what_starts_no_control_needs_no_device(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A training."""
    setup = make_setup(Home(tmp_path), Config(joints=JointsConfig(device=GONE)), DEMO_PATIENT, None)
    monkeypatch.setattr(sys, "executable", str(tmp_path / "gone"))
    with pytest.raises(FileNotFoundError):
        launch(setup, "app.session.child:run_process", frozenset({"control"}))
    shutil.rmtree(setup.links.path)


def test_a_disk_that_can_not_be_written_is_named_and_not_the_interpreter(tmp_path: Path) -> None:
    setup = make_setup(Home(tmp_path), Config(), DEMO_PATIENT, None)
    output_of(setup, "session").mkdir(parents=True)
    with pytest.raises(IsADirectoryError) as refused:
        launch(setup, "app.session.child:run_process", frozenset())
    assert refused.value.filename == str(output_of(setup, "session"))
    shutil.rmtree(setup.links.path)
