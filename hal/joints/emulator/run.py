"""The emulator as a process of its own: what `rleex emulate-drives` and the demo start."""

from __future__ import annotations

import gc
import os
import signal
import time
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import TYPE_CHECKING

from hal.joints.can.bus import with_bus
from hal.joints.device import Exoskeleton
from hal.joints.emulator.emulator import DriveEmulator
from hal.joints.emulator.faults import ScheduledFault
from hal.joints.emulator.plant import make_plant
from hal.joints.emulator.scenes import SceneReceiver

_SCENE_POLLS = 4  # an action's plan takes longer than these few milliseconds
_PRIORITY = 50  # below control: a late body must not delay a tick

if TYPE_CHECKING:
    from hal.joints.body import Body


def run_emulator(
    device: Exoskeleton,
    interface: str = "",
    channel: str = "",
    *,
    body: Body | None = None,
    motors: Path | None = None,
    schedule: tuple[ScheduledFault, ...] = (),
    ready: Event | None = None,
    stop: Event | None = None,
    each_second: Callable[[DriveEmulator], None] | None = None,
) -> None:
    """Emulate the device's drives until `stop` is set, the process is told to end, or its parent is gone.

    With a `body` the simulated exoskeleton hangs behind the drives, else free legs. `ready` is set once the bus is
    joined. Raises HardwareError when a bus can't be opened.
    """
    device = with_bus(device, interface, channel)
    plant = make_plant(device, body)
    emulator = DriveEmulator(device, plant, motors)
    scenes = SceneReceiver(device)
    told = _Ending(stop, each_second, emulator)

    def stopped() -> bool:
        if told.asked % _SCENE_POLLS == 0 and (scene := scenes.receive()) is not None:
            plant.stage(scene)
        return told()

    try:
        emulator.open()
        _hurry()
        _spare_garbage()
        if ready is not None:
            ready.set()
        emulator.run(stopped, schedule)
    finally:
        emulator.close()
        scenes.close()


class _Ending:
    """Asked before every poll: whether to end; looks at the slow things once in a while only."""

    def __init__(
        self, stop: Event | None, each_second: Callable[[DriveEmulator], None] | None, emulator: DriveEmulator
    ) -> None:
        self._parent = os.getppid
        self._parent_at_start = os.getppid()
        self._stop = stop
        self._each_second = each_second
        self._emulator = emulator
        self.asked = 0
        self._second_s = time.monotonic()
        self._ended = False
        signal.signal(signal.SIGTERM, self._end)

    def _end(self, _number: int, _frame: object) -> None:
        self._ended = True

    def __call__(self) -> bool:
        self.asked += 1
        if self.asked % 50 == 0:
            self._ended = self._ended or self._parent() != self._parent_at_start
            self._ended = self._ended or (self._stop is not None and self._stop.is_set())
            if self._each_second is not None and time.monotonic() - self._second_s >= 1.0:
                self._second_s = time.monotonic()
                self._each_second(self._emulator)
        return self._ended


def _hurry() -> None:
    """Drives answer within a fraction of a millisecond: where the privilege exists, so does their emulation.

    On whichever core is free: pinned to control's, where the kernel's and the host's moments leave too little for both,
    the drives fell silent; as a usual program there as well.
    """
    with suppress(OSError, AttributeError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))


def _spare_garbage() -> None:
    """With MuJoCo loaded a full collection takes so long that four drives pass for silent."""
    gc.collect()
    gc.freeze()
