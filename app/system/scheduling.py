"""What makes Linux processes punctual: scheduling, memory that stays, a core; each where it is allowed."""

from __future__ import annotations

import ctypes
import gc
import os
import resource
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from app.ipc.snapshot import RealTime


@dataclass(frozen=True, slots=True)
class SchedPolicy:
    """When a process runs: before everything usual by a SCHED_FIFO priority, or among it by a niceness.

    inherited: by threads and processes that it starts; else they have the usual policy, with a niceness of at least 0.
    """

    fifo: int | None = None
    nice: int = 0
    inherited: bool = True


# FIFO stays below the kernel's own threads at 99.
SCHEDULING = MappingProxyType(
    {
        "guardian": SchedPolicy(fifo=70),  # a control that spins must not keep the guardian from a core
        "control": SchedPolicy(fifo=60),
        "planner": SchedPolicy(fifo=30),  # a step waits for its short work
        "heartbeat": SchedPolicy(fifo=20),  # a busy machine must not look like a dead console
        "link": SchedPolicy(fifo=20),  # carries both
        "perception": SchedPolicy(nice=-10),  # the wearer's command must not wait for the screen, or for other programs
        "session": SchedPolicy(nice=-10),  # it watches perception; its group of processes against other terminals'
        "audit": SchedPolicy(nice=-10),  # needs little, but a trail that falls behind stops the legs
        # The event loop's thread alone: while it holds the interpreter's lock without a core, heartbeat and STOP wait.
        "console": SchedPolicy(fifo=10, nice=-5, inherited=False),
        "observer": SchedPolicy(nice=5),  # another console on this host must not keep the therapist's waiting
        "rehearsal": SchedPolicy(nice=5),  # half a minute of physics, while somebody presses keys
        "recording": SchedPolicy(nice=5),  # its queue holds 20 s
        "bus log": SchedPolicy(nice=5),  # its socket holds a second's frames: it can wait, perception can't
    }
)
_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4
_PR_SET_TIMERSLACK = 29
WAKE_LATENCY = Path("/dev/cpu_dma_latency")  # the kernel's PM QoS interface: an int32, the longest wake-up in µs
_ISOLATED = Path("/sys/devices/system/cpu/isolated")
_AUTOGROUP = Path("/proc/self/autogroup")


def acquire_real_time() -> RealTime:
    """Acquire what the system allows, and return what it was. Call before threads are started: they inherit it."""
    fifo, locked = _fifo(), _lock_memory(_MCL_CURRENT | _MCL_FUTURE)
    return RealTime(fifo=fifo, memory_locked=locked, cores_awake=request_low_wake_latency(), core=None)


def lock_touched_memory() -> bool:
    """Lock each page once it is touched; whether that was allowed. Idle pages may have to be read from the disk."""
    return _lock_memory(_MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT)


def set_scheduling(name: str) -> bool:
    """Give this thread, and most of those it starts later, that policy of `SCHEDULING`; whether that was allowed."""
    policy = SCHEDULING[name]
    allowed = policy.fifo is None or _set_fifo(policy.fifo, inherited=policy.inherited)
    try:
        os.setpriority(os.PRIO_PROCESS, 0, policy.nice)  # not `nice`: a child inherits its parent's
    except PermissionError:
        return allowed and policy.fifo is not None  # a niceness means nothing to SCHED_FIFO
    return allowed


def _set_fifo(priority: int, *, inherited: bool) -> bool:
    policy = os.SCHED_FIFO if inherited else os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
    try:
        os.sched_setscheduler(0, policy, os.sched_param(priority))
    except PermissionError:
        return False
    return True


def call_with_scheduling(name: str, call: Callable[[], object]) -> None:
    """Call it in a thread of that policy: threads that it starts inherit the policy, the caller keeps its own."""

    def run() -> None:
        set_scheduling(name)
        call()

    thread = threading.Thread(target=run, name=f"start {name}")
    thread.start()
    thread.join()


def set_autogroup_nice(name: str, autogroup: Path = _AUTOGROUP) -> bool:
    """Weigh this login session's group of processes by that policy's niceness; whether that was allowed.

    Where the kernel groups processes by login session (sched_autogroup, sched(7)), a niceness counts only inside its
    group: a busy program of another terminal would get as much as a whole session of ours.
    """
    try:
        autogroup.write_text(f"{SCHEDULING[name].nice}\n", encoding="ascii")
    except OSError:
        return False
    return True


def start_autogroup(name: str, autogroup: Path = _AUTOGROUP) -> None:
    """Leave the group of the processes that started this one for one of its own, weighed by that policy's niceness.

    Linux shares the cores between groups first: in one with perception, which on a busy machine needs more than the
    group's share, who needs little waits as long. SCHED_FIFO is above all groups, but not everybody is allowed it.
    """
    with suppress(PermissionError):  # it leads one already
        os.setsid()
    set_autogroup_nice(name, autogroup)


@contextmanager
def autogroup_nice(name: str, autogroup: Path = _AUTOGROUP) -> Iterator[bool]:
    """The same while the body runs, for a group that other programs share; whether that was allowed."""
    before = _nice_of(autogroup)
    allowed = before is not None and set_autogroup_nice(name, autogroup)
    try:
        yield allowed
    finally:
        if allowed:
            with suppress(OSError):  # the terminal and its group may be gone
                autogroup.write_text(f"{before}\n", encoding="ascii")


def _nice_of(autogroup: Path) -> int | None:
    """Of "/autogroup-7 nice 0"; None where the kernel has no such groups."""
    try:
        return int(autogroup.read_text(encoding="ascii").split()[-1])
    except (OSError, ValueError, IndexError):
        return None


def request_low_wake_latency(wake_latency: Path = WAKE_LATENCY) -> bool:
    """Let no idle core fall asleep while this process lives; whether that was allowed.

    A core asleep is late for its tick, most of all a virtual machine's, which its host lends to others meanwhile. The
    file is never closed: that would end the request.
    """
    try:
        request = os.open(wake_latency, os.O_WRONLY)
    except OSError:
        return False
    return os.write(request, struct.pack("@i", 0)) > 0


def pin_to_control_core(wanted: int | None = None) -> int | None:
    """The core that this thread has from now on, None where it shares all. wanted: as `control_core` takes it.

    With real time call it after threads are started: a link's thread on the same core would send the heartbeat only
    between two ticks. Without it before: on another core that thread would wait behind perception.
    """
    core = control_core(wanted)
    if core is None:
        return None
    try:
        os.sched_setaffinity(0, {core})
    except OSError:
        return None
    return core


def avoid_control_core(wanted: int | None = None) -> None:
    """For perception, whose running detection every tick would delay."""
    core = control_core(wanted)
    others = os.sched_getaffinity(0) - {core}
    if core is not None and others:
        with suppress(OSError):
            os.sched_setaffinity(0, others)


def place_guardian(wanted: int | None = None, *, real_time: bool) -> None:
    """Off control's core where the guardian goes before control, and would make one tick of fifty late.

    Without real time nothing goes before busy programs, and control's core is the one that perception leaves alone.
    """
    if real_time:
        avoid_control_core(wanted)
    else:
        pin_to_control_core(wanted)


def control_core(wanted: int | None = None) -> int | None:
    """The wanted one, else one that the kernel sets apart, else the last of several; None where there is but one.

    wanted: the configuration's; one that this process may not use counts as none.
    """
    inherited = os.sched_getaffinity(0)
    shared = sorted(inherited) if len(inherited) > 1 else []
    isolated = [core for core in _isolated_cores() if core in shared or _may_have(core, inherited)]
    if wanted is not None and wanted in (*shared, *isolated):
        return wanted
    return next(iter((*isolated[-1:], *shared[-1:])), None)


def _may_have(core: int, inherited: set[int]) -> bool:
    """Whether this thread may go to a core: nobody inherits an isolated one, and a cpuset may leave it out."""
    try:
        os.sched_setaffinity(0, {core})
    except OSError:
        return False
    os.sched_setaffinity(0, inherited)
    return True


def gc_freeze() -> None:
    """Leave what lives now out of every later collection: a whole one took perception 50 ms, and 200 on a busy core."""
    gc.collect()
    gc.freeze()


def disable_gc() -> None:
    """No collection in the loop at all, which makes no cycles."""
    gc_freeze()
    gc.disable()


@dataclass(slots=True)
class PeriodicTimer:
    """Absolute deadlines at a fixed period: a late tick shifts no later one, whole missed periods are left out."""

    period_ns: int
    next_ns: int

    def wait(self) -> tuple[int, int, int]:
        """Sleep until the next deadline: (now_ns, late_ns, periods left out)."""
        ahead_ns = self.next_ns - time.monotonic_ns()
        if ahead_ns > 0:
            time.sleep(ahead_ns / 1e9)
        now_ns = time.monotonic_ns()
        late_ns = max(0, now_ns - self.next_ns)
        missed = late_ns // self.period_ns
        self.next_ns += (missed + 1) * self.period_ns
        return now_ns, late_ns, missed


def _fifo() -> bool:
    allowed = set_scheduling("control")
    if not allowed:  # the kernel may then delay a sleeper by its timer slack of 50 µs on top of everything else
        ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, 1)
    return allowed


def _lock_memory(flags: int) -> bool:
    """Only without a limit: with one, MCL_FUTURE would make a later allocation fail instead of being late."""
    limit, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    if limit != resource.RLIM_INFINITY and os.geteuid() != 0:
        return False
    return bool(ctypes.CDLL(None).mlockall(flags) == 0)


def _isolated_cores() -> list[int]:
    """From the kernel's list, e.g. `2-3,7`."""
    try:
        text = _ISOLATED.read_text(encoding="ascii").strip()
    except OSError:
        return []
    cores: list[int] = []
    for part in filter(None, text.split(",")):
        first, _, last = part.partition("-")
        cores.extend(range(int(first), int(last or first) + 1))
    return cores


# Linux's oom_score_adj, −1000 to 1000. Higher ones may be taken by anybody, lower ones only with the privilege.
SCORES = {
    "perception": 700,  # the largest, and started again: the running action ends, no further one by gesture
    "planner": 500,
    "bus-log": 400,
    "recording": 400,
    "audit": 200,
    "link": -700,
    "session": -800,  # without it all the others end, in order
    "guardian": -900,
    "control": -900,
}
_MINE = Path("/proc/self/oom_score_adj")


def set_oom_score_adj(name: str) -> None:
    """Take this process's place; without the privilege the two that hold the legs keep the place they were born to."""
    score = SCORES.get(name)
    if score is not None:
        with suppress(OSError):
            _MINE.write_text(f"{score}\n", encoding="ascii")
