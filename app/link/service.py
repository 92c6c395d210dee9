"""`rleex joints`, the service of the exoskeleton's computer: its process, and the systemd file that starts it."""

from __future__ import annotations

import getpass
import shlex
import signal
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path

from app.link.served import own_config
from app.link.server import JointsServer
from app.session.shared import held_session
from app.system.config import Config
from app.system.paths import Home
from app.system.scheduling import avoid_control_core, set_scheduling

_SERVICE = """\
# rleex joints --print-service | sudo tee /etc/systemd/system/rleex-joints.service
# sudo systemctl enable --now rleex-joints
[Unit]
Description=rleex: joints of the exoskeleton
After=network.target
# Started again however often it ends: nobody sits at this computer who would start it by hand.
StartLimitIntervalSec=0

[Service]
User={user}
ExecStart={command}
Restart=always
RestartSec=1
# Only this process is asked to end: it brings the legs to rest. If it dies, its session is held, and resumed.
KillMode=process
# Lack of memory costs the process that the kernel takes, and what it did; by default it would end the whole session.
OOMPolicy=continue
TimeoutStopSec=60
LimitRTPRIO=80
LimitMEMLOCK=infinity

[Install]
WantedBy=multi-user.target
"""


def config_at_start(home: Home) -> Config:
    """The file's; of a session that an earlier process left held, its own: no file keeps it from its laptop.

    Raises AppError.
    """
    held = held_session(home)
    return own_config(home) if held is None else held.config


def serve_joints(home: Home, port: int, watch: Callable[[str], None]) -> None:
    """Serve until SIGTERM or Ctrl-C. Raises AppError."""
    config = config_at_start(home)
    with ThreadPoolExecutor(1) as workers:
        workers.submit(int).result()  # its thread is there before what the session's processes must not inherit
        set_scheduling("link")
        avoid_control_core(config.control_core)
        with closing(JointsServer(home, port, workers)) as server:
            for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
                signal.signal(number, lambda *_: server.end())
            server.run(watch)


def service_file(home: Home, port: int) -> str:
    """The file's text for this user, this program and this home."""
    program = Path(sys.executable).with_name("rleex")
    command = [str(program), "joints", "--home", str(home.root.absolute()), "--port", str(port)]
    escaped = shlex.join(command).replace("%", "%%")
    return _SERVICE.format(user=getpass.getuser(), command=escaped)
