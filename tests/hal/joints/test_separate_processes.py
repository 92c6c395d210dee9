"""Drives, control and guardian as three processes on a local bus: control is killed, the guardian's frames save."""

from __future__ import annotations

import multiprocessing
import random
import time
from collections.abc import Callable
from multiprocessing.synchronize import Event

import numpy as np
import pytest

from hal.errors import DrivesFault
from hal.joints.can.bus import open_bus, with_bus
from hal.joints.can.drive import Drive
from hal.joints.can.driver import SocketCanJoints
from hal.joints.can.port import frame_of
from hal.joints.can.safe_stop import SafeStop
from hal.joints.device import Exoskeleton, load_exoskeleton
from hal.joints.emulator.emulator import run_emulator
from hal.joints.emulator.scenes import EmulatedCanJoints, SceneReceiver
from hal.joints.factory import make_joints
from hal.joints.protocol import Joint, JointCommand
from hal.joints.scene import Block, BlockKind, Scene
from tests.support.errors import refused

pytestmark = pytest.mark.serial

LIMIT_S = 30.0  # three interpreters start on a busy machine


def push(device: Exoskeleton, pushing: Event) -> None:
    """Control's part: enable, push towards a target out of reach, until killed."""
    joints = SocketCanJoints(device)
    joints.open(time.monotonic_ns())
    joints.enable(time.monotonic_ns())
    zero = np.zeros(4)
    wanted = JointCommand(
        position_rad=zero + 2.5,  # beyond the end stops: the drives push for ever
        velocity_rad_s=zero,
        stiffness_nm_rad=zero + 100.0,
        damping_nm_s_rad=zero + 5.0,
        torque_nm=zero,
    )
    while True:
        joints.write(wanted, time.monotonic_ns())
        if np.abs(joints.read(time.monotonic_ns()).torque_nm).min() > 10.0:
            pushing.set()
        time.sleep(0.002)


def until(condition: Callable[[], bool]) -> None:
    end_s = time.monotonic() + LIMIT_S
    while not condition():
        assert time.monotonic() < end_s
        time.sleep(0.01)


def test_the_guardian_saves_the_wearer_of_drives_whose_control_was_killed() -> None:
    device = with_bus(load_exoskeleton(), "local", str(random.SystemRandom().randrange(20_000, 60_000)))
    spawning = multiprocessing.get_context("spawn")
    ready, stop, pushing = spawning.Event(), spawning.Event(), spawning.Event()
    drives = spawning.Process(target=run_emulator, args=(device,), kwargs={"ready": ready, "stop": stop}, daemon=True)
    control = spawning.Process(target=push, args=(device, pushing), daemon=True)
    guardian, ear = SafeStop(device), Ear(device)
    try:
        drives.start()
        assert ready.wait(LIMIT_S)
        control.start()
        assert pushing.wait(LIMIT_S)
        control.kill()
        control.join(LIMIT_S)
        guardian.open()
        until(lambda: guardian.damp() and ear.torque_nm() < 5.0)
        assert guardian.exit()
        until(lambda: guardian.answered() == set(Joint) or not guardian.exit())
    finally:
        control.kill()
        stop.set()
        guardian.close()
        ear.close()
        drives.join(LIMIT_S)
    assert drives.exitcode == 0


class Ear:
    """Listens to the drives' own words."""

    def __init__(self, device: Exoskeleton) -> None:
        from hal.joints.can.drive import drives_of

        self._stations: tuple[Drive, ...] = drives_of(device)
        self._bus = open_bus(device.buses[0])

    def torque_nm(self) -> float:
        """The largest torque in each drive's newest word; infinite until all have spoken."""
        newest = {}
        while (message := self._bus.recv(0.02)) is not None:
            for drive in self._stations:
                frame = frame_of(message)
                if frame.arbitration_id == 0 and drive.codec.replier(frame) == drive.reply_number:
                    reply = drive.codec.read_reply(frame)
                    newest[drive.joint] = abs(reply.torque_nm) if reply else np.inf
        return max(newest.values()) if len(newest) == 4 else np.inf

    def close(self) -> None:
        """Release the bus."""
        self._bus.shutdown()


def test_an_emulated_wearer_is_given_what_stands_around_the_feet() -> None:
    device = with_bus(load_exoskeleton(), "virtual", f"scene-{random.random()}")
    joints = make_joints("can", device)
    assert isinstance(joints, EmulatedCanJoints)
    scene = Scene(blocks=(Block(kind=BlockKind.STEP, from_x_m=0.2, to_x_m=0.5, top_m=0.15),))
    joints.stage(scene)  # nobody listens: harmless
    receiver = SceneReceiver(device)
    try:
        assert receiver.receive() is None
        joints.stage(scene)
        assert receiver.receive() == scene
        with refused(DrivesFault.ALREADY_EMULATED):
            SceneReceiver(device)
    finally:
        receiver.close()


def test_a_robots_bus_is_never_staged() -> None:
    assert type(make_joints("can", load_exoskeleton())) is SocketCanJoints
