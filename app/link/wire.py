"""What crosses the link, frames over TCP (ZeroMQ, CURVE) and sealed packets over UDP on one port; and its faults.

Frames carry what must arrive, in order, once, and what only the newest is wanted of; packets carry STOP, heartbeats
and the clocks' moments, every 20 ms, in each direction.
"""

from __future__ import annotations

import re
from enum import Enum, auto
from importlib.metadata import version

from msgspec import Struct

from app.ipc.messages import AuditHealth, GuardianHealth, OperatorCommand, OperatorKind, ProcessStatus, TriggerReport
from app.ipc.snapshot import ControlSnapshot
from app.system.errors import AppError
from logs.reason import Reason
from profiles.schema import Profile

VERSION = 8  # of the messages here and of those that they carry; another one is refused
PORT = 7447
FRAMES_IN_FLIGHT = 6  # more would be a backlog after a cut: what is newer replaces what could not be sent
COMMANDS_A_FRAME = 16
_ADDRESS = re.compile(r"(?P<host>[A-Za-z0-9]([A-Za-z0-9.-]{0,251}[A-Za-z0-9])?)(:(?P<port>[0-9]{1,5}))?")


class LinkFault(Enum):
    """What the link refuses or misses."""

    BAD_ADDRESS = auto()  # address
    UNKNOWN_HOST = auto()  # host, detail
    NOBODY_ANSWERS = auto()  # host, limit_s
    NOT_PAIRED = auto()  # host
    NOT_ADMITTED = auto()  # host
    OLDER_HERE = auto()  # host, here, there
    OLDER_THERE = auto()  # host, here, there
    ANOTHER_LAPTOP = auto()  # session
    SESSION_RUNS = auto()  # session
    SESSION_OVER = auto()  # session
    HELD_FOR_LAPTOP = auto()  # session
    NAME_INVALID = auto()
    SIGN_IN_NEEDED = auto()
    NOT_STARTED = auto()  # detail
    PORT_TAKEN = auto()  # port, detail
    HOST_HAS_HOST = auto()  # host
    CODE_WRONG = auto()  # left
    CODE_USED_UP = auto()
    CODE_MALFORMED = auto()
    NO_CODE = auto()  # host
    NO_SERVICE = auto()  # home, port
    NO_SUCH_PEER = auto()  # name
    AMBIGUOUS_PEER = auto()  # name
    KEYS_DAMAGED = auto()  # path


class LinkNotice(Enum):
    """What the link's process notes in the trail."""

    LAPTOP_CAME = auto()  # laptop
    LINK_RETURNED = auto()  # silent_s; the legs are held
    PACKETS_RETURNED = auto()  # silent_s; of the laptop, which can't tell whether the other way was lost as well
    COMMAND_STALE = auto()  # command, age_s
    COMMANDS_LOST = auto()
    PEER_REFUSED = auto()  # why
    CLOCK_STEPPED = auto()  # step_s
    OTHER_CLOCK_STEPPED = auto()  # step_s


def split_address(text: str) -> tuple[str, int]:
    """Host, in small letters, and port of `exo.local:7447`; without a port the usual one. Raises AppError."""
    match = _ADDRESS.fullmatch(text)
    port = int(match["port"] or PORT) if match else 0
    if match is None or not 0 < port < 65536:
        raise AppError(LinkFault.BAD_ADDRESS, address=text)
    return match["host"].lower(), port


def program() -> str:
    """The program's own version, to be shown."""
    return version("rleex")


class SessionRequest(Struct, frozen=True, kw_only=True):
    """The session whose legs are asked for; joints, device, buttons and home are the other computer's own."""

    session: str
    profile: Profile
    operator: str
    role: str
    signed_in: bool  # an operator has; else only joints that harm nobody are moved


class Hello(Struct, frozen=True, kw_only=True, tag="hello"):
    """Laptop to joints, first on every connection."""

    link: int
    program: str
    request: SessionRequest
    operator: str = ""  # who commands after a takeover at the laptop; empty: who began the session


class Welcome(Struct, frozen=True, kw_only=True, tag="welcome"):
    """Joints to laptop: the session runs or is being started; packets are sealed with this key from now on."""

    link: int
    program: str
    connection: int
    packet_key: bytes


class Refused(Struct, frozen=True, kw_only=True, tag="refused"):
    """Joints to laptop: no, and asking again is no use."""

    reason: Reason


class ToJoints(Struct, frozen=True, kw_only=True, tag="to-joints"):
    """One frame from the laptop."""

    number: int
    acknowledged: int  # the newest frame that came from the joints
    report: TriggerReport | None = None
    first_command: int = 0  # the count of the first of `commands`
    commands: tuple[OperatorCommand, ...] = ()  # all that were not acknowledged yet, oldest first
    audit: AuditHealth | None = None  # of the laptop's trail
    ends: bool = False  # the session is to end


class ToLaptop(Struct, frozen=True, kw_only=True, tag="to-laptop"):
    """One frame from the joints."""

    number: int
    acknowledged: int
    commands: int  # how many came, in order
    snapshot: ControlSnapshot | None = None
    guardian: GuardianHealth | None = None
    audit: AuditHealth | None = None  # of the joints' trail
    processes: tuple[ProcessStatus, ...] = ()
    ended: bool = False  # the session is over
    fault: Reason | None = None  # why it could not be started


class StopMark(Struct, frozen=True, array_like=True):
    """One STOP: who sent it, its sequence there, and when, by the sender's clock."""

    lease: int
    sequence: int
    sent_ns: int
    spoken: bool = False

    @property
    def kind(self) -> OperatorKind:
        """A spoken STOP holds and never damps."""
        return OperatorKind.VOICE_STOP if self.spoken else OperatorKind.STOP


def mark_of(command: OperatorCommand) -> StopMark:
    """The mark of a STOP."""
    return StopMark(command.lease, command.sequence, command.sent_ns, command.kind is OperatorKind.VOICE_STOP)


class Packet(Struct, frozen=True, kw_only=True, array_like=True):
    """One packet, sealed. Its number is counted up by one; a number that is not above the newest is dropped."""

    number: int
    sent_ns: int
    echo_sent_ns: int = 0  # of the newest packet that came
    echo_received_ns: int = 0
    wall_ns: int = 0  # wall clock minus monotonic clock, of the sender: its steps are told; compared with no other
    loss: float = 1.0  # of what comes to the sender
    stops: tuple[StopMark, ...] = ()  # laptop: not acknowledged yet. Joints: acknowledged by control
    acknowledged_ns: int = 0  # laptop: when the console of `lease` acknowledged events last, which comes by frame
    heartbeat_ns: int = 0  # laptop: when the console said last that STOP can be given
    lease: int = 0  # laptop: of that console


FromLaptop = Hello | ToJoints
FromJoints = Welcome | Refused | ToLaptop
