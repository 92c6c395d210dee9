"""A whole session without a terminal: set up in a home of its own or a given one, run, closed, verified."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec

from app.demo.course import Leg
from app.demo.journey import run_course
from app.demo.runner import CourseRunner
from app.demo.trial import Trial
from app.ipc.messages import Lateness
from app.ipc.states import Action
from app.session.host import SessionHost, make_setup
from app.system.config import CameraConfig, Config, JointsConfig, SessionSetup
from app.system.paths import Home
from hal.cameras.digital_hand.render import person_of
from profiles.schema import DEMO_PATIENT, Palm, Profile


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionResult:
    """What a session gave."""

    trials: tuple[Trial, ...]
    unintended: int
    audit_verified: bool
    audit_detail: str
    perception_fps: float
    lateness: Lateness
    session: str

    def last_of(self, course: Sequence[Leg]) -> tuple[Trial, ...]:
        """The last trial of each leg that was tried: what an interlock interrupted was made again."""
        last = {trial.gesture: trial for trial in self.trials}
        return tuple(last[leg.gesture] for leg in course if leg.gesture in last)

    @property
    def interruptions(self) -> tuple[Trial, ...]:
        """The trials that an interlock held or ended."""
        return tuple(trial for trial in self.trials if trial.interrupted)

    def as_json(self, course: Sequence[Leg]) -> dict[str, Any]:
        """As `rleex demo --json` writes it."""
        late = self.lateness
        return {
            "actions": [trial.row() for trial in self.last_of(course)],
            "asked": len(course),
            "interruptions": [trial.row() for trial in self.interruptions],
            "unintended": self.unintended,
            "audit_verified": self.audit_verified,
            "perception_fps": round(self.perception_fps, 1),
            "tick_lateness_ms": {"p50": late.p50_ms, "p99": late.p99_ms, "p99.9": late.p999_ms, "max": late.max_ms},
            "ticks": late.ticks,
            "missed_ticks": late.missed,
            "session": self.session,
        }

    def passed(self, course: Sequence[Leg]) -> bool:
        """Everything asked happened, nothing else did, and the audit trail proves it."""
        last = self.last_of(course)
        all_done = len(last) == len(course) and all(trial.ok for trial in last)
        return all_done and self.unintended == 0 and self.audit_verified


def demo_config(base: Config, *, seed: int, joints: JointsConfig) -> Config:
    """The lab's configuration with the digital hand of that seed and those joints."""
    camera = CameraConfig(kind="digital-hand", seed=seed)
    return Config(camera=camera, joints=joints, button=base.button, rules=base.rules, model=base.model)


def demo_patient(seed: int) -> Profile:
    """The demo patient with the palm of that seed's digital hand, as a therapist would have measured it."""
    width_m = person_of(seed).shape.palm_width_m
    return msgspec.structs.replace(DEMO_PATIENT, palm=Palm(measured_width_m=width_m))


def run_session(
    home: Home,
    config: Config,
    course: Sequence[Leg],
    *,
    click_s: float,
    presses: int,
    watch: Callable[[str], None],
    approach_m: float = 0.0,
    patient: Profile | None = None,
    carry_out: Callable[[CourseRunner, Sequence[Leg]], list[Trial]] = run_course,
) -> SessionResult:
    """Start the real processes, carry out the course, close, verify the audit trail; None: the demo patient."""
    wearer = patient or demo_patient(config.camera.seed)
    setup = make_setup(home, config, wearer, operator="demo", role="engineer")
    if config.joints.kind != "simulated":
        rehearse_missing(setup, watch)
    host = SessionHost(setup)
    runner = CourseRunner(host, click_s=click_s, presses=presses, approach_m=approach_m, watch=watch)
    try:
        host.start()
        runner.prepare()
        trials = carry_out(runner, course)
    finally:
        host.close()
    verified, detail = _verify(home, setup.session)
    return SessionResult(
        trials=tuple(trials),
        unintended=runner.unintended(),
        audit_verified=verified,
        audit_detail=detail,
        perception_fps=runner.perception_fps(),
        lateness=runner.snapshot.lateness if runner.snapshot else Lateness(),
        session=setup.session,
    )


def rehearse_missing(setup: SessionSetup, watch: Callable[[str], None]) -> None:
    """The pre-flight of every action that this patient has not passed yet in this device: hardware asks for it."""
    from app.control.assembly import cleared_of, device_of
    from app.motion.patient import patient_of
    from app.motion.preflight import run_preflight

    watch("pre-flight simulation of the actions (once)")
    missing = [action for action in Action if action not in (cleared_of(setup) or ())]
    run_preflight(Home(setup.home), patient_of(setup.profile, device_of(setup)), device_of(setup), missing)


def _verify(home: Home, session: str) -> tuple[bool, str]:
    from app.text.recorded import render_recorded
    from logs.findings import summary
    from logs.keys import by_fingerprint, known_keys
    from logs.verify import Evidence, exit_status, verify

    findings = verify([home.logs / f"{session}.jsonl"], Evidence(keys=by_fingerprint(known_keys(home.keys))))
    return exit_status(findings) == 0, "; ".join(summary(finding, render_recorded) for finding in findings)
