"""How a session's own process is started, and which processes it starts, in which order."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from pathlib import Path

from msgspec import Struct

from app.session.child import output_of
from app.session.shared import Peer, encode, take_lease
from app.system.config import Config, JointsConfig, SessionSetup, load_device
from app.system.legs_lock import claim_legs

START_ORDER: tuple[str, ...] = ("audit", "perception", "guardian", "planner", "control")
LINKED_ORDER: tuple[str, ...] = ("audit", "perception", "link")  # the joints are another computer's
MOVERS = frozenset({"control", "link"})  # one of them: what commands the legs, here or through the other computer


class Launch(Struct, frozen=True, kw_only=True):
    """What a console starts a session with; it comes through a pipe, since it holds the session's key."""

    setup: SessionSetup
    entry: str  # "module:function" that each process runs with its name and the setup
    order: tuple[str, ...]


def launch(setup: SessionSetup, entry: str, without: frozenset[str]) -> Peer:
    """Start a process of its own session, which no terminal's end reaches.

    entry: as in `Launch`; without: processes that it is not to start. Raises AppError while the legs are another's, and
    HardwareError where device or motor table can't be used.
    """
    order = tuple(name for name in _start_order(setup.config) if name not in without)
    if "control" in order:
        _check_device(setup.config.joints)
    claim_legs(setup).close()  # the session's process takes it; here it can be told why not
    start = Launch(setup=setup, entry=entry, order=order)
    take_lease(setup.links)
    output = output_of(setup, "session")
    output.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    # Not by a file action: its error would name the interpreter.
    with os.fdopen(os.open(output, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600), "ab") as printed:
        reads, writes = os.pipe()
        try:
            pid = os.posix_spawn(
                sys.executable,
                [sys.executable, "-m", "app.session.supervise"],
                os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
                file_actions=[
                    (os.POSIX_SPAWN_DUP2, reads, 0),
                    (os.POSIX_SPAWN_DUP2, printed.fileno(), 1),
                    (os.POSIX_SPAWN_DUP2, printed.fileno(), 2),
                ],
                setsid=True,
            )
        except OSError:
            os.close(writes)
            raise
        finally:
            os.close(reads)
    host = Peer(pid)
    with os.fdopen(writes, "wb") as pipe, suppress(BrokenPipeError):
        pipe.write(encode(start))
    return host


def _check_device(joints: JointsConfig) -> None:
    """Raises HardwareError; control would end and leave the reason in its log alone."""
    device = load_device(joints)
    if joints.kind == "can":
        from hal.joints.factory import make_joints  # brings NumPy: not before the console's first paint

        motors = Path(joints.motors) if joints.motors else None
        make_joints(joints.kind, device, motors=motors, interface=joints.interface, channel=joints.channel)


def _start_order(config: Config) -> tuple[str, ...]:
    """Recorders first: joints on CAN have their buses recorded from the first frame on."""
    remote = bool(config.joints.host)
    recorders = [("bus-log", config.joints.kind == "can" and not remote), ("recording", config.recording.on)]
    order = LINKED_ORDER if remote else START_ORDER
    return (*order[:1], *(name for name, wanted in recorders if wanted), *order[1:])
