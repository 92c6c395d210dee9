"""Four emulated drives on their buses, in real time: frames are answered as they come, the body moves by the tick.

`run_emulator` is the process that `rleex emulate-drives` and the demo start.
"""

from __future__ import annotations

import gc
import heapq
import itertools
import os
import signal
import time
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hal.joints.can.bus import open_bus, with_bus
from hal.joints.can.port import CAN_ERR_ACK, CAN_ERR_BUSOFF, BusPort
from hal.joints.codecs.wire import Frame, Transmission
from hal.joints.device import Exoskeleton
from hal.joints.emulator.faults import DEFAULT_VALUE, Fault, ScheduledFault
from hal.joints.emulator.firmware import EmulatedDrive
from hal.joints.emulator.plant import FreeLegs, Motion, Plant, WornExoskeleton
from hal.joints.emulator.scenes import SceneReceiver
from hal.joints.motors import load_motors
from hal.joints.protocol import TICK_NS, Joint, JointCommand

_EARLY_NS = TICK_NS // 2  # having answered, the body may move so much before its time: one awakening does for both
_CATCH_UP_NS = 20_000_000  # behind by more, the body loses time: racing after it would keep the drives from answering
_UPLOAD_TICKS = 5
_FRAMES_A_TURN = 64  # a flood must not stop the body


class _Due(NamedTuple):
    at_ns: int
    number: int  # by which those of one time keep their order
    bus: int
    frame: Frame


class DriveEmulator:
    """The device's four drives; `poll` does what is due and waits for the next frame at most until the next tick."""

    def __init__(self, device: Exoskeleton, plant: Plant | None = None, motors: Path | None = None) -> None:
        table = load_motors(motors)
        self.device = device
        self.drives = tuple(EmulatedDrive(joint, table.find(joint.motor)) for joint in device.joints)
        self._plant = plant if plant is not None else FreeLegs(device)
        self._transmissions = tuple(Transmission.of(joint) for joint in device.joints)
        self._ports: list[BusPort] = []
        self._late: list[_Due] = []  # a heap: the next one first
        self._late_numbers = itertools.count()
        self._tick_ns = 0
        self._ticks = 0
        self._off = False
        self.received = self.lost_ticks = 0

    def open(self) -> None:
        """Join the buses. Raises HardwareError with the command that brings one up."""
        self._ports = [BusPort(open_bus(bus), bus.channel) for bus in self.device.buses]
        self._sense()

    def close(self) -> None:
        """Leave the buses."""
        for port in self._ports:
            port.close()
        self._ports = []

    def inject(self, fault: Fault, joint: Joint | None = None, value: float | None = None) -> None:
        """Inject a fault, at one joint or at all."""
        strength = DEFAULT_VALUE.get(fault, 0.0) if value is None else value
        if fault is Fault.BUS_OFF:
            self._off = True
            self._send_errors(CAN_ERR_BUSOFF)
        elif fault is Fault.ERROR_FRAMES:
            self._send_errors(CAN_ERR_ACK)
        else:
            self._off = self._off and fault is not Fault.HEALED
            for drive in self.drives if joint is None else (self.drives[joint],):
                drive.inject(fault, strength)

    def poll(self, now_ns: int) -> None:
        """Advance the body to now, send what is due, answer what arrives until the next tick."""
        self._advance_until(now_ns)
        while self._late and self._late[0].at_ns <= now_ns:
            due = heapq.heappop(self._late)
            self._send(due.bus, [due.frame])
        wait_s = max(self._tick_ns - time.monotonic_ns(), 0) / 1e9 / len(self._ports)
        served = [self._serve(number, port, wait_s) for number, port in enumerate(self._ports)]
        if any(served):
            self._advance_until(time.monotonic_ns() + _EARLY_NS)

    def run(self, stopped: Callable[[], bool], schedule: tuple[ScheduledFault, ...] = ()) -> None:
        """Poll until stopped, injecting scheduled faults."""
        begin_ns = time.monotonic_ns()
        waiting = sorted(schedule, key=lambda fault: fault.after_s, reverse=True)
        while not stopped():
            now_ns = time.monotonic_ns()
            while waiting and now_ns - begin_ns >= waiting[-1].after_s * 1e9:
                due = waiting.pop()
                self.inject(due.fault, due.joint, due.value)
            self.poll(now_ns)

    def _serve(self, number: int, port: BusPort, wait_s: float) -> bool:
        """Answer what comes; whether anything came."""
        for turn in range(_FRAMES_A_TURN):
            frames = port.wait(0 if turn else wait_s)  # drives ignore what is no frame
            if frames is None:
                return turn > 0
            if not self._off:
                self._send(number, [reply for frame in frames for reply in self._answers(number, frame)])
        return True

    def _answers(self, number: int, frame: Frame) -> list[Frame]:
        """What is answered at once; late drives' answers are put off."""
        self.received += 1
        now_ns = time.monotonic_ns()
        answers: list[Frame] = []
        for drive in self.drives:
            if drive.device.can_bus != number or not drive.accepts(frame):
                continue
            replies = drive.receive(frame, now_ns)
            if drive.late_ns:
                for reply in replies:
                    heapq.heappush(self._late, _Due(now_ns + drive.late_ns, next(self._late_numbers), number, reply))
            else:
                answers += replies
        return answers

    def _advance_until(self, until_ns: int) -> None:
        if self._tick_ns == 0:
            self._tick_ns = until_ns
        lost = max(until_ns - self._tick_ns - _CATCH_UP_NS, 0) // TICK_NS
        self.lost_ticks += lost
        self._tick_ns += lost * TICK_NS
        while self._tick_ns <= until_ns:
            self._advance(self._tick_ns)
            self._tick_ns += TICK_NS

    def _advance(self, now_ns: int) -> None:
        rows = [
            transmission.to_joint(drive.effective(now_ns))
            for transmission, drive in zip(self._transmissions, self.drives, strict=True)
        ]
        position, velocity, stiffness, damping, torque = np.array(rows).T
        self._plant.write(
            JointCommand(
                position_rad=position,
                velocity_rad_s=velocity,
                stiffness_nm_rad=stiffness,
                damping_nm_s_rad=damping,
                torque_nm=torque,
            ),
            now_ns,
        )
        self._sense()
        self._ticks += 1
        if self._ticks % _UPLOAD_TICKS == 0 and not self._off:
            for drive in self.drives:
                self._send(drive.device.can_bus, drive.upload())

    def _sense(self) -> None:
        for transmission, drive, at in zip(self._transmissions, self.drives, self._plant.motions(), strict=True):
            drive.state = Motion(
                transmission.angle_to_motor(at.position_rad),
                at.velocity_rad_s * transmission.ratio,
                at.torque_nm / transmission.ratio,
                at.temperature_c,
            )

    def _send(self, number: int, frames: list[Frame]) -> None:
        if frames:
            self._ports[number].send(*frames)

    def _send_errors(self, bits: int) -> None:
        for port in self._ports:
            port.send_error(bits)


_SCENE_POLLS = 4  # an action's plan takes longer than these few milliseconds
_PRIORITY = 50  # below control: a late body must not delay a tick

if TYPE_CHECKING:
    from hal.joints.body import Body


def run_emulator(
    device: Exoskeleton,
    interface: str = "",
    channel: str = "",
    *,
    body: Body | None = None,
    motors: Path | None = None,
    schedule: tuple[ScheduledFault, ...] = (),
    ready: Event | None = None,
    stop: Event | None = None,
    each_second: Callable[[DriveEmulator], None] | None = None,
) -> None:
    """Emulate the device's drives until `stop` is set, the process is asked to end, or its parent is gone.

    With a `body` the simulated exoskeleton hangs behind the drives, else free legs. `ready` is set once the bus is
    joined. Raises HardwareError when a bus can't be opened.
    """
    device = with_bus(device, interface, channel)
    plant: Plant = FreeLegs(device) if body is None else WornExoskeleton(device, body)
    emulator = DriveEmulator(device, plant, motors)
    scenes = SceneReceiver(device)
    stop_condition = _StopCondition(stop, each_second, emulator)

    def stopped() -> bool:
        if stop_condition.polls % _SCENE_POLLS == 0 and (scene := scenes.receive()) is not None:
            plant.stage(scene)
        return stop_condition()

    try:
        emulator.open()
        _set_scheduling()
        _gc_freeze()
        if ready is not None:
            ready.set()
        emulator.run(stopped, schedule)
    finally:
        emulator.close()
        scenes.close()


class _StopCondition:
    """Whether to end, asked before every poll; the slow conditions are checked every 50th time."""

    def __init__(
        self, stop: Event | None, each_second: Callable[[DriveEmulator], None] | None, emulator: DriveEmulator
    ) -> None:
        self._parent = os.getppid()
        self._stop = stop
        self._each_second = each_second
        self._emulator = emulator
        self.polls = 0
        self._second_s = time.monotonic()
        self._ended = False
        signal.signal(signal.SIGTERM, self._end)

    def _end(self, _number: int, _frame: object) -> None:
        self._ended = True

    def __call__(self) -> bool:
        self.polls += 1
        if self.polls % 50 == 0:
            self._ended = self._ended or os.getppid() != self._parent
            self._ended = self._ended or (self._stop is not None and self._stop.is_set())
            if self._each_second is not None and time.monotonic() - self._second_s >= 1.0:
                self._second_s = time.monotonic()
                self._each_second(self._emulator)
        return self._ended


def _set_scheduling() -> None:
    """Drives answer within a fraction of a millisecond: where the privilege exists, so does their emulation.

    On whichever core is free: pinned to control's core, and with usual priority, the drives answered too late.
    """
    with suppress(OSError, AttributeError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))


def _gc_freeze() -> None:
    """With MuJoCo loaded a full collection takes so long that all drives seem silent."""
    gc.collect()
    gc.freeze()
