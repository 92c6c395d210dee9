"""The streams between the processes of a session: where they are, rates and stale limits, defined here only."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from msgspec import Struct

NS_PER_MS = 1_000_000
DAMP_NS = 3_000 * NS_PER_MS  # with nobody there to support, the wearer sinks into the harness before torque goes off


class LinkDirectory(Struct, frozen=True, kw_only=True):
    """A session's directory of sockets (0700) and the key to them, which its processes get with their setup.

    public is a secret as well: who knows it may connect. It is in no argument, environment, log or trail.
    """

    path: Path
    public: bytes  # a CURVE key pair, Z85
    secret: bytes

    def __fspath__(self) -> str:
        return str(self.path)

    def __repr__(self) -> str:
        return f"LinkDirectory({self.path})"


@dataclass(frozen=True, slots=True, kw_only=True)
class Stream:
    """One link: its sender, its rate, and the age from which the receiver calls it stale. 0: on demand."""

    name: str  # of the socket
    sender: str
    rate_hz: float
    stale_ms: float

    @property
    def period_ns(self) -> int:
        """Between two messages."""
        return int(1e9 / self.rate_hz)


# Three missed messages and a margin; the console's limit: a dead console pauses the legs within 250 ms. The heartbeat's
# limit is longer than the stalls of control that the legs survive (docs/safety.md, "How long commands may be missing").
TRIGGER = Stream(name="trigger", sender="perception", rate_hz=30, stale_ms=200)
PREVIEW = Stream(name="preview", sender="perception", rate_hz=12, stale_ms=1000)
SNAPSHOT = Stream(name="snapshot", sender="control", rate_hz=20, stale_ms=300)
OPERATOR = Stream(name="operator", sender="console", rate_hz=20, stale_ms=230)
SESSION = Stream(name="session", sender="session", rate_hz=20, stale_ms=1000)
TO_PERCEPTION = Stream(name="to-perception", sender="console", rate_hz=0, stale_ms=0)
HEARTBEAT = Stream(name="heartbeat", sender="control", rate_hz=250, stale_ms=65)
ABSENT_NS = HEARTBEAT.stale_ms * NS_PER_MS - HEARTBEAT.period_ns  # after so long the guardian may have acted
GUARDIAN = Stream(name="guardian", sender="guardian", rate_hz=20, stale_ms=250)
AUDIT = Stream(name="audit", sender="everyone", rate_hz=0, stale_ms=0)
AUDIT_HEALTH = Stream(name="audit-health", sender="audit", rate_hz=20, stale_ms=400)
LINK = Stream(name="link", sender="link", rate_hz=20, stale_ms=1000)
PLAN_REQUEST = Stream(name="plan-request", sender="control", rate_hz=0, stale_ms=0)
PLAN_REPLY = Stream(name="plan-reply", sender="planner", rate_hz=0, stale_ms=500)
RECORDING = Stream(name="recording", sender="control, perception", rate_hz=0, stale_ms=0)
PICTURES = Stream(name="pictures", sender="perception", rate_hz=0, stale_ms=0)
