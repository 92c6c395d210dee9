"""Real control and perception whose joint and camera a test breaks and mends by a signal to their process."""

from __future__ import annotations

import signal
from collections.abc import Callable
from dataclasses import replace

from app.control import assembly as assemble
from app.perception import pipeline as build
from app.session.child import run_process
from app.system.config import SessionSetup
from hal.cameras.camera import Camera, Frame
from hal.cameras.digital_hand.driver import DigitalHandCamera
from hal.cameras.digital_hand.render import lens_for
from hal.errors import CameraFault, HardwareError
from hal.joints.protocol import DriveFault, DriveState, JointFeedback, Joints
from hal.joints.simulated import driver
from hal.joints.simulated.driver import SimulatedJoints
from logs.reason import reason

BREAK, MEND = signal.SIGUSR1, signal.SIGUSR2
UNPLUGGED = reason(CameraFault.UNPLUGGED, camera="digital hand")


class UnpluggableHand(DigitalHandCamera):
    """A digital hand whose cable can be pulled."""

    unplugged = False

    def open(self) -> None:
        """As ever, while it is plugged in."""
        self._look()
        super().open()

    def read(self, timeout_s: float) -> Frame | None:
        """As ever, while it is plugged in."""
        self._look()
        return super().read(timeout_s)

    def plug(self, *, into: bool) -> None:
        """Push the plug in, or pull it."""
        self.unplugged = not into

    def _look(self) -> None:
        if self.unplugged:
            raise HardwareError(CameraFault.UNPLUGGED, camera="digital hand")


def begin_breakable(name: str, setup: SessionSetup) -> None:
    """One process of a session, as `run_process` runs it, ready to be broken."""
    PREPARE.get(name, lambda: None)()
    run_process(name, setup)


class BreakableJoints(SimulatedJoints):
    """Simulated joints of which the right knee's drive reports a fault while it is broken."""

    broken = False

    def read(self, now_ns: int) -> JointFeedback:
        """As ever, but for the fault."""
        feedback = super().read(now_ns)
        if not self.broken:
            return feedback
        none = DriveFault.NONE
        return replace(feedback, faults=(none, none, none, DriveFault.OVER_CURRENT), state=DriveState.FAULTED)

    def hurt(self, *, broken: bool) -> None:
        """Break the drive, or mend it."""
        self.broken = broken


def _breakable_joint() -> None:
    make = assemble.joints_of
    driver.SimulatedJoints = BreakableJoints  # type: ignore[misc]  # what the factory makes

    def joints_of(setup: SessionSetup) -> Joints:
        joints = make(setup)
        assert isinstance(joints, BreakableJoints)
        signal.signal(BREAK, lambda *_: joints.hurt(broken=True))
        signal.signal(MEND, lambda *_: joints.hurt(broken=False))
        return joints

    assemble.joints_of = joints_of


def _breakable_camera() -> None:
    def make_camera(setup: SessionSetup) -> Camera:
        wanted = setup.config.camera
        lens = lens_for(wanted.width_px, wanted.height_px, wanted.focal_px)
        camera = UnpluggableHand(seed=wanted.seed, lens=lens, rate_hz=wanted.rate_hz)
        signal.signal(BREAK, lambda *_: camera.plug(into=False))
        signal.signal(MEND, lambda *_: camera.plug(into=True))
        return camera

    build.make_camera = make_camera


PREPARE: dict[str, Callable[[], None]] = {"control": _breakable_joint, "perception": _breakable_camera}
