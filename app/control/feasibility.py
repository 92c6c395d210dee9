"""What this wearer's legs can do in this device: asked when a profile is saved, so that nobody finds out on a stair."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from app.control.patient import patient_of
from app.control.plan import Phase, PlanRequest
from app.control.rehearsal import SEQUENCES, STARTS, WALK_PHASES
from app.control.states import Action, GaitState
from app.control.trajectory import nominal_pose, plan
from hal.errors import HardwareError
from hal.joints.device import Exoskeleton
from hal.joints.guard import limits_of
from profiles.errors import ProfileError
from profiles.schema import Profile

CHECKED = tuple(action for action in Action if action not in {Action.INITIALISE, Action.WALK_END})


def check_profile(profile: Profile, device: Exoskeleton) -> list[str]:
    """One sentence for each action that can't be planned, with the joint and its numbers; [] when all can.

    Also refuses ranges that would loosen the device's.
    """
    try:
        limits_of(device, profile.hip_max_rad, profile.knee_max_rad)
    except HardwareError as error:
        return [str(error)]
    patient = patient_of(profile, device)
    found = []
    for action in CHECKED:
        start = STARTS.get(action, GaitState.STANDING)
        pose = nominal_pose(start, patient)
        pose = np.where(np.isfinite(pose), pose, 0.0)
        quad = (float(pose[0]), float(pose[1]), float(pose[2]), float(pose[3]))
        phases = WALK_PHASES[:2] if action in SEQUENCES else ((action, Phase.WHOLE),)
        for number, (part, phase) in enumerate(phases):
            request = PlanRequest(number=number, action=part, phase=phase, from_state=start, start_rad=quad)
            check = plan(request, patient).check
            if not check.ok:
                found.append(f"{action.value}: {check.reason}")
                break
    return found


def refuse_unfit(device: Exoskeleton) -> Callable[[Profile], None]:
    """A check for the profile store: raises ProfileError with the first action that this leg can't do."""

    def check(profile: Profile) -> None:
        for reason in check_profile(profile, device)[:1]:
            raise ProfileError(f"{profile.identifier} can't be saved: {reason}")

    return check
