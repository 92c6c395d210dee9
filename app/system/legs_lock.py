"""The lock of the legs: held by everybody who may still command or damp them, for one session at a time.

The host takes it alone and then shares it with its control and its guardian, each with a lock of its own: whoever
outlives the host keeps the next session off the home and off the drives. The kernel drops a lock with its process.
"""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterable
from contextlib import closing, suppress
from pathlib import Path

from app.system.config import SessionSetup, load_device
from app.system.errors import AppError
from app.system.files import open_lock
from app.system.paths import Home, LockFault
from hal.errors import CanFault, HardwareError
from hal.joints.device import UNSHARED_INTERFACES, Exoskeleton

# Drives are the same to every user and every home of a host. Each folder that can be written to: not every user may
# write to the first.
HOST_FOLDERS = (Path("/run/lock"), Path("/tmp"))
SERVES_ALL = 0o644  # the next user must find the bus taken, whoever made its file
_HELD = Path("/proc/locks")


class LegsLock:
    """Open files whose locks end with `close`, or with the process."""

    def __init__(self, paths: Iterable[Path]) -> None:
        """Open the files, not locked yet. Raises AppError."""
        self._files: list[tuple[Path, int]] = []
        for path in paths:
            try:
                self._files.append((path, open_lock(path, SERVES_ALL)))
            except OSError as error:
                self.close()
                raise AppError(LockFault.UNUSABLE, home=path, detail=error.strerror) from error

    def take_alone(self) -> None:
        """Nobody else may hold it, and from then on nobody else can take it alone. Raises AppError."""
        self._lock(fcntl.LOCK_EX)
        self.share()  # not atomic: one who came between has it alone, and then this raises

    def share(self) -> None:
        """Beside others of this session. Raises AppError when another session has it."""
        self._lock(fcntl.LOCK_SH)

    def close(self) -> None:
        """Release it; harmless when done twice."""
        files, self._files = self._files, []
        for _, handle in files:
            os.close(handle)

    def _lock(self, how: int) -> None:
        for path, handle in self._files:
            try:
                fcntl.flock(handle, how | fcntl.LOCK_NB)
            except BlockingIOError:
                holders = _holders(handle)
                self.close()
                raise AppError(LockFault.LEGS_HELD, pid=", ".join(map(str, holders)) or "?", path=path) from None
            except OSError as error:
                self.close()
                raise AppError(LockFault.UNUSABLE, home=path, detail=error.strerror) from error


def claim_legs(setup: SessionSetup) -> LegsLock:
    """For the host of a new session. Raises AppError while anybody of another one may still command or damp.

    Raises HardwareError for a bus that a session's programs can't share, and for two buses that would be one.
    """
    return _claim(Home(setup.home), lock_paths(setup))


def claim_buses(home: Home, device: Exoskeleton) -> LegsLock:
    """For a command that asks the drives. Raises AppError while a session has this home or one of these buses."""
    return _claim(home, (home.legs_lock, *_bus_locks(device)))


def _claim(home: Home, paths: Iterable[Path]) -> LegsLock:
    home.root.mkdir(parents=True, exist_ok=True)
    lock = LegsLock(paths)
    lock.take_alone()
    return lock


def share_legs(setup: SessionSetup) -> LegsLock:
    """For control and guardian, to their end. Raises AppError when another session has the legs."""
    lock = LegsLock(lock_paths(setup))
    lock.share()
    return lock


def check_legs_free(home: Home) -> None:
    """Raises AppError while control or guardian of an earlier session of this home live."""
    with closing(LegsLock([home.legs_lock])) as lock:
        lock.take_alone()


def lock_paths(setup: SessionSetup) -> tuple[Path, ...]:
    """The home's, and one for each bus of real drives; those of another computer are that one's to lock."""
    joints = setup.config.joints
    at_home = (Home(setup.home).legs_lock,)
    if joints.kind == "simulated" or setup.joints_elsewhere:
        return at_home
    from hal.joints.can.bus import with_bus  # brings python-can: not before the console's first paint

    device = with_bus(load_device(joints), joints.interface, joints.channel)
    for bus in device.buses:
        if bus.interface in UNSHARED_INTERFACES:
            raise HardwareError(CanFault.NOT_SHARED, bus=bus.channel, interface=bus.interface)
    return (*at_home, *_bus_locks(device))


def _bus_locks(device: Exoskeleton) -> tuple[Path, ...]:
    folders = [one for one in HOST_FOLDERS if os.access(one, os.W_OK)] or HOST_FOLDERS[-1:]
    buses = dict.fromkeys(f"rleex-{bus.interface}-{bus.channel}".replace("/", "-") for bus in device.buses)
    return tuple(folder / f"{bus}.lock" for folder in folders for bus in buses)


def _holders(handle: int) -> list[int]:
    """The processes that hold a lock on an open file; empty where the kernel does not tell."""
    file = os.fstat(handle)
    name = f"{os.major(file.st_dev):02x}:{os.minor(file.st_dev):02x}:{file.st_ino}"
    with suppress(OSError):
        rows = [line.split() for line in _HELD.read_text(encoding="ascii").splitlines()]
        found = [row for row in rows if row[1] == "FLOCK" and row[5].rsplit(":", 1)[-1] == str(file.st_ino)]
        here = [row for row in found if row[5] == name]
        return [int(row[4]) for row in here or found]  # btrfs gives a file another device than its locks
    return []
