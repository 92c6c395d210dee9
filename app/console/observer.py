"""A console that only watches a running session: how it finds the streams, and how a browser shows it."""

from __future__ import annotations

import shlex
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from app.ipc.messages import HandCommand, OperatorKind, PerceptionCommand, ProcessStatus
from app.ipc.states import Action
from app.session.latest import Latest, LatestStreams
from app.session.shared import Peer, shared
from app.system.config import SessionSetup
from app.system.paths import Home
from app.system.scheduling import set_scheduling
from app.text.catalogue import language, tr

if TYPE_CHECKING:
    from textual_serve.server import Server

SPOKEN_EVERY_S = 0.1  # nobody hears more often


class ObserverHost:
    """A host that owns no process and whose orders go nowhere."""

    def __init__(self, setup: SessionSetup) -> None:
        self.setup = setup
        self._streams = LatestStreams(setup)
        self._processes = tuple(  # until the session's process says more
            ProcessStatus(name=name, pid=0, alive=True, restarts=0, exit_code=None)
            for name in ("audit", "guardian", "planner", "control", "perception")
        )
        self._session = Peer(setup.host_pid, setup.host_started)

    @property
    def commands(self) -> bool:
        """An observer's never is."""
        return False

    @property
    def ended(self) -> bool:
        """Whether the session is over; it goes on without some of its processes."""
        return not (self.setup.links.path.exists() and self._session.alive)

    def start(self) -> None:
        """The session runs already."""

    def leave(self) -> None:
        """Stop listening; the session goes on."""
        self.close()

    def close(self) -> None:
        """The same."""
        self._streams.close()
        self._session.close()

    def send(self, kind: OperatorKind, action: Action | None = None, *, input_ns: int | None = None) -> int:  # noqa: ARG002
        """An observer gives no orders."""
        return 0

    def heartbeat(self) -> None:
        """An observer's life means nothing to control."""

    def silence(self) -> None:
        """Nor does its end."""

    def send_to_perception(self, command: HandCommand | PerceptionCommand) -> None:
        """An observer moves nothing, and takes the picture as it is."""

    def poll(self) -> Latest:
        """The newest of each stream."""
        processes = self._streams.processes()
        self._processes = self._processes if processes is None else processes
        if self.ended:
            self._processes = tuple(msgspec.structs.replace(one, alive=False) for one in self._processes)
        return self._streams.receive(self._processes)


def speak_session(home: Home, write: Callable[[str], object]) -> None:
    """Write a line for each change of the running session of this home, until it ends.

    For screen readers and pipes: no terminal, no colours, nothing drawn. Raises AppError when no session runs.
    """
    from app.console.spoken import changes
    from app.console.state import SessionState, fold

    set_scheduling("observer")
    setup = shared(home)
    host = ObserverHost(setup)
    now_ns = time.monotonic_ns()
    before, state = None, SessionState(setup=setup, started_ns=now_ns, now_ns=now_ns)
    try:
        while not host.ended:
            state = fold(state, host.poll(), time.monotonic_ns())
            for line in changes(before, state):
                write(line)
            before = state
            time.sleep(SPOKEN_EVERY_S)
        write(tr("plain.session_ended"))
    finally:
        host.close()


LOOPBACK = "127.0.0.1"
PORT = 8730


def serve_console(home: Home, port: int = PORT) -> None:
    """Serve until Ctrl-C. Raises AppError when no session runs."""
    shared(home)
    browser_server(watching_command(home), port).serve()


def watching_command(home: Home) -> str:
    """What a browser shows, in the language in use."""
    rleex = Path(sys.executable).with_name("rleex")
    return shlex.join([str(rleex), "--language", language(), "run", "--read-only", "--home", str(home.root)])


def browser_server(command: str, port: int) -> Server:
    """Shows a command on a page of ours.

    textual-serve's is 980 pixels wide on a phone, and asks for a font from elsewhere.
    """
    from textual_serve.server import Server

    page = Path(__file__).with_name("templates")
    return Server(command, host=LOOPBACK, port=port, title="rleex (read-only)", templates_path=page)
