"""Both computers on this one: `rleex joints` as a process with a home of its own, paired by code, on loopback."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress

import tomlkit
from msgspec.structs import replace

from app.link import pairing
from app.link.keys import forget_peer
from app.link.questions import find
from app.system.config import Config, JointsConfig
from app.system.errors import AppError
from app.system.paths import Home

START_S = 30.0
END_S = 60.0
LOOPBACK = "127.0.0.1"
# PR_SET_PDEATHSIG: it ends with this process, however that ends.
_PROGRAM = "import ctypes; ctypes.CDLL(None).prctl(1, 15); from app.cli import main; main()"


@contextmanager
def joints_process(home: Home, port: int, *, prefix: Sequence[str] = ()) -> Iterator[subprocess.Popen[bytes]]:
    """`rleex joints` of that home while the body runs; prefix: a command that runs it, as into another namespace."""
    command = [*prefix, sys.executable, "-c", _PROGRAM, "joints", "--home", str(home.root), "--port", str(port)]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    with (home.root / "joints.txt").open("ab") as file:
        process = subprocess.Popen(
            command, env=environment, stdin=subprocess.DEVNULL, stdout=file, stderr=file, process_group=0
        )
    try:
        yield process
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGTERM)  # a command of the prefix may not pass it on
        try:
            process.wait(END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def pair_both(laptop: Home, joints: Home, host: str) -> None:
    """As two people do it: a code of one side, typed at the other. Raises AppError."""
    code = pairing.new_code()
    pairing.write_offer(joints, pairing.Offer(code=code, expires_s=time.time() + pairing.LASTS_S))
    pairing.pair(laptop, host, code, time.time())


def write_config(home: Home, config: Config) -> None:
    """The other computer's own configuration: its joints, its buttons."""
    joints = config.joints
    chosen = {"kind": joints.kind, "device": joints.device, "motors": joints.motors}
    chosen |= {"interface": joints.interface, "channel": joints.channel}
    named = {"unattended_s": config.unattended_s, "joints": {name: value for name, value in chosen.items() if value}}
    home.root.mkdir(parents=True, exist_ok=True)
    home.config.write_text(tomlkit.dumps(named), encoding="utf-8")


def free_port() -> int:
    """A port of loopback that nobody has, for TCP."""
    with socket.socket() as listening:
        listening.bind((LOOPBACK, 0))
        return int(listening.getsockname()[1])


@contextmanager
def second_computer(laptop: Home, joints: Home, config: Config) -> Iterator[Config]:
    """The laptop's configuration while the body runs: its joints are behind the link, of a process with that home."""
    host = f"{LOOPBACK}:{free_port()}"
    write_config(joints, config)
    with joints_process(joints, int(host.partition(":")[2])) as process:
        wait_for(host, lambda: process.poll() is None)
        pair_both(laptop, joints, host)
        try:
            yield replace(config, joints=JointsConfig(device=config.joints.device, host=host))
        finally:
            forget_peer(laptop, host)


def wait_for(host: str, alive: Callable[[], bool]) -> None:
    """Until it answers. Raises AppError."""
    deadline = time.monotonic() + START_S
    while True:
        try:
            find(host, 1.0)
        except AppError:
            if time.monotonic() > deadline or not alive():
                raise
        else:
            return
