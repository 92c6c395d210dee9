"""Two computers in two network namespaces, with the air between them: what a poor or lost link does.

    sudo .venv/bin/python tools/bench_two_hosts.py stop        STOP against loss and delay
    sudo .venv/bin/python tools/bench_two_hosts.py cuts        cuts in every gait state and movement
    sudo .venv/bin/python tools/bench_two_hosts.py flood       10,000 packets a second at the port
    sudo .venv/bin/python tools/bench_two_hosts.py demo        release → command against one host
    sudo .venv/bin/python tools/bench_two_hosts.py clocks      clocks apart by an hour (time namespace)

Run it on a quiet machine. Nothing leaves the namespaces.
"""

from __future__ import annotations

import argparse
import signal
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from app.link.wire import PORT
from app.system.paths import Home
from testing.network import JOINTS, Air, enter_namespace, two_namespaces
from testing.two_hosts import TwoHosts, two_hosts
from tools.bench_link_cuts import measure_cuts

HOST = f"{JOINTS}:{PORT}"
FLOOD_HZ, FLOOD_S = 10_000, 10.0
HOUR_S = 3600


@contextmanager
def session_over(joints_namespace: str, *prefix: str) -> Iterator[TwoHosts]:
    """A session whose joints are in that namespace; this process is in the laptop's."""
    with tempfile.TemporaryDirectory() as laptop, tempfile.TemporaryDirectory() as joints:
        command = ("ip", "netns", "exec", joints_namespace, *prefix)
        with two_hosts(Path(laptop), Path(joints), PORT, host=HOST, prefix=command) as session:
            yield session


def measure_stop(joints: str, air: Air, asked: argparse.Namespace) -> None:
    """Press to acknowledged by control, at rest, for each loss and delay."""
    print("loss  one way  jitter     n   median      90 %       worst   (ms, press → acknowledged by control)")
    with session_over(joints) as session:
        session.stand()
        for loss in (0.0, 0.05, 0.10, 0.20):
            for delay_s, jitter_s in ((0.005, 0.0), (0.05, 0.02), (0.2, 0.05)):
                air.loss = air.jitter_s = 0.0
                air.delay_s = 0.001
                session.settle()
                air.loss, air.delay_s, air.jitter_s = loss, delay_s, jitter_s
                session.go_on(1.0)
                took_ms = [1000 * one for one in _presses(session, air, asked.presses)]
                tenth = statistics.quantiles(took_ms, n=10, method="inclusive")[-1] if len(took_ms) > 1 else took_ms[0]
                figures = f"{statistics.median(took_ms):8.0f}  {tenth:8.0f}  {max(took_ms):8.0f}"
                print(f"{loss:4.0%}  {1000 * delay_s:4.0f} ms  {1000 * jitter_s:4.0f} ms  {len(took_ms):4}  {figures}")


def _presses(session: TwoHosts, air: Air, presses: int) -> Iterator[float]:
    poor = (air.loss, air.delay_s, air.jitter_s)
    for _ in range(presses):
        yield session.stop_acknowledged_s(60.0)
        air.loss, air.delay_s, air.jitter_s = 0.0, 0.001, 0.0
        session.settle()
        air.loss, air.delay_s, air.jitter_s = poor


def cuts(joints: str, air: Air, asked: argparse.Namespace) -> None:
    """Judge every cut; exit status 1 when one ended otherwise than the table says."""
    air.loss = air.jitter_s = 0.0
    with session_over(joints) as session:
        if not measure_cuts(session, air, asked.only):
            sys.exit(1)


def measure_flood(joints: str, air: Air, _: argparse.Namespace) -> None:
    """Lateness of ticks in a quiet session, and in one whose port is flooded by packets and by malformed ones."""
    air.loss = air.jitter_s = 0.0
    quiet = _lateness(joints, lambda session: session.go_on(FLOOD_S))
    flooded = _lateness(joints, lambda session: _flood(joints, session))
    for name, late in (("quiet", quiet), ("flood", flooded)):
        print(f"{name}: tick lateness p50 {late[0]:.3f} ms, p99 {late[1]:.3f} ms, {late[2]} missed of {late[3]}")
    print(f"ratio of p99: {flooded[1] / quiet[1]:.2f} (at most 1.3)")


def _lateness(joints: str, run: Callable[[TwoHosts], None]) -> tuple[float, float, int, int]:
    with session_over(joints) as session:
        before = session.stand()
        run(session)
        now = session.snapshot
        assert now is not None
        assert now.steps == before.steps
        late = now.lateness
        print(f"effect {now.effect.name.lower()}; events: {[one.event.value for one in now.events]}")
        return late.p50_ms, late.p99_ms, late.missed, late.ticks


# As many packets of every length and first byte as the time asks for, beside the joints, and malformed connections.
_FLOOD = """
import socket, sys, time
host, port, rate, lasts = sys.argv[1], int(sys.argv[2]), float(sys.argv[3]), float(sys.argv[4])
flood, sent, began = socket.socket(socket.AF_INET, socket.SOCK_DGRAM), 0, time.monotonic()
while (elapsed := time.monotonic() - began) < lasts:
    while sent < rate * elapsed:
        flood.sendto(bytes([sent % 4]) + sent.to_bytes(8, "big") * (1 + sent % 20), (host, port))
        sent += 1
        if sent % 100 == 0:
            with socket.create_connection((host, port)) as frames:
                frames.sendall(bytes(200))
    time.sleep(0.001)
print(sent)
"""


def _flood(joints: str, session: TwoHosts) -> None:
    command = ("ip", "netns", "exec", joints, sys.executable, "-c", _FLOOD)
    arguments = (JOINTS, str(PORT), str(FLOOD_HZ), str(FLOOD_S))
    with subprocess.Popen([*command, *arguments], stdout=subprocess.PIPE, text=True) as flood:
        while flood.poll() is None:
            session.poll()
        assert flood.stdout is not None
        sent = int(flood.stdout.read())
    session.poll(1.0)
    assert session.link is not None
    print(f"sent {sent} packets in {FLOOD_S:.0f} s, and a malformed connection for every hundredth")


def measure_clocks(joints: str, air: Air, _: argparse.Namespace) -> None:
    """The joints' clocks an hour ahead: the printed offset and uncertainty, and the age of what crosses the link."""
    air.loss = air.jitter_s = 0.0
    hour = str(HOUR_S)
    prefix = ("unshare", "--time", "--monotonic", hour, "--boottime", hour, "--fork", "--kill-child=SIGTERM")
    with session_over(joints, *prefix) as session:
        session.stand()
        session.go_on(3.0)
        link = session.link
        assert link is not None
        assert link.uncertainty_ns is not None
        error_ns = link.offset_ns - HOUR_S * 1_000_000_000
        print(
            f"offset {link.offset_ns / 1e9:+.6f} s ± {link.uncertainty_ns / 1e6:.3f} ms, error {error_ns / 1e6:+.3f} ms"
        )
        assert abs(error_ns) <= link.uncertainty_ns
        took_s = session.stop_acknowledged_s()
        print(f"STOP acknowledged after {took_s * 1000:.0f} ms")


def measure_demo(joints: str, air: Air, _: argparse.Namespace) -> None:
    """All twelve actions on one host, and over a quiet link."""
    from rich.console import Console

    from app.demo.scenario import ALL_TWELVE
    from app.demo.session import demo_config, print_result, run_session
    from app.demo.two_hosts import joints_process, pair_both, wait_for, write_config
    from app.system.config import Config, JointsConfig
    from app.system.hand_model import find_model
    from app.system.paths import find_home

    air.loss = air.jitter_s = 0.0
    model = str(find_model(find_home(), Config()))
    releases = {}
    with tempfile.TemporaryDirectory() as one, tempfile.TemporaryDirectory() as other:
        laptop, far = Home(Path(one)), Home(Path(other))
        config = demo_config(Config(model=model), seed=1, joints=JointsConfig())
        write_config(far, config)
        with joints_process(far, PORT, prefix=("ip", "netns", "exec", joints)) as process:
            wait_for(HOST, lambda: process.poll() is None)
            pair_both(laptop, far, HOST)
            for name, host in (("one host", ""), ("two hosts", HOST)):
                result = run_session(
                    laptop,
                    demo_config(Config(model=model), seed=1, joints=JointsConfig(host=host)),
                    ALL_TWELVE,
                    click_s=0.6,
                    presses=3,
                    watch=lambda _: None,
                    other=far if host else None,
                )
                print_result(Console(), result, ALL_TWELVE)
                found = [one.response_from_release_ms for one in result.attempts]
                releases[name] = statistics.median([one for one in found if one is not None])
    print(
        f"release → command, median: {releases} ms; difference {releases['two hosts'] - releases['one host']:+.0f} ms"
    )


MEASURES = {
    "stop": measure_stop,
    "cuts": cuts,
    "flood": measure_flood,
    "clocks": measure_clocks,
    "demo": measure_demo,
}


def main() -> None:
    """Run one or all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=[*MEASURES, "all"])
    parser.add_argument("--presses", type=int, default=20, help="STOPs for each loss and delay")
    parser.add_argument("--only", default="", help="cuts: situations whose name this expression fits, e.g. during")
    chosen = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # the namespaces are taken away again
    with two_namespaces() as (laptop, joints, air):
        enter_namespace(laptop)
        for name, measure in MEASURES.items():
            if chosen.what in {name, "all"}:
                sys.stdout.flush()
                measure(joints, air, chosen)


if __name__ == "__main__":
    main()
