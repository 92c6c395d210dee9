"""Access to the joints: commands pass the guard, drive orders are executed, an abnormal end is damped."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Protocol, runtime_checkable

import numpy as np

from app.control.inputs import DriveOrder
from app.ipc.states import Action
from app.motion import follower
from app.motion.follower import Gains, Mode, Motion
from hal.errors import HardwareError
from hal.joints.device import Joint
from hal.joints.guard import Guard, Limits, Refusal
from hal.joints.protocol import TICK_HZ, DriveFault, DriveState, JointCommand, JointFeedback, Joints, carries_power
from hal.joints.scene import Scene
from logs.reason import Reason, reason_of

_DAMPING_TICKS = int((follower.DAMPING_RAMP_S + 0.05) * TICK_HZ)


@runtime_checkable
class StageableJoints(Protocol):
    """Simulated joints, whose feet stand in a scene."""

    def stage(self, scene: Scene) -> None:
        """Put the scene of the coming action around the feet."""
        ...


@runtime_checkable
class FeltJoints(Protocol):
    """Simulated joints, whose feet feel the ground."""

    def contact_n(self) -> tuple[float, float]:
        """Vertical force on the left and the right foot."""
        ...


@runtime_checkable
class ConfirmingJoints(Protocol):
    """Real joints: some may be on that have not confirmed that they are off."""

    unconfirmed: Sequence[object]


class Drives:
    """Joints behind their guard."""

    def __init__(
        self, joints: Joints, limits: Limits, gains: Gains, scenes: Mapping[Action, Scene] | None = None
    ) -> None:
        self._joints = joints
        self._closed: Joints | None = None  # the driver itself while an AbsentJoints stands in for it
        self._guard = Guard(limits)
        self._gains = gains
        self._scenes = scenes or {}
        self._probe_next = False  # torque off was confirmed in the tick before
        self.powered = False
        self.unconfirmed = False  # a drive may be on that has not confirmed the last order
        self.error: Reason | None = None  # why the last order failed
        self.written: JointCommand | None = None  # what left last
        self.written_ns = 0
        self.refusal: Refusal | None = None  # of the last command
        self.withheld = False  # the last command was not written

    def open(self, now_ns: int) -> None:
        """Probe the drives; one that does not answer leaves `error`, and joints that say so."""
        joints = self._closed or self._joints
        try:
            joints.open(now_ns)
        except HardwareError as error:
            self.error = reason_of(error)
            self._joints, self._closed = AbsentJoints(error), joints
        else:
            self._joints, self._closed = joints, None

    def read(self, now_ns: int) -> JointFeedback:
        """What the joints report."""
        feedback = self._joints.read(now_ns)
        self.powered = carries_power(feedback.state)
        return feedback

    def write(
        self, command: JointCommand, feedback: JointFeedback, now_ns: int, unheld: frozenset[Joint] = frozenset()
    ) -> None:
        """Write a command that passes the guard, else the last one that did, without its speed.

        unheld: joints that are not held any more, whatever was written last.
        """
        previous = self.written if self.powered else None
        if unheld and previous is not None:
            previous = follower.without_stiffness(previous, unheld)
        self.withheld = False
        self.refusal = self._guard.check(command, previous, feedback.position_rad)
        if self.refusal is not None:
            command = replace(previous or follower.NEUTRAL, velocity_rad_s=np.zeros(4))
        self._joints.write(command, now_ns)
        self.written, self.written_ns = command, time.monotonic_ns()

    def withhold(self) -> None:
        """Leave this tick's command out: what was written before stays in force."""
        self.withheld, self.refusal = True, None

    def stage_scene(self, action: Action) -> None:
        """Put the scene of the coming action around simulated feet."""
        scene = self._scenes.get(action)
        if scene is not None and isinstance(self._joints, StageableJoints):
            self._joints.stage(scene)

    def contact_n(self) -> tuple[float, float] | None:
        """Force on simulated feet; None: these joints know none."""
        return self._joints.contact_n() if isinstance(self._joints, FeltJoints) else None

    def execute(self, order: DriveOrder, now_ns: int) -> bool:
        """Execute an order; whether the drives' answers were waited for.

        In the tick after a torque off the drives are opened again: without power, too, their angles and faults count.
        An absent driver is given another try by it. A session that ends has no such tick.
        """
        self.error = None
        probe, self._probe_next = self._probe_next, False
        if order is DriveOrder.NONE and not probe:
            return False
        try:
            if order is DriveOrder.ENABLE:
                self._enable(now_ns)
            elif order is DriveOrder.DISABLE:
                self._switch_off(now_ns)
                self.powered = False  # confirmed: nothing is left to damp, nor to guard
                self._probe_next = True
            else:
                self.open(now_ns)
        except HardwareError as error:
            self.error = reason_of(error)
        return True

    def close(
        self, beat: Callable[[], None] = lambda: None, awaiting: Callable[[], None] = lambda: None
    ) -> Reason | None:
        """Leave nothing powered behind, whatever has happened; what could not be confirmed.

        beat: called in every tick while the joints are damped; awaiting: before their answers are waited for. Without
        a heartbeat the guardian would act.
        """
        try:
            if self.powered and self.written is not None:
                self._damp(self.written, beat)
            awaiting()
            self._switch_off(time.monotonic_ns())
        except HardwareError as error:
            return reason_of(error)
        finally:
            self.powered = False
        return None

    def _enable(self, now_ns: int) -> None:
        """Closed, never opened or faulted drives are probed anew before they are enabled."""
        if self._joints.read(now_ns).state is not DriveState.PROBED:
            self._switch_off(now_ns)
            self.open(now_ns)
        self.unconfirmed = True
        try:
            self._joints.enable(time.monotonic_ns())
        finally:  # where it failed, too, most drives have confirmed that they are off
            self.unconfirmed = isinstance(self._joints, ConfirmingJoints) and bool(self._joints.unconfirmed)

    def _switch_off(self, now_ns: int) -> None:
        self.unconfirmed = True
        self._joints.close(now_ns)
        self.unconfirmed = False

    def _damp(self, last: JointCommand, beat: Callable[[], None]) -> None:
        """Without `step`: ramp from the last command to damping, by the clock."""
        motion = follower.ramp_to_damping(Motion(mode=Mode.HOLDING, command=last))
        for _ in range(_DAMPING_TICKS):
            motion = follower.advance(motion, self._gains, hold=True)
            now_ns = time.monotonic_ns()
            self.write(motion.command, self.read(now_ns), now_ns)
            beat()
            time.sleep(1 / TICK_HZ)


_UNKNOWN = np.full(4, np.nan)
_NEVER_NS = np.zeros(4, dtype=np.int64)


class AbsentJoints:
    """Stands in for a driver that refused to open, until the next try."""

    def __init__(self, error: HardwareError) -> None:
        self._error = error

    def open(self, now_ns: int) -> None:  # noqa: ARG002 - the Protocol's
        """Raises HardwareError: that is why it stands here."""
        raise self._error

    def enable(self, now_ns: int) -> None:  # noqa: ARG002 - the Protocol's
        """Raises HardwareError."""
        raise self._error

    def write(self, command: JointCommand, now_ns: int) -> None:
        """Does nothing."""

    def read(self, now_ns: int) -> JointFeedback:  # noqa: ARG002 - the Protocol's
        """Unknown values: no joint has ever answered."""
        return JointFeedback(
            measured_ns=_NEVER_NS,
            position_rad=_UNKNOWN,
            velocity_rad_s=_UNKNOWN,
            torque_nm=_UNKNOWN,
            temperature_c=_UNKNOWN,
            faults=(DriveFault.NONE,) * 4,
            state=DriveState.UNCONFIGURED,
            detail=self._error,
        )

    def close(self, now_ns: int) -> None:
        """Nothing is open."""
