"""Pre-flight: before an action first moves a patient in the real device, its rehearsal must have passed.

A result holds for exactly what it was made with: body, gait, ranges, device and the program's files that it follows
from together name its file in the home. Whatever changes, a new rehearsal is due.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping
from enum import Enum
from pathlib import Path

import msgspec
import numpy as np
from msgspec import Struct

from app.ipc.states import Action, GaitState
from app.motion.plan import Patient, Phase, PlanRequest, patient_of, quad
from app.motion.rehearsal import SEQUENCES, STARTS, rehearse
from app.motion.rehearsal_checks import RehearsalVerdict
from app.motion.trajectory import nominal_pose, plan
from app.system.paths import Home
from app.system.program import rehearsal_identity
from hal.errors import HardwareError
from hal.joints.device import Exoskeleton
from hal.joints.guard import limits_of
from logs.reading.errors import cause_of
from logs.reading.formats import read_json
from logs.reason import Reason, reason, reason_of
from profiles.errors import ProfileError
from profiles.schema import Profile


class PreflightResult(Struct, frozen=True, kw_only=True):
    """Whether an action may move this patient in this device."""

    action: Action
    reason: Reason | None = None  # why not

    @property
    def passed(self) -> bool:
        """Whether it may."""
        return self.reason is None


class PreflightFault(Enum):
    """Why an action may not move this patient."""

    MISSING = "missing"
    UNREADABLE = "unreadable"
    OTHER_ACTION = "record of another action"
    FAILED = "failed"
    NOT_PLANNABLE = "not plannable"
    PROFILE_REFUSED = "profile refused"
    NOT_SAVED = "results not saved"


def preflight_key(patient: Patient, device: Exoskeleton, action: Action) -> str:
    """Hexadecimal name of everything that a rehearsal depends on."""
    ranges = (patient.hip_max_rad, patient.knee_max_rad)
    content = (rehearsal_identity(), action, patient.body, patient.gait, ranges, device)
    return hashlib.sha256(msgspec.json.encode(content, order="sorted")).hexdigest()


def preflight_passed(home: Home, patient: Patient, device: Exoskeleton, action: Action) -> PreflightResult:
    """What is on record for an action with exactly these parameters."""
    return PreflightResult(action=action, reason=_why_not(_record(home, patient, device, action), action))


def _why_not(record: Path, action: Action) -> Reason | None:
    try:
        verdict = read_json(record, RehearsalVerdict)
    except FileNotFoundError:
        return reason(PreflightFault.MISSING, action=action)
    except OSError as error:
        return reason(PreflightFault.UNREADABLE, action=action, detail=cause_of(error))
    if verdict.action is not action:
        return reason(PreflightFault.OTHER_ACTION, action=action)
    return None if verdict.passed else reason(PreflightFault.FAILED, action=action, reasons=verdict.reasons)


def cleared_actions(home: Home, patient: Patient, device: Exoskeleton) -> frozenset[Action]:
    """The actions that have passed."""
    return cleared_by(preflight_records(home, patient, device))


def preflight_records(home: Home, patient: Patient, device: Exoskeleton) -> dict[Action, Path]:
    """Where the verdicts for exactly these parameters are kept, or will be."""
    return {action: _record(home, patient, device, action) for action in Action}


def cleared_by(kept: Mapping[Action, Path]) -> frozenset[Action]:
    """The actions that have passed by what is kept now; a verdict that can't be read clears nothing."""
    return frozenset(action for action, record in kept.items() if _why_not(record, action) is None)


def run_preflight(
    home: Home,
    patient: Patient,
    device: Exoskeleton,
    actions: Iterable[Action] = tuple(Action),
    watch: Callable[[Action], None] = lambda _: None,
) -> tuple[PreflightResult, ...]:
    """Rehearse actions and keep the verdicts; up to 3 s each. Raises OSError when the home can't be written."""
    results = []
    for action in actions:
        watch(action)
        keep_verdict(home, patient, device, action, rehearse(patient, device, action).verdict)
        results.append(preflight_passed(home, patient, device, action))
    return tuple(results)


def keep_verdict(home: Home, patient: Patient, device: Exoskeleton, action: Action, verdict: RehearsalVerdict) -> None:
    """Put a verdict on record, whole or not at all."""
    record = _record(home, patient, device, action)
    record.parent.mkdir(parents=True, exist_ok=True)
    draft = record.with_suffix(".new")
    draft.write_bytes(msgspec.json.encode(verdict))
    draft.replace(record)


def _record(home: Home, patient: Patient, device: Exoskeleton, action: Action) -> Path:
    return home.root / "preflight" / f"{preflight_key(patient, device, action)}.json"


CHECKED = tuple(action for action in Action if action not in {Action.INITIALISE, Action.WALK_END})


def check_profile(profile: Profile, device: Exoskeleton) -> list[Reason]:
    """A reason for each action that can't be planned; [] when all can.

    Also refuses ranges that would loosen the device's.
    """
    try:
        limits_of(device, profile.hip_max_rad, profile.knee_max_rad)
    except HardwareError as error:
        return [reason_of(error)]
    patient = patient_of(profile, device)
    found = []
    for action in CHECKED:
        start = STARTS.get(action, GaitState.STANDING)
        pose = nominal_pose(start, patient)
        pose = np.where(np.isfinite(pose), pose, 0.0)
        phases = dict.fromkeys(SEQUENCES.get(action, ((action, Phase.WHOLE),)))
        requests = [
            PlanRequest(number=number, action=part, phase=phase, from_state=start, start_rad=quad(pose))
            for number, (part, phase) in enumerate(phases)
        ]
        why = next(filter(None, (plan(request, patient).check.reason for request in requests)), None)
        if why is not None:
            found.append(reason(PreflightFault.NOT_PLANNABLE, action=action, reason=why))
    return found


def refuse_unfit(device: Exoskeleton) -> Callable[[Profile], None]:
    """A check for the profile store: raises ProfileError with the first action that this leg can't do."""

    def check(profile: Profile) -> None:
        for why in check_profile(profile, device)[:1]:
            raise ProfileError(PreflightFault.PROFILE_REFUSED, profile=profile.identifier, reason=why)

    return check
