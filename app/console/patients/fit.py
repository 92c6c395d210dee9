"""Whether a patient's legs can do in this device what the profile asks: looked at when it is saved."""

from __future__ import annotations

from pathlib import Path

from app.system.config import JointsConfig
from hal.joints.device import DEFAULT_DEVICE, load_exoskeleton
from profiles.errors import ProfileError
from profiles.schema import Profile
from profiles.store import Check


def fits(joints: JointsConfig) -> Check:
    """A check for the store: raises ProfileError with the first action that can't be, its joint and numbers."""

    def check(profile: Profile) -> None:
        from app.motion.preflight import check_profile  # the planner: not before the first paint

        if profile.archived:
            return
        device = load_exoskeleton(Path(joints.device) if joints.device else DEFAULT_DEVICE)
        for sentence in check_profile(profile, device):
            raise ProfileError(sentence)

    return check
