"""Console or control stopped (SIGSTOP) in mid-movement, N times each: what the legs did; a table, or --json FILE.

console: real processes, a step, for each length. control: real processes, every action near its fastest phase; the
simulated joints go on under their last command. phases: simulated in lockstep, every action at N ticks in a row about
its fastest one, with joint speed and torque of every tick. Ctrl-C ends it with what has been measured.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

from rich.console import Console
from rich.progress import track
from rich.table import Table

from app.control.events.programs import CONTROL_LATE_MS, CONTROL_STALLED_MS
from app.evaluate.loop.dropout import dropouts, fastest_moment
from app.ipc.messages import OperatorKind
from app.ipc.snapshot import ControlSnapshot
from app.ipc.states import Action, Effect, Event, Outcome
from app.motion.plan import Patient, patient_of
from app.motion.rehearsal import RehearsalRun
from app.system.scheduling import set_scheduling
from hal.joints.device import load_exoskeleton
from hal.joints.guard import limits_of
from logs.read import records, session_paths
from logs.records import EventRaised, GuardRefusal
from profiles.schema import DEMO_PATIENT
from testing.session import RealSession
from tools.bench_stop import FIRST_STEP, InterlockError, act, reach, stand

Item = TypeVar("Item")
A = Action
CONSOLE_S = (0.1, 0.3, 0.9, 1.5)
CONTROL_S = (0.010, 0.020, 0.040, 0.080)
MIDDLE = 0.4  # of the step in which the console is stopped
AFTER: dict[Action, tuple[Action, ...]] = {
    A.STAND_UP: (A.SIT_DOWN,),
    A.STEP_LEFT: FIRST_STEP,
    A.STEP_END: FIRST_STEP,
    A.STEP_RIGHT: (*FIRST_STEP, A.STEP_LEFT),
}
FAULTS = {Event.OVER_SPEED.value, Event.OVER_TORQUE.value, Event.FOLLOWING_LIMIT.value, Event.UNEXPECTED_MOTION.value}
LIMITS = limits_of(load_exoskeleton())
TRIES = 5  # a busy host may hold the legs before they are where they are to be stopped


@dataclass(slots=True)
class Cell:
    """The trials of one kind: how they ended; the worst joint's share of its limits from the stop to the end."""

    ends: dict[str, int] = field(default_factory=lambda: defaultdict(int))
    speed: float = 0.0
    torque: float = 0.0
    refusals: int = 0

    def see(self, now: ControlSnapshot) -> None:
        """Take the joints of a snapshot (20 Hz; control itself compares every tick with its limits)."""
        for joint, speed, torque in zip(now.joints, LIMITS.speed_rad_s, LIMITS.torque_nm, strict=True):
            self.speed = max(self.speed, abs(joint.speed_rad_s) / speed)
            self.torque = max(self.torque, abs(joint.torque_nm) / torque)

    def row(self) -> dict[str, object]:
        """For the table and JSON."""
        ends = ", ".join(f"{name} {count}" for name, count in sorted(self.ends.items()))
        return {
            "ends": ends,
            "speed_share": round(self.speed, 3),
            "torque_share": round(self.torque, 3),
            "guard_refusals": self.refusals,
        }


Cells = dict[tuple[str, str, float], Cell]  # series, action, length in ms


def moments(patient: Patient) -> dict[Action, tuple[int, float]]:
    """Of each action its fastest movement's number and how far it is through it then, 0 to 1."""
    device = load_exoskeleton()
    found = {action: fastest_moment(patient, RehearsalRun(patient, device, action), action) for action in Action}
    return {action: (number, row / rows) for action, (number, row, rows) in found.items()}


def go_to(session: RealSession, action: Action, moment: tuple[int, float]) -> None:
    """From wherever the legs are into the movement, as far as that. Raises InterlockError."""
    number, share = moment
    stand(session)
    now = session.snapshot
    assert now is not None
    for before in AFTER.get(action, ()):
        act(session, before)
    if action is A.INITIALISE:  # from between: a step that was stopped
        session.send(OperatorKind.ACT, A.STEP_RIGHT_FIRST)
        reach(session, lambda s: s.action is A.STEP_RIGHT_FIRST and s.progress > MIDDLE, "the step")
        session.send(OperatorKind.STOP)
        session.until(lambda s: s.effect is Effect.HOLD, "the stop")
        session.settle()
    steps = now.steps
    session.send(OperatorKind.ACT, A.WALK if action is A.WALK_END else action)
    if action is A.WALK_END:
        reach(session, lambda s: s.steps > steps, "a step of the walk")
        session.send(OperatorKind.ACT, A.WALK_END)
        number = 0
    least = steps + number
    reach(session, lambda s: s.action is action and s.progress >= share and s.steps >= least, action.value)


def stop_and_see(session: RealSession, name: str, stop_s: float, action: Action, cell: Cell) -> str:
    """Stop a process, let it go on, wait for the end of the movement: how it ended."""
    before = session.snapshot
    assert before is not None
    known = {report.number for report in before.reports if report.outcome is not Outcome.RUNNING}
    end_ns = session.kill(name, signal.SIGSTOP) + int(stop_s * 1e9)
    while (left_s := (end_ns - time.monotonic_ns()) / 1e9) > 0:
        if left_s > 0.03 and name == "console":
            session.poll()
        else:
            time.sleep(left_s)
    session.kill(name, signal.SIGCONT)
    if action is A.WALK:
        session.poll()
        session.send(OperatorKind.ACT, A.WALK_END)

    def over(now: ControlSnapshot) -> bool:
        if now.at_ns > end_ns:
            cell.see(now)
        return now.at_ns > end_ns and (now.action is None or now.effect >= Effect.HOLD)

    now = session.until(over, "the end of the movement")
    if now.effect >= Effect.HOLD:
        causes = (one.event.value for one in now.events if one.effect is now.effect and not one.acknowledged)
        return f"{'damped' if now.effect is Effect.DAMP else 'held'} ({', '.join(causes)})"
    done = [report.outcome for report in now.reports if report.number not in known]
    if Outcome.COMPLETED not in done:
        return "ended early"
    return "paused, completed" if now.pauses.count > before.pauses.count else "completed"


Trial = tuple[str, Action, tuple[int, float], float]  # process, action, moment, seconds


def trials(series: str, times: int) -> Iterator[Trial]:
    """What is to be done with real processes, the lengths in turn."""
    where = moments(patient_of(DEMO_PATIENT, load_exoskeleton())) if series == "control" else {}
    for _ in range(times):
        if series == "console":
            yield from (("console", A.STEP_RIGHT_FIRST, (0, MIDDLE), stop_s) for stop_s in CONSOLE_S)
        else:
            yield from (("control", action, where[action], stop_s) for stop_s in CONTROL_S for action in Action)


def real_series(home: Path, series: str, times: int, only: str, cells: Cells) -> dict[str, int]:
    """Trials with real processes; what the trail says of all their ticks: guard refusals and joint faults."""
    wanted = [trial for trial in trials(series, times) if only in trial[1].value]
    with RealSession(home, unattended_s=600.0) as session, suppress(KeyboardInterrupt):
        session.stand()
        set_scheduling("heartbeat")  # to let go on in time
        for name, action, moment, stop_s in shown(wanted, series):
            cell = cells.setdefault((series, action.value, stop_s * 1000), Cell())
            for _ in range(TRIES):
                with suppress(InterlockError):
                    go_to(session, action, moment)
                    cell.ends[stop_and_see(session, name, stop_s, action, cell)] += 1
                    break
    bodies = [one.body for path in session_paths(home / "logs") for one in records(path)]
    faults = sum(isinstance(body, EventRaised) and body.event in FAULTS for body in bodies)
    return {"guard_refusals": sum(isinstance(body, GuardRefusal) for body in bodies), "joint_faults": faults}


def lockstep(times: int, cells: Cells) -> None:
    """Every action at so many phases, simulated: control holds beyond its limit, pauses and goes on below."""
    device = load_exoskeleton()
    patient = patient_of(DEMO_PATIENT, device)
    lengths = [stop_s * 1000 for stop_s in CONTROL_S]
    with suppress(KeyboardInterrupt):
        for action in shown(list(Action), "phases"):
            for one in dropouts(
                patient,
                device,
                action,
                lengths,
                times,
                pause_from_ms=CONTROL_LATE_MS,
                hold_from_ms=CONTROL_STALLED_MS,
            ):
                cell = cells.setdefault(("phases", action.value, one.missing_ms), Cell())
                cell.ends[_effect(one.missing_ms)] += 1
                cell.speed, cell.torque = max(cell.speed, one.speed_share), max(cell.torque, one.torque_share)
                cell.refusals += one.guard_refusal is not None


def _effect(missing_ms: float) -> str:
    return "held" if missing_ms > CONTROL_STALLED_MS else "paused" if missing_ms > CONTROL_LATE_MS else "went on"


def shown(what: list[Item], name: str) -> Iterable[Item]:
    """With a bar where somebody looks."""
    return track(what, description=name, disable=not os.isatty(1))


def worst(cells: Cells) -> Table:
    """A row a series, action and length."""
    table = Table("stopped", "action", "ms", "times: end", "speed, of the limit", "torque", "guard refused")
    for (series, action, length_ms), cell in cells.items():
        row = cell.row()
        refused = str(cell.refusals) if series == "phases" else ""
        table.add_row(
            series, action, f"{length_ms:g}", str(row["ends"]), f"{cell.speed:.0%}", f"{cell.torque:.0%}", refused
        )
    return table


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--times", type=int, default=3, help="of each kind; 20 for docs/safety.md")
    parser.add_argument("--series", choices=("console", "control", "phases"), nargs="+", default=["console", "phases"])
    parser.add_argument("--only", default="", help="actions whose name contains this, with real processes")
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    cells: Cells = {}
    trail = {}
    for series in asked.series:
        with tempfile.TemporaryDirectory() as folder:
            if series == "phases":
                lockstep(asked.times, cells)
            else:
                trail[series] = real_series(Path(folder), series, asked.times, asked.only, cells)
    console = Console(width=None if os.isatty(1) else 140)
    console.print(worst(cells))
    for series, found in trail.items():
        console.print(f"{series}: in every tick of all trials " + ", ".join(f"{k} {v}" for k, v in found.items()))
    if asked.json:
        rows = [{"stopped": s, "action": a, "ms": ms, **cell.row()} for (s, a, ms), cell in cells.items()]
        asked.json.write_text(json.dumps({"trials": rows, "trail": trail}, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
