"""The systemd service of the exoskeleton's computer, as `rleex joints --print-service` prints it."""

from __future__ import annotations

import getpass
import shlex
import sys
from pathlib import Path

from app.system.paths import Home

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


def service_file(home: Home, port: int) -> str:
    """The file's text for this user, this program and this home."""
    program = Path(sys.executable).with_name("rleex")
    command = [str(program), "joints", "--home", str(home.root.absolute()), "--port", str(port)]
    escaped = shlex.join(command).replace("%", "%%")
    return _SERVICE.format(user=getpass.getuser(), command=escaped)
