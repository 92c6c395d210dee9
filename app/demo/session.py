"""A whole session without a terminal: set up in a home of its own or a given one, run, closed, verified."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import msgspec
from rich.console import Console
from rich.table import Table

from app.audit.sink import AuditSink
from app.demo.runner import ScenarioRunner
from app.demo.scenario import Attempt, Step, run_scenario, spread
from app.ipc.messages import PerceptionCommand
from app.ipc.snapshot import Lateness, PauseSummary
from app.ipc.states import ACTION_OF, Action
from app.session.host import SessionHost
from app.session.setup import make_setup
from app.system.authority import demonstration
from app.system.config import CameraConfig, Config, JointsConfig, SessionSetup, load_config
from app.system.paths import Home, pictures_path
from app.text.catalogue import tr
from hal.cameras.digital_hand.render import person_of
from logs.records import Recording
from profiles.schema import DEMO_PATIENT, DistanceUsed, Palm, Profile


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionResult:
    """What a session gave."""

    attempts: tuple[Attempt, ...]
    unintended: int
    audit_verified: bool
    audit_detail: str
    perception_fps: float
    lateness: Lateness
    session: str
    pauses: PauseSummary = field(default_factory=PauseSummary)
    load: int = 0  # busy processes beside it

    def last_of(self, scenario: Sequence[Step]) -> tuple[Attempt, ...]:
        """The last attempt of each step that was tried: what an interlock interrupted was made again."""
        last = {attempt.gesture: attempt for attempt in self.attempts}
        return tuple(last[step.gesture] for step in scenario if step.gesture in last)

    @property
    def interruptions(self) -> tuple[Attempt, ...]:
        """The attempts that an interlock held or ended."""
        return tuple(attempt for attempt in self.attempts if attempt.interrupted)

    def as_json(self, scenario: Sequence[Step]) -> dict[str, Any]:
        """As `rleex demo --json` writes it."""
        late = self.lateness
        return {
            "actions": [attempt.row() for attempt in self.last_of(scenario)],
            "asked": len(scenario),
            "interruptions": [attempt.row() for attempt in self.interruptions],
            "unintended": self.unintended,
            "audit_verified": self.audit_verified,
            "perception_fps": round(self.perception_fps, 1),
            "tick_lateness_ms": {"p50": late.p50_ms, "p99": late.p99_ms, "p99.9": late.p999_ms, "max": late.max_ms},
            "ticks": late.ticks,
            "missed_ticks": late.missed,
            "pauses": self.pauses.count,
            "paused_s": round(self.pauses.total_s, 3),
            "load": self.load,
            "session": self.session,
        }

    def passed(self, scenario: Sequence[Step]) -> bool:
        """Everything asked happened, nothing else did, and the audit trail proves it."""
        last = self.last_of(scenario)
        all_done = len(last) == len(scenario) and all(attempt.ok for attempt in last)
        return all_done and self.unintended == 0 and self.audit_verified


UNATTENDED_S = 10.0  # nobody takes over a demo that was killed


def demo_config(base: Config, *, seed: int, joints: JointsConfig, record: bool = False) -> Config:
    """The lab's configuration with the digital hand of that seed and its limits, those joints; recorded or not."""
    camera = CameraConfig(kind="digital-hand", seed=seed, limit=base.camera.limit, depth_holes=base.camera.depth_holes)
    return Config(
        camera=camera,
        joints=joints,
        button=base.button,
        recording=msgspec.structs.replace(base.recording, on=record),
        rules=base.rules,
        model=base.model,
        control_core=base.control_core,
        unattended_s=UNATTENDED_S,
    )


DEPTH_THRESHOLD_M = 0.34  # a D435i is blind nearer than 25 cm: by depth alone the press is farther out


def demo_patient(
    seed: int, distance: DistanceUsed = DistanceUsed.MONOCULAR, patient: Profile = DEMO_PATIENT
) -> Profile:
    """A patient with the palm of that seed's digital hand, as a therapist would have measured it."""
    palm = Palm(measured_width_m=person_of(seed).shape.palm_width_m)
    threshold_m = DEPTH_THRESHOLD_M if distance is DistanceUsed.DEPTH else DEMO_PATIENT.press_threshold_m
    return msgspec.structs.replace(
        patient, palm=palm, calibrations=(), distance_source=distance, press_threshold_m=threshold_m
    )


def run_session(
    home: Home,
    config: Config,
    scenario: Sequence[Step],
    *,
    click_s: float,
    presses: int,
    watch: Callable[[str], None],
    approach_m: float = 0.0,
    load: int = 0,
    pictures: bool = False,
    patient: Profile | None = None,
    other: Home | None = None,
    run_attempts: Callable[[ScenarioRunner, Sequence[Step]], list[Attempt]] = run_scenario,
) -> SessionResult:
    """Start the real processes, carry out the scenario, close, verify the audit trail; None: the demo patient.

    load: how many busy processes the caller has started beside it, for the result. pictures: recorded as well. other:
    home of the computer that has the joints, if it is another one: its trail is verified too.
    """
    wearer = patient or demo_patient(config.camera.seed)
    setup = make_setup(home, config, wearer, demonstration(home, config.joints))
    if other is not None:
        at_joints = load_config(other.config)
        rehearse_missing(msgspec.structs.replace(setup, home=other.root, config=at_joints), watch)
    else:
        rehearse_missing(setup, watch)
    host = SessionHost(setup)
    runner = ScenarioRunner(host, click_s=click_s, presses=presses, approach_m=approach_m, watch=watch)
    try:
        host.start()
        runner.prepare()
        if pictures:
            record_pictures(host)
        attempts = run_attempts(runner, scenario)
    finally:
        host.close()
    verified, detail = _verify(setup.session, home, *((other,) if other is not None else ()))
    return SessionResult(
        attempts=tuple(attempts),
        unintended=runner.unintended(),
        audit_verified=verified,
        audit_detail=detail,
        perception_fps=runner.perception_fps(),
        lateness=runner.snapshot.lateness if runner.snapshot else Lateness(),
        pauses=runner.snapshot.pauses if runner.snapshot else PauseSummary(),
        load=load,
        session=setup.session,
    )


def record_pictures(host: SessionHost, *, consent: bool = True) -> None:
    """The demo patient agrees to pictures, or withdraws it, as a console records it."""
    setup = host.setup
    sink = AuditSink(setup.links, "console", setup.operator)
    sink.emit(Recording(on=consent, consent=consent, path=pictures_path(Home(setup.home).logs, setup.session).name))
    sink.close()
    host.send_to_perception(PerceptionCommand(record_pictures=consent))


def rehearse_missing(setup: SessionSetup, watch: Callable[[str], None]) -> None:
    """The pre-flight of every action that this patient has not passed yet in this device: hardware requires it."""
    from app.control.assembly import cleared_of, device_of
    from app.motion.plan import patient_of
    from app.motion.preflight import run_preflight

    if setup.config.joints.kind == "simulated":
        return
    watch(tr("demo.preflight"))
    missing = [action for action in Action if action not in (cleared_of(setup) or ())]
    run_preflight(Home(setup.home), patient_of(setup.profile, device_of(setup)), device_of(setup), missing)


def _verify(session: str, *homes: Home) -> tuple[bool, str]:
    """The trail of each computer by its own keys; of two, that each proves the other."""
    from app.text.recorded import render_recorded
    from logs.findings import Finding, summary
    from logs.join import join_findings
    from logs.keys import by_fingerprint, known_keys
    from logs.verify import Evidence, exit_status, verify

    findings = [
        finding
        for home in homes
        for finding in verify([home.logs / f"{session}.jsonl"], Evidence(keys=by_fingerprint(known_keys(home.keys))))
    ]
    joins = join_findings(findings) if len(homes) > 1 else []
    joined = [Finding(file=join.file, status=join.status) for join in joins]
    whole = len(joins) >= 2 * (len(homes) - 1)
    text = "; ".join(summary(finding, render_recorded) for finding in findings)
    return whole and exit_status([*findings, *joined]) == 0, text


def print_result(console: Console, result: SessionResult, scenario: Sequence[Step]) -> None:
    """The table, one line a gesture, and its summary."""
    table = Table(title="rleex demo")
    for heading in ("gesture", "action", "recognised", "presses", "states"):
        table.add_column(tr(f"demo.table.{heading}"))
    for heading in ("from_recognition", "from_release", "visible", "tracking", "result"):
        table.add_column(tr(f"demo.table.{heading}"), justify="left" if heading == "result" else "right")
    for attempt in result.attempts:
        table.add_row(*_cells(attempt))
    console.print(table)
    if result.interruptions:
        console.print(tr("demo.interrupted", count=len(result.interruptions)))
    done = sum(attempt.ok for attempt in result.last_of(scenario))
    proof = tr("demo.verified") if result.audit_verified else tr("demo.not_verified", detail=result.audit_detail)
    console.print(tr("demo.summary", done=done, asked=len(scenario), unintended=result.unintended, proof=proof))
    release = spread(attempt.response_from_release_ms for attempt in result.attempts)
    if release is not None:
        console.print(tr("demo.response", median_ms=release.p50, p99_ms=release.p99))
    if result.pauses.count:
        console.print(tr("demo.pauses", count=result.pauses.count, total_s=result.pauses.total_s))
    if result.load:
        console.print(tr("demo.load", count=result.load))
    console.print(tr("demo.fps", fps=result.perception_fps))
    late = result.lateness
    console.print(
        tr("demo.lateness", p50=late.p50_ms, p99=late.p99_ms, most=late.max_ms, missed=late.missed, ticks=late.ticks)
    )


def _cells(attempt: Attempt) -> list[str]:
    return [
        attempt.gesture.value,
        tr(ACTION_OF[attempt.gesture]),
        tr("demo.by_key" if attempt.by_key else "demo.yes" if attempt.recognised else "demo.no"),
        "–" if attempt.by_key else str(attempt.presses) if attempt.pressed else tr("demo.no"),
        f"{tr(attempt.start)} → {tr(attempt.end)}",
        _ms(attempt.response_from_recognition_ms),
        _ms(attempt.response_from_release_ms),
        _ms(attempt.visible_motion_ms),
        "–" if attempt.tracking_rms_deg is None else f"{attempt.tracking_rms_deg:.2f}°",
        tr("demo.ok") if attempt.reason is None else tr("demo.failed", reason=attempt.reason),
    ]


def _ms(value: float | None) -> str:
    return "–" if value is None else f"{value:.0f} ms"
