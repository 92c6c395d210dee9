"""Pre-flight: before an action first moves a patient in the real device, its rehearsal must have passed.

A result holds for exactly the parameters it was made with: body, gait, ranges, device and program version together
name its file in the home. Whatever changes, the rehearsal is asked for anew.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable
from importlib.metadata import version
from pathlib import Path

import msgspec
import numpy as np
from msgspec import Struct

from app.ipc.states import Action, GaitState
from app.motion.patient import Patient, patient_of
from app.motion.plan import Phase, PlanRequest
from app.motion.rehearsal import SEQUENCES, STARTS, WALK_PHASES, rehearse
from app.motion.rehearsal_checks import Verdict
from app.motion.trajectory import nominal_pose, plan
from app.system.paths import Home
from hal.errors import HardwareError
from hal.joints.device import Exoskeleton
from hal.joints.guard import limits_of
from profiles.errors import ProfileError
from profiles.schema import Profile


class PreflightResult(Struct, frozen=True, kw_only=True):
    """Whether an action may move this patient in this device, and the sentence that says why not."""

    action: Action
    passed: bool
    reason: str = ""


def preflight_key(patient: Patient, device: Exoskeleton, action: Action) -> str:
    """Hexadecimal name of everything that a rehearsal depends on."""
    body = {name: getattr(patient.body, name) for name in patient.body.__dataclass_fields__}
    ranges = (patient.hip_max_rad, patient.knee_max_rad)
    content = msgspec.json.encode((version("rleex"), action, body, patient.gait, ranges, device), order="sorted")
    return hashlib.sha256(content).hexdigest()


def preflight_passed(home: Home, patient: Patient, device: Exoskeleton, action: Action) -> PreflightResult:
    """What is on record for an action with exactly these parameters."""
    record = _record(home, patient, device, action)
    try:
        verdict = msgspec.json.decode(record.read_bytes(), type=Verdict)
    except FileNotFoundError:
        reason = f"{action.value}: no pre-flight with these parameters yet; run `rleex simulate all --preflight`."
        return PreflightResult(action=action, passed=False, reason=reason)
    except (OSError, msgspec.MsgspecError) as error:
        reason = f"{action.value}: the pre-flight on record can't be read ({error}); run it again."
        return PreflightResult(action=action, passed=False, reason=reason)
    if verdict.action != action.value:
        return PreflightResult(action=action, passed=False, reason=f"{action.value}: the record is another action's.")
    reason = "" if verdict.passed else f"{action.value}: the pre-flight failed. {' '.join(verdict.reasons)}"
    return PreflightResult(action=action, passed=verdict.passed, reason=reason)


def cleared_actions(home: Home, patient: Patient, device: Exoskeleton) -> frozenset[Action]:
    """The actions that have passed."""
    return frozenset(action for action in Action if preflight_passed(home, patient, device, action).passed)


def run_preflight(
    home: Home,
    patient: Patient,
    device: Exoskeleton,
    actions: Iterable[Action] = tuple(Action),
    watch: Callable[[Action], None] = lambda _: None,
) -> tuple[PreflightResult, ...]:
    """Rehearse actions and keep the verdicts; a second or two each. Raises OSError when the home can't be written."""
    results = []
    for action in actions:
        watch(action)
        keep_verdict(home, patient, device, action, rehearse(patient, device, action).verdict)
        results.append(preflight_passed(home, patient, device, action))
    return tuple(results)


def keep_verdict(home: Home, patient: Patient, device: Exoskeleton, action: Action, verdict: Verdict) -> None:
    """Put a verdict on record, whole or not at all."""
    record = _record(home, patient, device, action)
    record.parent.mkdir(parents=True, exist_ok=True)
    draft = record.with_suffix(".new")
    draft.write_bytes(msgspec.json.encode(verdict))
    draft.replace(record)


def _record(home: Home, patient: Patient, device: Exoskeleton, action: Action) -> Path:
    return home.root / "preflight" / f"{preflight_key(patient, device, action)}.json"


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
