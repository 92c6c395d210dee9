"""When emulated drives run: a real drive answers within a fraction of a millisecond, whatever the host does."""

from __future__ import annotations

import ctypes
import os
import platform
import struct
from contextlib import suppress

_FIFO = 50  # below control: a late body must not delay a tick
_NICE = -20
_SLICE_NS = 100_000  # the shortest; who asks for shorter slices is let in sooner (Linux 6.12)
_SETATTR = {"x86_64": 314, "aarch64": 274}  # sched_setattr(2), which os does not offer
_ATTRIBUTES = struct.Struct("=IIQiIQQQ")  # size, policy, flags, nice, priority, runtime, deadline, period


def take_turn(core: int | None) -> None:
    """Run soon, where that is allowed: as a real-time process anywhere, or on the core of who commands the drives.

    There they run while he sleeps, and leave the other cores alone. But two real-time processes that fill a core are
    both put off by the kernel, for 50 ms of each second, so that usual programs get their share: on his core the drives
    are a usual program, the one that is let in first.
    """
    with suppress(OSError, AttributeError):  # without the privilege a core of his would only mean waiting for it
        if core is None:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_FIFO))
            return
        os.setpriority(os.PRIO_PROCESS, 0, _NICE)
        os.sched_setaffinity(0, {core})
        _shorten_slice()


def _shorten_slice() -> None:
    """Older kernels take no notice of it."""
    number = _SETATTR.get(platform.machine())
    if number is not None:
        attributes = _ATTRIBUTES.pack(_ATTRIBUTES.size, os.SCHED_OTHER, 0, _NICE, 0, _SLICE_NS, 0, 0)
        ctypes.CDLL(None).syscall(number, 0, attributes, 0)
