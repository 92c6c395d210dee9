"""How late this machine wakes a real-time thread that does nothing else: the floor under every tick lateness.

A bare loop of control's rate and priority, the cores kept awake as in a session. Where this is late, control is
late too, drives emulated here fall silent, and nothing in the program can mend it. Run it beside the load in question.

    python tools/bench_host.py [--seconds 40] [--let-sleep]
"""

from __future__ import annotations

import gc
import multiprocessing
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection

import numpy as np
import psutil
import typer

from app.system.scheduling import request_low_wake_latency

TICK_NS = 2_000_000
PRIORITY = 80  # above all that the project asks for


def wake(going: Callable[[int], bool]) -> list[float]:
    """Lateness of every wake-up, ms, as long as `going` says of the monotonic time; after a late one the beat

    starts anew.
    """
    late_ms: list[float] = []
    due_ns = time.monotonic_ns()
    while going(due_ns):
        due_ns += TICK_NS
        time.sleep(max(0, due_ns - time.monotonic_ns()) / 1e9)
        late_ns = time.monotonic_ns() - due_ns
        late_ms.append(late_ns / 1e6)
        if late_ns > TICK_NS:
            due_ns += late_ns
    return late_ms


def _real_time() -> str:
    gc.disable()
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except PermissionError:
        return "no real-time privilege"
    return "SCHED_FIFO"


def _wake_beside(ends: Connection) -> None:
    _real_time()
    ends.send(wake(lambda _: not ends.poll()))


@contextmanager
def bare_loop() -> Iterator[dict[str, float]]:
    """The loop in a process of its own beside whatever is done; p99_ms and p999_ms are there once it is over."""
    figures: dict[str, float] = {}
    ours, its = multiprocessing.Pipe()
    loop = multiprocessing.get_context("spawn").Process(target=_wake_beside, args=(its,), daemon=True)
    loop.start()
    try:
        yield figures
    finally:
        ours.send(None)
        p99, p999 = np.percentile(ours.recv(), (99, 99.9)).tolist()
        figures.update(p99_ms=p99, p999_ms=p999)
        loop.join()


def main(seconds: float = 40.0, let_sleep: bool = False) -> None:
    """Print the lateness and whether the privilege was there."""
    privilege = _real_time()
    awake = not let_sleep and request_low_wake_latency()
    stolen_before_s, end_ns = psutil.cpu_times().steal, time.monotonic_ns() + int(seconds * 1e9)
    late_ms = np.array(wake(lambda now_ns: now_ns < end_ns))
    stolen_s = psutil.cpu_times().steal - stolen_before_s
    p50, p99, p999 = np.percentile(late_ms, (50, 99, 99.9))
    print(f"{privilege}, cores {'kept awake' if awake else 'free to sleep'}: {len(late_ms)} wake-ups")
    print(f"late by p50 {p50:.3f}, p99 {p99:.3f}, p99.9 {p999:.2f}, at most {late_ms.max():.1f} ms")
    print(f"late by more than a tick: {(late_ms > 2).sum()}, by more than 15 ms: {(late_ms > 15).sum()}")
    print(f"the hypervisor took {1e3 * stolen_s / seconds:.0f} ms a second from the cores, all together")


if __name__ == "__main__":
    typer.run(main)
