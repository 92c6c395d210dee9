"""On a real kernel's CAN socket only (tools/test-can): can-utils as witness, an interface that is taken down."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import can
import pytest

from hal.errors import CanFault, DrivesFault
from hal.joints.can.bus import with_bus
from hal.joints.can.recorder import BusRecorder
from hal.joints.emulator.faults import Fault
from hal.joints.protocol import BusFault, DriveState
from tests.support.can_rig import CanRig, MakeRig, bus_of_test, command, until, with_motor
from tests.support.errors import refused

pytestmark = pytest.mark.skipif(
    not os.environ.get("RLEEX_TEST_CAN", "").startswith("socketcan:"),
    reason="needs a kernel's CAN interface: make test-can",
)
LINE = re.compile(r"^\((\d+\.\d+)\) (\S+) ([0-9A-F]+)#([0-9A-F]*)(?: [RT])?$")


@contextmanager
def candump(path: Path) -> Iterator[None]:
    """candump -L of the bus into a file, listening before the body begins."""
    _, channel = bus_of_test()
    program = shutil.which("candump")
    assert program is not None
    with path.open("w") as file, subprocess.Popen([program, "-L", channel], stdout=file) as process:
        until(lambda: _is_heard(channel, path))
        try:
            yield
        finally:
            process.terminate()


def _is_heard(channel: str, path: Path) -> bool:
    subprocess.run(["cansend", channel, "7DF#00"], check=True)
    return path.stat().st_size > 0


def frames(path: Path) -> list[tuple[str, str]]:
    """Identifier and data digits of a candump log, ours only."""
    found = [LINE.match(line) for line in path.read_text().splitlines()]
    return [(match[3], match[4]) for match in found if match is not None and match[3] != "7DF"]


@pytest.fixture
def rig(make_rig: MakeRig) -> CanRig:
    return make_rig(with_motor("AK80-64/V2"))


def test_candump_sees_the_golden_frames(rig: CanRig, tmp_path: Path) -> None:
    log = tmp_path / "bus.log"
    with candump(log):
        rig.joints.open(rig.now_ns())
        rig.joints.enable(rig.now_ns())
        rig.until(lambda now: (now.measured_ns > 0).all(), command(stiffness=0.0, damping=0.0))
        rig.joints.close(rig.now_ns())
        until(lambda: ("004", "FFFFFFFFFFFFFFFD") in frames(log)[-12:])
    observed = frames(log)
    for drive in range(1, 5):
        reported = [data for identifier, data in observed if identifier == f"{drive:03X}"]
        enabled = reported.index("FFFFFFFFFFFFFFFC")
        assert "7FFF7FF0000007FF" in reported[:enabled], "a neutral command comes before enabling"
        assert reported[enabled + 1] == "7FFF7FF0000007FF"
        assert reported[-1] == "FFFFFFFFFFFFFFFD"
        answers = [data for identifier, data in observed if identifier == "000" and data.startswith(f"{drive:02X}")]
        assert answers
        assert all(len(data) == 16 for data in answers)


def test_the_emulator_answers_cansend(rig: CanRig, tmp_path: Path) -> None:
    _, channel = bus_of_test()
    log = tmp_path / "bus.log"
    with candump(log):
        for frame in ("001#7FFF7FF0000007FF", "001#FFFFFFFFFFFFFFFC", "001#FFFFFFFFFFFFFFFD"):
            subprocess.run(["cansend", channel, frame], check=True)
        until(lambda: len([data for identifier, data in frames(log) if identifier == "000"]) == 3)
    assert {data[:6] for identifier, data in frames(log) if identifier == "000"} == {"017FFF"}


def test_can_utils_replay_what_the_recorder_wrote(make_rig: MakeRig, tmp_path: Path) -> None:
    device = with_motor("AK80-64/V2")
    rig = make_rig(device)
    recorded, witness = tmp_path / "session.can.log", tmp_path / "candump.log"
    recorder, stop = BusRecorder(device, recorded), threading.Event()
    thread = threading.Thread(target=recorder.run, args=(stop.is_set,))
    thread.start()
    rig.joints.open(rig.now_ns())
    rig.joints.enable(rig.now_ns())
    rig.joints.close(rig.now_ns())
    until(lambda: recorder.frames > 20)
    stop.set()
    thread.join()
    recorder.close()
    assert len(list(can.LogReader(recorded))) == len(recorded.read_text().splitlines())
    rig.emulator.inject(Fault.SILENT)  # the replay is for candump only
    _, channel = bus_of_test()
    with candump(witness):
        subprocess.run(["canplayer", "-t", "-I", str(recorded), f"{channel}={channel}"], check=True)
        until(lambda: len(frames(witness)) >= len(frames(recorded)))
    assert frames(witness) == frames(recorded)


def test_the_documented_examples_are_what_happens(make_rig: MakeRig, tmp_path: Path) -> None:
    """Every `cansend vcan0` line of docs/how-to/drives.md is sent; every candump line it shows is then seen."""
    make_rig(with_motor("AK80-64/V2"))
    _, channel = bus_of_test()
    text = (Path(__file__).parents[4] / "docs" / "how-to" / "drives.md").read_text()
    sent = re.findall(r"cansend vcan0 ([0-9A-F#]+)", text)
    shown = re.findall(r"^ {2}vcan0 {2}([0-9A-F]+) {3}\[8\] {2}((?:[0-9A-F]{2} ){8})", text + " ", re.MULTILINE)
    assert len(sent) >= 3
    assert len(shown) >= 1
    log = tmp_path / "bus.log"
    with candump(log):
        for frame in sent:
            subprocess.run(["cansend", channel, frame], check=True)
        until(lambda: len([data for identifier, data in frames(log) if identifier == "000"]) == len(sent))
    for identifier, data in shown:
        assert (identifier, data.replace(" ", "")) in frames(log)


def test_an_interface_taken_down_is_reported(rig: CanRig) -> None:
    _, channel = bus_of_test()
    rig.joints.open(rig.now_ns())
    rig.joints.enable(rig.now_ns())
    subprocess.run(["ip", "link", "set", channel, "down"], check=True)
    try:
        feedback = rig.until(lambda now: BusFault.INTERFACE_GONE in now.bus, command())
        assert feedback.state is DriveState.FAULTED
    finally:
        subprocess.run(["ip", "link", "set", channel, "up"], check=True)


def test_an_interface_that_vanishes_is_reported_and_never_raised(make_rig: MakeRig) -> None:
    """The adapter is pulled out under an enabled session; plugged in again, nothing is enabled by itself."""
    _, usual = bus_of_test()
    channel = f"{usual}gone"
    subprocess.run(["ip", "link", "add", channel, "type", "vcan"], check=True)
    subprocess.run(["ip", "link", "set", channel, "up"], check=True)
    rig = make_rig(with_bus(with_motor("AK80-64/V2"), "socketcan", channel))
    rig.joints.open(rig.now_ns())
    rig.joints.enable(rig.now_ns())
    subprocess.run(["ip", "link", "delete", channel], check=True)
    feedback = rig.until(lambda now: BusFault.INTERFACE_GONE in now.bus, command())
    assert feedback.state is DriveState.FAULTED
    subprocess.run(["ip", "link", "add", channel, "type", "vcan"], check=True)
    subprocess.run(["ip", "link", "set", channel, "up"], check=True)
    assert all(rig.tick(command()).state is DriveState.FAULTED for _ in range(20))
    with refused(DrivesFault.NOT_CONFIRMED_OFF):
        rig.joints.close(rig.now_ns())
    subprocess.run(["ip", "link", "delete", channel], check=True)


def test_an_interface_that_comes_back_is_recorded_again(tmp_path: Path) -> None:
    _, usual = bus_of_test()
    channel = f"{usual}log"
    device = with_bus(with_motor("AK80-64/V2"), "socketcan", channel)
    commands = (["link", "add", channel, "type", "vcan"], ["link", "set", channel, "up"])

    def plug_in() -> None:
        for step in commands:
            subprocess.run(["ip", *step], check=True)

    plug_in()
    gaps: list[object] = []
    log = tmp_path / "bus.can.log"
    recorder, stop = BusRecorder(device, log, report=lambda gap: gaps.append(gap.code)), threading.Event()
    thread = threading.Thread(target=recorder.run, args=(stop.is_set,))
    thread.start()
    try:
        subprocess.run(["ip", "link", "delete", channel], check=True)
        until(lambda: gaps == [CanFault.LOG_PAUSED])
        plug_in()
        until(lambda: gaps == [CanFault.LOG_PAUSED, CanFault.LOG_RESUMED])
        until(lambda: _sent(channel) or recorder.frames)
    finally:
        stop.set()
        thread.join()
        recorder.close()
        subprocess.run(["ip", "link", "delete", channel], check=True)
    assert f" {channel} 7DF#00" in log.read_text()


def _sent(channel: str) -> bool:
    """A frame for a program that may not be listening yet; never true by itself."""
    subprocess.run(["cansend", channel, "7DF#00"], check=True)
    return False


def test_python_cans_own_viewer_shows_the_drives(rig: CanRig) -> None:
    interface, channel = bus_of_test()
    host, terminal = os.openpty()
    os.set_blocking(host, False)
    viewer = [sys.executable, "-m", "can.viewer", "-i", interface, "-c", channel]
    environment = {**os.environ, "TERM": "xterm", "LINES": "40", "COLUMNS": "120"}
    shown = bytearray()

    def read() -> bytes:
        with suppress(BlockingIOError, OSError):
            shown.extend(os.read(host, 65_536))
        return bytes(shown)

    with subprocess.Popen(viewer, stdin=terminal, stdout=terminal, stderr=terminal, env=environment) as process:
        try:
            until(lambda: _sent(channel) or b"0x7DF" in read())
            rig.joints.open(rig.now_ns())
            for _ in range(20):  # few enough that a viewer that draws slowly is not buried
                rig.tick(command())
            until(lambda: b"0x004" in read())
            os.write(host, b"q")
            until(lambda: read() and process.poll() is not None)
        finally:
            process.kill()
    os.close(host)
    os.close(terminal)
    assert process.returncode == 0


def test_python_cans_own_logger_records_the_drives(rig: CanRig, tmp_path: Path) -> None:
    interface, channel = bus_of_test()
    log = tmp_path / "session.log"
    logger = [sys.executable, "-m", "can.logger", "-i", interface, "-c", channel, "-f", str(log)]
    with subprocess.Popen(logger, stdout=subprocess.DEVNULL) as process:
        try:
            until(log.exists)  # it listens before it makes its file
            rig.joints.open(rig.now_ns())
            rig.joints.enable(rig.now_ns())
            rig.until(lambda _: log.stat().st_size > 0, command())  # it writes by the buffer
        finally:
            process.kill()
    recorded = frames(log)
    for drive in range(1, 5):
        assert any(identifier == f"{drive:03X}" for identifier, _ in recorded), "commanded"
        assert any(identifier == "000" and data.startswith(f"{drive:02X}") for identifier, data in recorded), "answered"
