"""Commands that ask the drives: alone on the bus or not at all; how long a zero lasts."""

from __future__ import annotations

import gzip
import random
import secrets
import threading
import tomllib
from collections.abc import Iterator
from pathlib import Path

import can
import msgspec
import pytest
import tomlkit
import typer
from typer.testing import CliRunner

from app.cli import simulate as simulating
from app.cli.can import cli
from app.cli.drive_options import described_drives
from app.system import legs_lock
from app.system.errors import AppError
from app.system.legs_lock import claim_buses
from app.system.paths import Home
from app.text.catalogue import tr
from hal.errors import CanFault, DeviceFault
from hal.joints.can import zero
from hal.joints.can.bus import with_bus
from hal.joints.can.candump import FrameKind
from hal.joints.can.driver import SocketCanJoints
from hal.joints.can.scan import BusMonitor
from hal.joints.device import DEFAULT_DEVICE, BusDevice, Exoskeleton, JointDevice, load_exoskeleton
from hal.joints.emulator.emulator import DriveEmulator, run_emulator
from hal.joints.motors import BUILT_IN_TABLE
from hal.joints.protocol import Joint
from testing.emulated_drives import emulating
from tests.support.can_rig import CanRig, command, each_joint, small_gear, until, with_motor
from tests.support.errors import refused

# Each leg on a bus of its own, with the same IDs on both.
TWO_BUSES = each_joint(
    with_motor("AK80-64/V2"),
    lambda number, joint: msgspec.structs.replace(joint, can_bus=number // 2, can_id=1 + number % 2),
)
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


def on_two_local_buses(file: Path) -> Exoskeleton:
    """The device whose description is written there."""
    ports = random.SystemRandom().sample(range(20_000, 60_000), 2)
    buses = tuple(BusDevice(interface="local", channel=str(port)) for port in ports)
    device = msgspec.structs.replace(TWO_BUSES, buses=buses)
    file.write_text(tomlkit.dumps(msgspec.to_builtins(device)))
    return device


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


@pytest.mark.parametrize("content", ["", "no frame\n", "(1731.000001) can0 001#7FFF"])
def test_a_file_without_a_frame_is_refused(tmp_path: Path, content: str) -> None:
    path = tmp_path / "a.log"
    path.write_text(content)
    with refused(CanFault.LOG_WITHOUT_FRAMES, path=path):
        CliRunner().invoke(cli, ["decode", str(path)], catch_exceptions=False)


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


def test_a_device_that_is_named_has_its_own_buses(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On the home's one bus the zero would be that of the other leg's drive with this ID."""
    monkeypatch.setattr(zero, "STILL_FOR_S", 0.05)
    monkeypatch.setattr(secrets, "token_hex", lambda _: "ab12")
    device = on_two_local_buses(tmp_path / "two.toml")
    (tmp_path / "home").mkdir()
    config = {"joints": {"interface": "local", "channel": device.buses[0].channel}}
    (tmp_path / "home" / "config.toml").write_text(tomlkit.dumps(config))
    with emulating(DriveEmulator(device)) as emulator:
        for drive in emulator.drives:
            drive.zero_rad = -0.3
        asked = ["zero", "right_hip", "--device", str(tmp_path / "two.toml")]
        done = CliRunner().invoke(cli, asked, input="y\nab12\n")
    assert done.exit_code == 0, done
    assert [drive.zero_rad != -0.3 for drive in emulator.drives] == [False, False, True, False]


@pytest.mark.parametrize("name", [*PERMITTED, "scan", "doctor"])
def test_two_buses_are_not_asked_as_one(tmp_path: Path, name: str) -> None:
    device = on_two_local_buses(tmp_path / "two.toml")
    arguments = [*PERMITTED.get(name, (name,)), "--device", str(tmp_path / "two.toml")]
    with refused(DeviceFault.CHANNEL_SHARED, bus=device.buses[1].channel, count=2):
        CliRunner().invoke(cli, [*arguments, "--channel", device.buses[1].channel], catch_exceptions=False)


class TestEmulatedOnARealBus:
    """Emulated drives would answer beside those that hang on it."""

    @pytest.fixture(autouse=True)
    def _in_this_process(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(f"{run_emulator.__module__}._set_scheduling", lambda: None)  # of a process of its own
        monkeypatch.setattr(f"{run_emulator.__module__}._gc_freeze", lambda: None)

    @pytest.fixture
    def device(self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Exoskeleton:
        """On an adapter, in whose place python-can opens its virtual bus."""
        monkeypatch.setitem(can.interfaces.BACKENDS, "pcan", ("can.interfaces.virtual", "VirtualBus"))
        return with_bus(with_motor("AK80-64/servo"), "pcan", f"emulated {tmp_path}")

    def test_drives_that_send_by_themselves_are_not_answered_for(self, device: Exoskeleton) -> None:
        with emulating(DriveEmulator(device)), refused(CanFault.BUS_NOT_FREE, bus=device.buses[0].channel):
            self.emulate(device)

    def test_drives_that_a_session_commands_are_not_answered_for(self, device: Exoskeleton) -> None:
        channel = device.buses[0].channel
        with can.Bus(interface="pcan", channel=channel) as session, refused(CanFault.BUS_NOT_FREE, bus=channel):
            session.send_periodic(can.Message(arbitration_id=1, is_extended_id=False, data=bytes(8)), 0.002)
            self.emulate(device)

    def test_on_a_bus_without_anybody_they_are_emulated(self, device: Exoskeleton) -> None:
        assert tr("emulate.ended") in self.emulate(device)

    def emulate(self, device: Exoskeleton) -> str:
        """What is shown."""
        bus = device.buses[0]
        given = ["--interface", bus.interface, "--channel", bus.channel, "--seconds", "0.01"]
        done = CliRunner().invoke(simulating.cli, ["emulate-drives", *given], catch_exceptions=False)
        return done.stdout


class TestConfigured:
    """A home whose `[joints]` names a device with other IDs, of a motor that its own table alone has."""

    IDS = (4, 3, 12, 11)

    @pytest.fixture
    def device(self, tmp_path: Path) -> Exoskeleton:
        """As the session has it: on the bus of the configuration, not of the description."""

        def own(number: int, joint: JointDevice) -> JointDevice:
            return msgspec.structs.replace(joint, motor="Own/1", can_id=self.IDS[number], reply_id=0)

        described = each_joint(load_exoskeleton(), own)
        table = tomllib.loads(BUILT_IN_TABLE.read_text())["motor"]
        motor = next(one for one in table if (one["name"], one["version"]) == ("AK80-64", "V2"))
        (tmp_path / "exo.toml").write_text(tomlkit.dumps(msgspec.to_builtins(described)))
        (tmp_path / "own.toml").write_text(tomlkit.dumps({"motor": [motor | {"name": "Own", "version": "1"}]}))
        device = on_local_bus(described)
        joints = {"device": f"{tmp_path}/exo.toml", "motors": f"{tmp_path}/own.toml", "interface": "local"}
        (tmp_path / "home").mkdir()
        config = {"joints": joints | {"channel": device.buses[0].channel}}
        (tmp_path / "home" / "config.toml").write_text(tomlkit.dumps(config))
        return device

    @pytest.fixture
    def drives(self, device: Exoskeleton, tmp_path: Path) -> Iterator[DriveEmulator]:
        with emulating(DriveEmulator(device, motors=tmp_path / "own.toml")) as running:
            yield running

    def test_the_scan_finds_its_drives(self, drives: DriveEmulator) -> None:
        done = CliRunner().invoke(cli, ["scan"])
        found = [line.split()[1] for line in done.stdout.splitlines()[1:]]
        assert found == ["3", "4", "11", "12"]

    def test_the_doctor_misses_none_of_its_drives(self, drives: DriveEmulator) -> None:
        done = CliRunner().invoke(cli, ["doctor"])
        assert done.exit_code == 0, done.output

    def test_the_zero_is_that_of_its_joint(self, drives: DriveEmulator, monkeypatch: pytest.MonkeyPatch) -> None:
        """By the built-in description 4 would be the right knee."""
        monkeypatch.setattr(zero, "STILL_FOR_S", 0.05)
        monkeypatch.setattr(secrets, "token_hex", lambda _: "ab12")
        for drive in drives.drives:
            drive.zero_rad = -0.3
        done = CliRunner().invoke(cli, ["zero", "left_hip"], input="y\nab12\n")
        assert done.exit_code == 0, done
        assert [drive.zero_rad != -0.3 for drive in drives.drives] == [True, False, False, False]

    def test_the_monitor_asks_its_drives(self, drives: DriveEmulator, monkeypatch: pytest.MonkeyPatch) -> None:
        poll, replied = BusMonitor.poll, set[Joint]()

        def all_reply(monitor: BusMonitor) -> bool:
            poll(monitor, 0.002)
            replied.update(joint for joint in Joint if monitor.counts[joint, FrameKind.REPLY])
            return replied == set(Joint)

        monkeypatch.setattr(BusMonitor, "poll", lambda monitor, _: until(lambda: all_reply(monitor)))
        done = CliRunner().invoke(cli, PERMITTED["monitor"])
        assert (done.exit_code, replied) == (0, set(Joint)), done

    def test_a_record_of_its_bus_is_decoded_by_its_joints(self, device: Exoskeleton, tmp_path: Path) -> None:
        done = CliRunner().invoke(cli, ["record", str(tmp_path / "a.log"), "--seconds", "0.01"])
        assert done.exit_code == 0, done
        (tmp_path / "a.log").write_bytes(b"(1731.000001) can0 004#7FFF7FF000007FF7\n")
        done = CliRunner().invoke(cli, ["decode", str(tmp_path / "a.log"), "--joint", "left_hip"])
        assert "left hip" in done.stdout

    def test_its_drives_are_emulated(self, device: Exoskeleton, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(f"{run_emulator.__module__}._set_scheduling", lambda: None)  # of a process of its own
        monkeypatch.setattr(f"{run_emulator.__module__}._gc_freeze", lambda: None)
        done = CliRunner().invoke(simulating.cli, ["emulate-drives", "--seconds", "0.01"])
        assert device.buses[0].channel in done.stdout, done

    def test_options_go_before_it(self, device: Exoskeleton, tmp_path: Path) -> None:
        """Each for itself."""
        (tmp_path / "a.log").write_bytes(b"(1731.000001) can0 004#7FFF7FF000007FF7\n")
        (tmp_path / "built-in.toml").write_bytes(DEFAULT_DEVICE.read_bytes())
        given = ["--device", str(tmp_path / "built-in.toml")]
        done = CliRunner().invoke(cli, ["decode", str(tmp_path / "a.log"), *given])
        assert "right knee" in done.stdout
        described, motors = described_drives(None, tmp_path / "built-in.toml", "", "")
        assert (described.buses, motors) == (load_exoskeleton().buses, tmp_path / "own.toml")
        described, motors = described_drives(None, None, "virtual", "")
        assert [(bus.interface, bus.channel) for bus in described.buses] == [("virtual", device.buses[0].channel)]
        assert motors == tmp_path / "own.toml"

    def test_another_home_is_another_device(self, device: Exoskeleton, tmp_path: Path) -> None:
        assert described_drives(tmp_path / "none", None, "", "") == (load_exoskeleton(), None)
