"""The drives that the demo emulates for a device: on as many buses as it has."""

from __future__ import annotations

import time
from pathlib import Path

import msgspec
import tomlkit

from app.demo.drives import emulated_drives
from app.system.config import JointsConfig
from hal.joints.can.bus import with_bus
from hal.joints.can.driver import SocketCanJoints
from hal.joints.device import BusDevice, load_exoskeleton
from hal.joints.protocol import DriveState
from tests.support.can_rig import each_joint


def test_the_drives_of_a_device_with_two_buses_answer_on_both(tmp_path: Path) -> None:
    device = each_joint(
        load_exoskeleton(),
        lambda number, joint: msgspec.structs.replace(joint, can_bus=number // 2, can_id=1 + number % 2),
    )
    device = msgspec.structs.replace(device, buses=(BusDevice(channel="can0"), BusDevice(channel="can1")))
    (tmp_path / "two.toml").write_text(tomlkit.dumps(msgspec.to_builtins(device)))
    with emulated_drives(JointsConfig(device=str(tmp_path / "two.toml")), wearer=None) as config:
        joints = SocketCanJoints(with_bus(device, config.interface, config.channel))
        joints.open(time.monotonic_ns())
        assert joints.read(time.monotonic_ns()).state is DriveState.PROBED
        joints.close(time.monotonic_ns())
