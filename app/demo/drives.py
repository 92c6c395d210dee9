"""What runs beside the demo in processes of its own: drives emulated on a CAN bus, and load."""

from __future__ import annotations

import multiprocessing
import os
import random
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from enum import Enum
from pathlib import Path

import msgspec

from app.motion.plan import body_of
from app.system.config import Config, JointsConfig, JointsKind, load_device
from app.system.errors import AppError
from hal.joints.emulator.emulator import run_emulator
from profiles.schema import DEMO_PATIENT, Profile


class DemoFault(Enum):
    """Why the demo can't go on."""

    DRIVES_NOT_STARTED = "drives not started"
    PROCESSES_ENDED = "processes ended"
    CONTROL_SILENT = "control silent"
    NO_PICTURE = "no picture"
    NOT_ARMED = "not armed"
    NOT_PREPARED = "not prepared"
    LOAD_ENDED = "load ended"


@contextmanager
def joints_for(kind: JointsKind, base: Config, wearer: Profile) -> Iterator[JointsConfig]:
    """The joints' configuration; for `can` the drives are emulated, with the wearer's body on them."""
    if kind == "simulated":
        yield JointsConfig(kind="simulated", device=base.joints.device)
        return
    with emulated_drives(base.joints, wearer=wearer) as joints:
        yield joints


INTERFACE = "local"  # needs no vcan, and costs less a frame than udp_multicast
START_S = 30.0  # importing MuJoCo on a busy machine


def private_channels(count: int) -> str:
    """Channels that nobody else on this host is likely to use, separated by commas."""
    return ",".join(map(str, random.SystemRandom().sample(range(20_000, 60_000), count)))


@contextmanager
def emulated_drives(base: JointsConfig, *, wearer: Profile | None = DEMO_PATIENT) -> Iterator[JointsConfig]:
    """The configuration that reaches the emulated drives, on which the wearer's body hangs; None: nobody's.

    Raises AppError when the emulator does not start.
    """
    device = load_device(base)
    channel = private_channels(len(device.buses))
    spawning = multiprocessing.get_context("spawn")
    ready, stop = spawning.Event(), spawning.Event()
    process = spawning.Process(
        target=run_emulator,
        args=(device, INTERFACE, channel),
        kwargs={
            "body": body_of(wearer) if wearer is not None else None,
            "motors": Path(base.motors) if base.motors else None,
            "ready": ready,
            "stop": stop,
        },
        name="emulated drives",
        daemon=True,
    )
    process.start()
    try:
        if not ready.wait(START_S):
            raise AppError(DemoFault.DRIVES_NOT_STARTED)
        yield msgspec.structs.replace(base, kind="can", interface=INTERFACE, channel=channel)
    finally:
        stop.set()
        process.join(5.0)
        if process.is_alive():
            process.terminate()
            process.join(5.0)


# Ends by itself once its parent is gone, however that ended. The parent's own niceness is not inherited, unless the
# user may not take it back.
_BUSY = """
import contextlib, os, sys
with contextlib.suppress(PermissionError):
    os.setpriority(os.PRIO_PROCESS, 0, 0)
while os.getppid() == int(sys.argv[1]):
    for _ in range(1_000_000):
        pass
"""


@contextmanager
def busy_processes(count: int) -> Iterator[tuple[int, ...]]:
    """Keep that many processes busy while the body runs; their PIDs. Raises AppError when one ended before the body."""
    started = [subprocess.Popen([sys.executable, "-c", _BUSY, str(os.getpid())]) for _ in range(count)]
    try:
        yield tuple(process.pid for process in started)
        if any(process.poll() is not None for process in started):
            raise AppError(DemoFault.LOAD_ENDED)
    finally:
        for process in started:
            process.kill()
            process.wait()
