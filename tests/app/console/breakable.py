"""Real control and perception whose joint and camera a test breaks and mends by a signal to their process."""

from __future__ import annotations

import signal
from collections.abc import Callable

from app.control import assembly as assemble
from app.perception import pipeline as build
from app.session.child import run_process
from app.system.config import SessionSetup
from hal.cameras.camera import Camera, Frame
from hal.cameras.digital_hand.driver import DigitalHandCamera
from hal.cameras.digital_hand.render import lens_for
from hal.errors import CameraFault, HardwareError
from hal.joints.protocol import DriveFault, Joint, Joints
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
    """One process of a session, as `app.session.child.begin` runs it, ready to be broken."""
    PREPARE.get(name, lambda: None)()
    run_process(name, setup)


def _breakable_joint() -> None:
    make = assemble.joints_of

    def joints_of(setup: SessionSetup) -> Joints:
        joints = make(setup)
        assert isinstance(joints, SimulatedJoints)
        signal.signal(BREAK, lambda *_: joints.raise_fault(Joint.RIGHT_KNEE, DriveFault.OVER_CURRENT))
        signal.signal(MEND, lambda *_: joints.clear_faults())
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
