"""Rigs for the joints' tests."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, suppress

import pytest

from hal.errors import HardwareError
from hal.joints.can.driver import SocketCanJoints
from hal.joints.device import Exoskeleton
from hal.joints.emulator.emulator import DriveEmulator
from testing.emulated_drives import emulating
from tests.support.can_rig import CanRig, MakeRig


@pytest.fixture
def make_rig() -> Iterator[MakeRig]:
    """Starts emulated drives for a device and a driver that isn't open yet; ends them after the test."""
    with ExitStack() as stack:

        def make(device: Exoskeleton, emulated: Exoskeleton | None = None) -> CanRig:
            emulator = stack.enter_context(emulating(DriveEmulator(emulated or device)))
            joints = SocketCanJoints(device)
            stack.callback(_close, joints)
            return CanRig(joints, emulator)

        yield make


def _close(joints: SocketCanJoints) -> None:
    with suppress(HardwareError):  # a test may leave a drive that can't confirm
        joints.close(0)
