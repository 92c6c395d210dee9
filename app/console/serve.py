"""Watch the running session in a browser on this machine: the read-only console behind textual-serve, loopback only."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path

from app.console.screens.observer import shared
from app.system.paths import Home

LOOPBACK = "127.0.0.1"
PORT = 8730


def serve_console(home: Home, port: int = PORT) -> None:
    """Serve until Ctrl-C. Raises AppError when no session runs."""
    from textual_serve.server import Server

    shared(home)
    rleex = Path(sys.executable).with_name("rleex")
    words = [str(rleex), "run", "--read-only", "--home", str(home.root)]
    Server(shlex.join(words), host=LOOPBACK, port=port, title="rleex (read-only)").serve()
