"""The guardian's own path to the drives: damping, then off. It shares only codecs and `Router` with the driver.

Drives that hold their last command for ever go on pushing when control is gone; these two frames a drive protect the
wearer. So everything is packed when the socket is opened, and sending needs nothing but the socket.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import can

from hal.errors import HardwareError
from hal.joints.can.bus import open_bus
from hal.joints.can.drive import Drive, Router
from hal.joints.can.port import RECEIVE_ERRORS, frame_of, message_of
from hal.joints.codecs import codec_of
from hal.joints.codecs.wire import Frame, Order, SetPoint, Transmission
from hal.joints.device import Exoskeleton, JointDevice
from hal.joints.motors import MotorModel, load_motors
from hal.joints.protocol import Joint


class SafeStop:
    """Puts all four drives to damping, or off. What sends returns whether all was sent, and never raises."""

    def __init__(self, device: Exoskeleton, motors: Path | None = None) -> None:
        table = load_motors(motors)
        self._device = device
        models = [table.find(joint.motor) for joint in device.joints]
        pairs = list(zip(device.joints, models, strict=True))
        self._damp = [(joint.can_bus, [_damping(joint, model)]) for joint, model in pairs]
        self._exit = [(joint.can_bus, _off(joint, model)) for joint, model in pairs]
        self._damp_left_on = [
            off if codec_of(model).traits.enabled_by_command else damping
            for model, damping, off in zip(models, self._damp, self._exit, strict=True)
        ]
        self._buses: dict[int, can.BusABC] = {}
        self._failed: set[int] = set()  # buses that could not be sent to, or read
        drives = [Drive(joint, part, model) for joint, (part, model) in zip(Joint, pairs, strict=True)]
        self._routers = [
            Router([drive for drive in drives if drive.device.can_bus == number]) for number in range(len(device.buses))
        ]

    def open(self) -> None:
        """Open the sockets of the buses that are not open, or have failed.

        Raises HardwareError with the command that brings the bus up, after trying the others: they are still needed.
        """
        errors = []
        for number in self._failed & self._buses.keys():
            _release(self._buses.pop(number))
        self._failed.clear()
        for number, bus in enumerate(self._device.buses):
            try:
                if number not in self._buses:
                    self._buses[number] = open_bus(bus)
            except HardwareError as error:
                errors.append(error)
        if errors:
            raise errors[0]

    @property
    def failed(self) -> bool:
        """Whether a bus has failed since it was opened: its adapter may be gone, and plugged in again as another."""
        return bool(self._failed)

    def look(self) -> None:
        """Read a frame of each bus: that tells whether its socket still belongs to an adapter."""
        for number in self._buses:
            next(self._received(number, 1), None)

    def damp(self) -> bool:
        """Command pure damping; repeat it while control stays away, for drives that go limp on a timeout."""
        return self._send(self._damp)

    def damp_left_on(self) -> bool:
        """Damp drives that may be stiff or off; take the torque off those that any set-point would power."""
        return self._send(self._damp_left_on)

    def exit(self) -> bool:
        """Take the torque off."""
        return self._send(self._exit)

    def answered(self) -> frozenset[Joint]:
        """Whose drives have replied, by what has come since the last call: at most 256 frames a bus are read.

        While nobody calls it the sockets fill with replies to control, so the first calls tell of the past.
        """
        joints: set[Joint] = set()
        for number in self._buses:
            senders = (self._routers[number].sender(frame) for frame in self._received(number, 256))
            joints.update(drive.joint for drive in senders if drive is not None)
        return frozenset(joints)

    def close(self) -> None:
        """Release the sockets; may be called twice."""
        for bus in self._buses.values():
            _release(bus)
        self._buses = {}
        self._failed.clear()

    def _send(self, frames: list[tuple[int, list[can.Message]]]) -> bool:
        left = True
        for number, messages in frames:
            for message in messages:
                try:
                    self._buses[number].send(message, 0)
                except KeyError:
                    left = False
                except (can.CanError, OSError):
                    left = False
                    self._failed.add(number)
        return left

    def _received(self, number: int, most: int) -> Iterator[Frame]:
        for _ in range(most):
            try:
                message = self._buses[number].recv(0)
            except RECEIVE_ERRORS:
                self._failed.add(number)
                return
            if message is None:
                return
            yield frame_of(message)


def _release(bus: can.BusABC) -> None:
    """Some adapters are spoken to once more, and may be gone."""
    with suppress(can.CanError, OSError):
        bus.shutdown()


def _damping(joint: JointDevice, model: MotorModel) -> can.Message:
    target = Transmission.of(joint).to_motor(SetPoint(0.0, 0.0, 0.0, joint.damp_nm_s_rad, 0.0))
    neutral_position = target._replace(position_rad=0.0)
    return message_of(codec_of(model).command(joint.can_id, neutral_position))


def _off(joint: JointDevice, model: MotorModel) -> list[can.Message]:
    return [message_of(frame) for frame in codec_of(model).order(joint.can_id, Order.DISABLE)]
