"""One place that turns a kind by name into a driver behind the Joints Protocol."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from hal.errors import DeviceFault, HardwareError
from hal.joints.device import Exoskeleton
from hal.joints.protocol import Joints

if TYPE_CHECKING:
    from hal.joints.body import Body

KINDS = ("simulated", "can")


def make_joints(
    kind: str,
    device: Exoskeleton,
    body: Body | None = None,
    *,
    motors: Path | None = None,
    interface: str = "",
    channel: str = "",
) -> Joints:
    """A session's driver that isn't open yet; `interface` and `channel` override the device's bus.

    `simulated` needs a body, which has come to rest in the harness.
    Raises HardwareError for an unknown kind, a missing body or a device that the motor table can't serve.
    """
    if kind == "can":
        from hal.joints.can.bus import with_bus
        from hal.joints.can.driver import SocketCanJoints
        from hal.joints.emulator.scenes import EmulatedCanJoints, may_be_emulated

        device = with_bus(device, interface, channel)
        driver = EmulatedCanJoints if may_be_emulated(device) else SocketCanJoints
        return driver(device, motors=motors, damp_first=True)
    if kind == "simulated":
        if body is None:
            raise HardwareError(DeviceFault.NO_BODY)
        from hal.joints.simulated.driver import SimulatedJoints

        joints = SimulatedJoints(device, body)
        joints.settle()
        return joints
    raise HardwareError(DeviceFault.UNKNOWN_JOINTS_KIND, kind=kind, known=", ".join(KINDS))
