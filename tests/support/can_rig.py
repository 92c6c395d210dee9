"""Emulated drives and the driver on one bus, in real time, for the tests of this folder.

RLEEX_TEST_CAN="socketcan:vcan0" puts every CAN test on that bus instead of python-can's virtual one: that is how the
suite runs on a real kernel's socket (tools/test-can).
"""

from __future__ import annotations

import itertools
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import msgspec
import numpy as np
import pytest

from hal.joints.can.bus import with_bus
from hal.joints.codecs.wire import Frame, Order, SetPoint, Transmission
from hal.joints.device import Exoskeleton, JointDevice, load_exoskeleton
from hal.joints.emulator.emulator import DriveEmulator
from hal.joints.emulator.firmware import EmulatedDrive
from hal.joints.protocol import JointArray, JointCommand, JointFeedback, Joints

LIMIT_S = float(os.environ.get("RLEEX_TEST_LIMIT_S", "5"))  # a failure, not a duration: all takes milliseconds
TICK_S = 0.002
LOOKS = int(LIMIT_S / TICK_S)
_numbers = itertools.count()
ZERO = np.zeros(4)


def bus_of_test() -> tuple[str, str]:
    """Interface and channel for one test."""
    given = os.environ.get("RLEEX_TEST_CAN", "")
    if given:
        interface, _, channel = given.partition(":")
        return interface, channel
    return "virtual", f"test-{next(_numbers)}"


def on_test_bus(device: Exoskeleton) -> Exoskeleton:
    """The device on the bus of this test."""
    return with_bus(device, *bus_of_test())


def each_joint(device: Exoskeleton, change: Callable[[int, JointDevice], JointDevice]) -> Exoskeleton:
    """The device with each joint changed."""
    joints = [change(number, joint) for number, joint in enumerate(device.joints)]
    return msgspec.structs.replace(
        device, left_hip=joints[0], left_knee=joints[1], right_hip=joints[2], right_knee=joints[3]
    )


def with_motor(motor: str, **changes: object) -> Exoskeleton:
    """The demo device with another motor at every joint, master IDs from 0x11 as Damiao users set them."""

    def change(number: int, joint: JointDevice) -> JointDevice:
        reply_id = 0x11 + number if motor.startswith("DM") else 0
        return msgspec.structs.replace(joint, motor=motor, reply_id=reply_id, **changes)

    return on_test_bus(each_joint(load_exoskeleton(), change))


def small_gear(motor: str) -> Exoskeleton:
    """The demo device with a small motor behind a belt of 1:2, limits within its wire format."""
    return with_motor(motor, transmission=2.0, max_torque_nm=22.0, max_stiffness_nm_rad=400.0, zero_offset_deg=5.0)


def command(
    position_rad: float | JointArray = 0.0, *, stiffness: float = 200.0, damping: float = 5.0, torque: float = 0.0
) -> JointCommand:
    """The same set-point for every joint, or one angle each."""
    return JointCommand(
        position_rad=ZERO + position_rad,
        velocity_rad_s=ZERO,
        stiffness_nm_rad=ZERO + stiffness,
        damping_nm_s_rad=ZERO + damping,
        torque_nm=ZERO + torque,
    )


def until(condition: Callable[[], object]) -> None:
    """Wait for a condition; fails after so many looks, since a busy machine may let this process stand for seconds."""
    for _ in range(LOOKS):
        if condition():
            return
        time.sleep(TICK_S)
    raise AssertionError("the condition was not met in time")


def answer_with_power_alone(monkeypatch: pytest.MonkeyPatch, drive: EmulatedDrive) -> None:
    """As firmware that replies in motor mode only; to what ends that, too."""
    receive = drive.receive

    def answer(frame: Frame, now_ns: int) -> list[Frame]:
        powered = drive.motor_mode
        replies = receive(frame, now_ns)
        return replies if powered or drive.motor_mode else []

    monkeypatch.setattr(drive, "receive", answer)


def listening(monkeypatch: pytest.MonkeyPatch, drive: EmulatedDrive) -> list[SetPoint | Order | None]:
    """What a drive is told from now on, as at its joint."""
    receive, told = drive.receive, list[SetPoint | Order | None]()

    def receive_and_note(frame: Frame, now_ns: int) -> list[Frame]:
        asked = drive._codec.read_command(drive.device.can_id, frame)
        told.append(Transmission.of(drive.device).to_joint(asked) if isinstance(asked, SetPoint) else asked)
        return receive(frame, now_ns)

    monkeypatch.setattr(drive, "receive", receive_and_note)
    return told


def assert_damping(drive: EmulatedDrive, told: Sequence[SetPoint | Order | None]) -> None:
    """Nothing but set-points of the device's damping, without stiffness."""
    for target in told:
        assert isinstance(target, SetPoint)
        assert (target.stiffness_nm_rad, target.damping_nm_s_rad) == pytest.approx(
            (0.0, drive.device.damp_nm_s_rad), abs=0.05
        )


@dataclass
class CanRig:
    """A driver with emulated drives behind it."""

    joints: Joints
    emulator: DriveEmulator

    def now_ns(self) -> int:
        return time.monotonic_ns()

    def tick(self, wanted: JointCommand | None) -> JointFeedback:
        """One tick in real time: read, write, wait for the drives' tick."""
        now_ns = self.now_ns()
        feedback = self.joints.read(now_ns)
        if wanted is not None:
            self.joints.write(wanted, now_ns)
        time.sleep(TICK_S)
        return feedback

    def until(self, reached: Callable[[JointFeedback], object], wanted: JointCommand | None = None) -> JointFeedback:
        """Tick until reached; fails after the limit with the last feedback."""
        for _ in range(LOOKS):
            feedback = self.tick(wanted)
            if reached(feedback):
                return feedback
        raise AssertionError(feedback)


class MakeRig(Protocol):
    """What the fixture `make_rig` is."""

    def __call__(self, device: Exoskeleton, emulated: Exoskeleton | None = None) -> CanRig:
        """A rig; `emulated` are the drives really there, when they differ from the description."""
        ...
