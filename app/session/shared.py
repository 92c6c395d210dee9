"""What a running session leaves for other terminals: where it is, how it was started, who commands it, and who lives.

The session's file lies in its home, readable by its user alone, while the session runs. The lease lies beside the
session's sockets: the console that takes the next number commands, and control hears no other.
"""

from __future__ import annotations

import fcntl
import os
import select
import signal
from contextlib import closing, suppress
from pathlib import Path
from typing import TypeVar

import msgspec
from msgspec import Struct

from app.ipc.streams import LinkDirectory
from app.system.config import SessionSetup
from app.system.errors import AppError, ConsoleFault
from app.system.paths import Home
from logs.reading.regular import read_bytes

M = TypeVar("M", bound=Struct)

_LEASE = "lease"
_MAX_BYTES = 1 << 20


class Lease(Struct, frozen=True, kw_only=True):
    """The console that commands; number 1 began the session."""

    number: int
    pid: int


class Peer:
    """Another process, child or not, by a descriptor that stays its own when the kernel gives its number away."""

    def __init__(self, pid: int, started: str = "") -> None:
        """One that has ended already is simply not alive.

        started: as `start_of` had it; a later process of that number is not the one.
        """
        self.pid = pid
        self._handle: int | None = None
        with suppress(OSError, ValueError):
            self._handle = os.pidfd_open(pid)
        if started and started != start_of(pid):
            self.close()

    @property
    def alive(self) -> bool:
        """Whether it has not ended yet; a zombie has."""
        return not self.wait(0.0)

    def wait(self, limit_s: float) -> bool:
        """Wait for its end; False when it did not come within the limit."""
        if self._handle is None:
            return True
        poller = select.poll()
        poller.register(self._handle, select.POLLIN)
        return bool(poller.poll(limit_s * 1000))

    def signal(self, number: signal.Signals) -> None:
        """Send a signal; harmless when it has ended."""
        with suppress(OSError):
            if self._handle is not None:
                signal.pidfd_send_signal(self._handle, number)

    def end(self, limit_s: float) -> None:
        """Ask it to end, and kill it when it has not within the limit; take its exit status if it is a child."""
        self.signal(signal.SIGTERM)
        if not self.wait(limit_s):
            self.signal(signal.SIGKILL)
            self.wait(1.0)
        with suppress(ChildProcessError):
            os.waitpid(self.pid, os.WNOHANG)

    def close(self) -> None:
        """Release the descriptor; harmless when done twice."""
        handle, self._handle = self._handle, None
        if handle is not None:
            os.close(handle)


def start_of(pid: int) -> str:
    """Boot and moment at which a process was started: its number is given away again. Empty: there is none."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_bytes().rpartition(b")")[2].split()  # a name may have spaces
        boot = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii").strip()
    except OSError:
        return ""
    return f"{boot} {int(fields[19])}"  # starttime, proc_pid_stat(5), in clock ticks


def share(setup: SessionSetup) -> None:
    """Let other terminals of this home find the session."""
    path = Home(setup.home).session_file
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(".partial")
    handle = os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o600)
    with os.fdopen(handle, "wb") as file:
        file.write(encode(setup))
    partial.replace(path)


def unshare(setup: SessionSetup) -> None:
    """The session ends."""
    Home(setup.home).session_file.unlink(missing_ok=True)


def unshare_dead(setup: SessionSetup) -> None:
    """The session's own process was killed, and left its file with the session's key.

    For one who holds the home's lock, and so begins no other session meanwhile. Any other session's file stays, and
    one whose process lives.
    """
    path = Home(setup.home).session_file
    with suppress(OSError, ValueError, TypeError, RecursionError, msgspec.MsgspecError):
        left = decode(read_bytes(path, _MAX_BYTES), SessionSetup)
        with closing(Peer(left.host_pid, left.host_started)) as host:
            if left.session == setup.session and not host.alive:
                path.unlink()


def shared(home: Home) -> SessionSetup:
    """The running session. Raises AppError when there is none."""
    try:
        content = read_bytes(home.session_file, _MAX_BYTES)
        setup = decode(content, SessionSetup)
    except (OSError, ValueError, TypeError, RecursionError, msgspec.MsgspecError) as error:
        raise AppError(ConsoleFault.NO_SESSION_TO_WATCH, home=home.root) from error
    with closing(Peer(setup.host_pid, setup.host_started)) as host:
        if not (setup.links.path.exists() and host.alive):
            raise AppError(ConsoleFault.SESSION_ENDED, session=setup.session)
    return setup


def held_session(home: Home) -> SessionSetup | None:
    """The session of this home whose console is gone, for one who holds the home's lock; None: there is none."""
    try:
        return shared(home)
    except AppError:
        return None


def take_lease(links: LinkDirectory) -> Lease:
    """Take the next number for this process, one at a time. Raises OSError when the session has ended."""
    handle = os.open(links.path / _LEASE, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        content = os.pread(handle, 256, 0)
        before = msgspec.json.decode(content, type=Lease).number if content else 0
        lease = Lease(number=before + 1, pid=os.getpid())
        os.pwrite(handle, msgspec.json.encode(lease).ljust(64), 0)
    finally:
        os.close(handle)
    return lease


def current_lease(links: LinkDirectory) -> Lease | None:
    """The console that commands; None before the first, and after the session's end."""
    try:
        content = read_bytes(links.path / _LEASE, 256)
        return msgspec.json.decode(content, type=Lease)
    except (OSError, ValueError, msgspec.MsgspecError):
        return None


def encode(value: Struct) -> bytes:
    """A value with paths in it, for `decode`."""
    return msgspec.msgpack.encode(value, enc_hook=_encode)


def decode(content: bytes, kind: type[M]) -> M:
    """Raises MsgspecError."""
    return msgspec.msgpack.decode(content, type=kind, dec_hook=_decode)


def _encode(value: object) -> object:
    if isinstance(value, Path):
        return str(value)
    raise NotImplementedError(type(value))


def _decode(kind: type, value: object) -> object:
    return Path(str(value)) if issubclass(kind, Path) else value
