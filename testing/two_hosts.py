"""Both computers of a session for tests and benches: `rleex joints` as a process, a laptop's session beside it."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from app.demo.two_hosts import joints_process, pair_both, wait_for
from app.ipc import streams
from app.ipc.links import LatestReceiver, address
from app.ipc.messages import LinkHealth, OperatorKind
from app.ipc.states import Action
from app.session.host import SessionHost
from app.session.latest import Latest
from app.session.setup import make_setup
from app.system.authority import demonstration
from app.system.config import Config, JointsConfig
from app.system.paths import Home
from profiles.schema import DEMO_PATIENT
from testing.watched_session import WatchedSession

UNATTENDED_S = 60.0


class TwoHosts(WatchedSession):
    """The laptop's end; its console is this process. Control's snapshots come over the link."""

    def __init__(self, home: Path, host: str, joints_pid: int) -> None:
        """joints_pid: of `rleex joints`."""
        config = Config(joints=JointsConfig(host=host), unattended_s=UNATTENDED_S)
        self.setup = make_setup(Home(home), config, DEMO_PATIENT, demonstration(Home(home), config.joints, "bench"))
        self.console = SessionHost(self.setup, without=frozenset({"perception"}))
        self.latest: Latest | None = None
        self.link: LinkHealth | None = None
        self.joints_pid = joints_pid
        self._health = LatestReceiver(address(self.setup.links, streams.LINK.name), LinkHealth)
        super().__init__(self.setup.links)

    def send(self, kind: OperatorKind, action: Action | None = None) -> None:
        """Send an operator command."""
        self.console.send(kind, action)

    def poll(self, wait_s: float = 0.02) -> None:
        """As the base, and say that STOP can be given."""
        self.console.heartbeat()
        super().poll(wait_s)
        self.latest = self.console.poll()
        self.link = self._health.receive() or self.link

    def go_on(self, seconds: float) -> None:
        """What the link does needs its time; the console goes on meanwhile."""
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            self.poll()

    def stop_acknowledged_s(self, limit_s: float = 30.0) -> float:
        """Press STOP and wait until the console shows it as acknowledged; how long that took."""
        self.console.send(OperatorKind.STOP)
        return self.until_acknowledged(limit_s)

    def until_acknowledged(self, limit_s: float = 30.0) -> float:
        """Poll until no STOP waits for control; how long that took. Raises TimeoutError."""
        began = time.monotonic()
        while True:
            self.poll(0.002)
            if self.latest is not None and not self.latest.stop_sent_ns:
                return time.monotonic() - began
            if time.monotonic() - began > limit_s:
                raise TimeoutError(f"STOP was not acknowledged: {self.link}")

    def until_link(self, wanted: str, limit_s: float = 30.0) -> LinkHealth:
        """Poll until an attribute of the link's health is true."""
        deadline = time.monotonic() + limit_s
        while time.monotonic() < deadline:
            self.poll()
            if self.link is not None and getattr(self.link, wanted):
                return self.link
        raise TimeoutError(f"{wanted} did not come: {self.link}")

    def close(self) -> None:
        """End the session on both computers."""
        self.console.close()
        self._health.close()
        self.close_links()


@contextmanager
def two_hosts(laptop: Path, joints: Path, port: int, *, host: str, prefix: Sequence[str] = ()) -> Iterator[TwoHosts]:
    """A session over the link while the body runs; both homes exist, the joints' one has its configuration.

    port: of `rleex joints`. host: the laptop's way to it. prefix: a command that runs it, as into another namespace.
    """
    with joints_process(Home(joints), port, prefix=prefix) as process:
        wait_for(host, lambda: process.poll() is None)
        pair_both(Home(laptop), Home(joints), host)
        session = TwoHosts(laptop, host, process.pid)
        try:
            session.console.start()
            session.until(lambda now: bool(now.allowed or now.why_not), "control's snapshot over the link")
            yield session
        finally:
            session.close()
