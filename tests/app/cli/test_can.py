"""Commands that ask the drives: alone on the bus or not at all; how long a zero lasts."""

from __future__ import annotations

import gzip
import random
import secrets
import threading
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
import tomlkit
import typer
from typer.testing import CliRunner

from app.cli.can import cli
from app.system import legs_lock
from app.system.errors import AppError
from app.system.legs_lock import claim_buses
from app.system.paths import Home
from app.text.catalogue import tr
from hal.errors import CanFault
from hal.joints.can import zero
from hal.joints.can.bus import with_bus
from hal.joints.can.candump import FrameKind
from hal.joints.can.driver import SocketCanJoints
from hal.joints.can.scan import BusMonitor
from hal.joints.device import Exoskeleton
from hal.joints.emulator.emulator import DriveEmulator
from hal.joints.protocol import Joint
from testing.emulated_drives import emulating
from tests.support.can_rig import CanRig, command, small_gear, until, with_motor
from tests.support.errors import refused

PERMITTED = {"zero": ("zero", "left_knee"), "monitor": ("monitor", "--ask", "--seconds", "0.5")}


@pytest.fixture(autouse=True)
def _own_locks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No test takes a lock that another process of this host asks for."""
    monkeypatch.setattr(legs_lock, "HOST_FOLDERS", (tmp_path,))
    monkeypatch.setenv("RLEEX_HOME", str(tmp_path / "home"))


def on_local_bus(device: Exoskeleton) -> Exoskeleton:
    return with_bus(device, "local", str(random.SystemRandom().randrange(20_000, 60_000)))


@pytest.fixture
def rig() -> Iterator[CanRig]:
    """Drives of a session, enabled and holding."""
    device = on_local_bus(with_motor("AK80-64/V2"))
    with emulating(DriveEmulator(device)) as emulator:
        joints = SocketCanJoints(device)
        rig = CanRig(joints, emulator)
        joints.open(rig.now_ns())
        joints.enable(rig.now_ns())
        yield rig
        joints.close(rig.now_ns())


def call(device: Exoskeleton, *arguments: str) -> None:
    """A command of `rleex can` on this device's bus."""
    bus = device.buses[0]
    typer.main.get_command(cli).main(
        [*arguments, "--interface", bus.interface, "--channel", bus.channel], standalone_mode=False
    )


@pytest.mark.parametrize("name", PERMITTED)
def test_the_drives_of_a_session_are_not_asked(rig: CanRig, tmp_path: Path, name: str) -> None:
    """Not even while it is silent."""
    device, before = rig.emulator.device, rig.emulator.received
    session = claim_buses(Home(tmp_path / "its home"), device)
    with pytest.raises(AppError, match="LEGS_HELD"):
        call(device, *PERMITTED[name])
    session.close()
    assert rig.emulator.received == before
    assert all(drive.motor_mode for drive in rig.emulator.drives)


@pytest.mark.parametrize("name", PERMITTED)
def test_drives_that_another_program_commands_are_not_asked(rig: CanRig, name: str) -> None:
    """One without a lock."""
    stop = threading.Event()

    def hold() -> None:
        while not stop.is_set():
            rig.tick(command())

    thread = threading.Thread(target=hold)
    thread.start()
    try:
        with refused(CanFault.BUS_IN_USE):
            call(rig.emulator.device, *PERMITTED[name])
    finally:
        stop.set()
        thread.join()
    assert all(drive.motor_mode for drive in rig.emulator.drives)


def test_the_monitor_asks_while_nobody_can_begin_a_session(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    device = on_local_bus(with_motor("AK80-64/V2"))
    poll, polls = BusMonitor.poll, list[float]()

    def all_reply(monitor: BusMonitor) -> bool:
        poll(monitor, 0.002)
        return all(monitor.counts[joint, FrameKind.REPLY] for joint in Joint)

    def try_a_session(monitor: BusMonitor, wait_s: float) -> None:
        with pytest.raises(AppError, match="LEGS_HELD"):
            claim_buses(Home(tmp_path / "another"), device)
        until(lambda: all_reply(monitor))
        polls.append(wait_s)

    monkeypatch.setattr(BusMonitor, "poll", try_a_session)
    with emulating(DriveEmulator(device)) as emulator:
        call(device, *PERMITTED["monitor"])
        assert not any(drive.motor_mode for drive in emulator.drives)
    assert polls
    claim_buses(Home(tmp_path / "another"), device).close()


def test_a_recorded_bus_is_unpacked_whatever_the_case_of_its_ending(tmp_path: Path) -> None:
    frame = b"(1731.000001) can0 001#7FFF7FF000007FF7\n"
    decoded = []
    for name, data in (("a.log", frame), ("b.log.GZ", gzip.compress(frame))):
        (tmp_path / name).write_bytes(data)
        decoded.append(CliRunner().invoke(cli, ["decode", str(tmp_path / name)]).stdout)
    assert decoded[0] == decoded[1]
    assert "left hip" in decoded[0]


def test_the_name_of_a_recorded_bus_is_no_markup(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    port = str(random.SystemRandom().randrange(20_000, 60_000))
    arguments = ["record", "[bold]a[", "--interface", "local", "--channel", port, "--seconds", "0.01"]
    done = CliRunner().invoke(cli, arguments)
    assert done.exit_code == 0, done
    assert "[bold]a[" in done.output


@pytest.mark.parametrize(
    ("motor", "lost"),
    [("AK80-64/V2", False), ("AK80-64/V3", True), ("CyberGear/manual", True), ("DM10010/default", False)],
)
def test_a_zero_that_is_lost_with_the_supply_is_announced_as_that(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, motor: str, *, lost: bool
) -> None:
    monkeypatch.setattr(zero, "STILL_FOR_S", 0.05)
    monkeypatch.setattr(secrets, "token_hex", lambda _: "ab12")
    device = on_local_bus(small_gear(motor) if motor.startswith("CyberGear") else with_motor(motor))
    description = tmp_path / "device.toml"
    description.write_text(tomlkit.dumps(msgspec.to_builtins(device)))
    with emulating(DriveEmulator(device)) as emulator:
        emulator.drives[1].zero_rad = -0.3
        done = CliRunner().invoke(cli, ["zero", "left_knee", "--device", str(description)], input="y\nab12\n")
    assert done.exit_code == 0, done
    assert (tr("can.zero_temporary") in done.output) == lost
