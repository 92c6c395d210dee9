"""From a session's setup to control's settings and joints."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from app.control.drives import Drives
from app.control.inputs import Settings
from app.ipc.states import Action, GaitState
from app.motion.follower import gains_of
from app.motion.plan import body_of, patient_of
from app.motion.preflight import cleared_by, preflight_records
from app.motion.trajectory import nominal_pose, scene_of
from app.system.config import SessionSetup, load_device
from app.system.paths import Home
from app.system.vocabulary import vocabulary_of
from hal.joints.device import Exoskeleton
from hal.joints.factory import make_joints
from hal.joints.guard import limits_of
from hal.joints.protocol import Joints

POSED_STATES = (GaitState.STANDING, GaitState.SITTING, GaitState.RIGHT_FORWARD, GaitState.LEFT_FORWARD)


def device_of(setup: SessionSetup) -> Exoskeleton:
    """The device that the configuration names. Raises HardwareError."""
    return load_device(setup.config.joints)


def settings_of(setup: SessionSetup) -> Settings:
    """Limits, gains and poses of this patient in this device. Raises HardwareError."""
    device, profile = device_of(setup), setup.profile
    patient = patient_of(profile, device)
    return Settings(
        limits=limits_of(device, profile.hip_max_rad, profile.knee_max_rad),
        gains=gains_of(device, profile.gait.assist_left, profile.gait.assist_right),
        poses={state: nominal_pose(state, patient) for state in POSED_STATES},
        warn_c=np.array([joint.warn_c for joint in device.joints]),
        limit_c=np.array([joint.limit_c for joint in device.joints]),
        patient=profile.identifier,
        vocabulary=vocabulary_of(profile),
        device_high_rad=limits_of(device).high_rad,
        unattended_ns=int(setup.config.unattended_s * 1e9),
    )


def joints_of(setup: SessionSetup) -> Joints:
    """The joints that the configuration names, not open yet. Raises HardwareError."""
    chosen = setup.config.joints
    return make_joints(
        chosen.kind,
        device_of(setup),
        body_of(setup.profile),
        motors=Path(chosen.motors) if chosen.motors else None,
        interface=chosen.interface,
        channel=chosen.channel,
    )


def drives_of(setup: SessionSetup, settings: Settings) -> Drives:
    """The door to the joints, not open yet."""
    patient = patient_of(setup.profile, device_of(setup))
    scenes = {action: scene_of(action, patient) for action in Action}  # only simulated feet are staged
    return Drives(joints_of(setup), settings.limits, settings.gains, scenes)


def cleared_of(setup: SessionSetup) -> frozenset[Action] | None:
    """The actions whose pre-flight this patient has passed in this device; None where none is needed (simulated)."""
    return clearance_of(setup)()


def clearance_of(setup: SessionSetup) -> Callable[[], frozenset[Action] | None]:
    """What answers `cleared_of` again and again, for the device as its file describes it now. Raises HardwareError.

    It raises nothing, and a file that is edited during a session changes no limit that is in force, and so no answer.
    """
    if setup.config.joints.kind == "simulated":
        return lambda: None
    device = device_of(setup)
    kept = preflight_records(Home(setup.home), patient_of(setup.profile, device), device)
    return lambda: cleared_by(kept)
