"""Four joints without inertia or friction; each thing that can go wrong with them is a field."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hal.errors import HardwareError
from hal.joints.protocol import BusFault, DriveFault, DriveState, Joint, JointArray, JointCommand, JointFeedback


@dataclass
class IdealJoints:
    """Joints that are where a stiff command puts them one tick later."""

    position_rad: JointArray = field(default_factory=lambda: np.array([0.05, 0.1, 0.05, 0.1]))
    state: DriveState = DriveState.PROBED
    faults: tuple[DriveFault, DriveFault, DriveFault, DriveFault] = (DriveFault.NONE,) * 4
    bus: BusFault = BusFault.NONE
    detail: HardwareError | None = None
    temperature_c: JointArray = field(default_factory=lambda: np.full(4, 30.0))
    velocity_rad_s: JointArray = field(default_factory=lambda: np.zeros(4))
    torque_nm: JointArray = field(default_factory=lambda: np.zeros(4))
    stuck: bool = False
    silent: bool = False
    mute: frozenset[Joint] = frozenset()  # these do not answer; what they answered last is reported on
    unasked: frozenset[Joint] = frozenset()  # nor are these asked without power
    answered: dict[Joint, tuple[int, float]] = field(default_factory=dict)  # when and where
    refuse_enable: str = ""
    measured_ns: int = 1

    def take(self, command: JointCommand) -> None:
        """The command's effect until the next tick."""
        stiff = command.stiffness_nm_rad > 0
        if self.state is DriveState.ENABLED and not self.stuck:
            self.position_rad = np.where(stiff, command.position_rad, self.position_rad)

    def feedback(self, now_ns: int) -> JointFeedback:
        """What they report now."""
        if not self.silent:
            self.measured_ns = now_ns
        for joint in set(Joint) - self.mute:
            self.answered[joint] = self.measured_ns, self.position_rad[joint]
        return JointFeedback(
            measured_ns=np.array([self.answered[joint][0] for joint in Joint]),
            position_rad=np.array([self.answered[joint][1] for joint in Joint]),
            velocity_rad_s=self.velocity_rad_s.copy(),
            torque_nm=self.torque_nm.copy(),
            temperature_c=self.temperature_c.copy(),
            faults=self.faults,
            state=self.state,
            bus=self.bus,
            detail=self.detail,
            unasked=self.unasked,
        )
