"""STOP under load, and what follows a death: measured with real processes, printed as a table or --json FILE.

STOP is pressed in the console's own process while everything else runs; a press counts until the first joint command
that obeys it has been written. It is pressed in every resting state and in the middle of every movement, in turn; in
between the legs are brought back to standing.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import signal
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from app.demo.drives import busy_processes, emulated_drives
from app.ipc.messages import OperatorKind
from app.ipc.snapshot import ControlSnapshot
from app.ipc.states import Action, Effect, Event, GaitState
from app.system.config import JointsConfig
from app.text.catalogue import render
from hal.joints.device import load_exoskeleton
from testing.session import RealSession, Sniffer
from testing.watched_session import WatchedSession

MIDDLE = 0.3  # of a movement: STOP is pressed beyond it
LIMITS_MS = {"stop_p99": 25.0, "console_killed_to_pause": 250.0, "control_killed_to_damping": 50.0}


@dataclass(frozen=True, slots=True, kw_only=True)
class Situation:
    """Where STOP is pressed: after these actions from standing, and in the middle of one more, if any."""

    after: tuple[Action, ...] = ()
    during: Action | None = None

    @property
    def name(self) -> str:
        """For the table."""
        if self.during is not None:
            return f"during {self.during.value}"
        return f"after {self.after[-1].value}" if self.after else "standing"


_A = Action
FIRST_STEP = (_A.STEP_RIGHT_FIRST,)
SITUATIONS = (
    Situation(),
    Situation(after=(_A.SIT_DOWN,)),
    Situation(after=FIRST_STEP),
    Situation(after=(*FIRST_STEP, _A.STEP_LEFT)),
    Situation(during=_A.STEP_RIGHT_FIRST),
    Situation(after=FIRST_STEP, during=_A.STEP_LEFT),
    Situation(after=(*FIRST_STEP, _A.STEP_LEFT), during=_A.STEP_RIGHT),
    Situation(after=FIRST_STEP, during=_A.STEP_END),
    Situation(during=_A.WALK),
    Situation(during=_A.STAIR_UP),
    Situation(during=_A.STAIR_DOWN),
    Situation(during=_A.OBSTACLE),
    Situation(during=_A.SIT_DOWN),
    Situation(after=(_A.SIT_DOWN,), during=_A.STAND_UP),
)


class InterlockError(Exception):
    """The legs were held before STOP was pressed: a host that stood still."""


WAYS_BACK = (_A.INITIALISE, _A.STAND_UP, _A.STEP_END, _A.STEP_RIGHT)  # to standing, the first that is allowed


@dataclass(slots=True)
class Stops:
    """From the key to the first changed joint command, ms, by situation; how often an interlock came before it."""

    times_ms: dict[str, list[float]]
    interlocks: int = 0


def stops(session: WatchedSession, presses: int) -> Stops:
    """STOP in every situation in turn; the two before there is power come first."""
    session.send(OperatorKind.CONFIRM_PATIENT)
    session.until(lambda s: s.patient_confirmed and bool(s.allowed), "readiness")
    found = Stops({"unpowered": [press(session)]})
    session.settle()
    session.send(OperatorKind.ACT, Action.INITIALISE)
    reach(session, lambda s: s.action is Action.INITIALISE and s.progress > MIDDLE, "the way to standing")
    found.times_ms["during initialise"] = [press(session)]
    for number in track(range(max(0, presses - 2)), description="STOP", disable=not os.isatty(1)):
        press_in(session, SITUATIONS[number % len(SITUATIONS)], found)
    session.settle()
    return found


def press_in(session: WatchedSession, situation: Situation, found: Stops) -> None:
    """From wherever the legs are into the situation, as often as an interlock comes between, and STOP there."""
    while True:
        try:
            stand(session)
            go(session, situation)
        except InterlockError:
            found.interlocks += 1
        else:
            found.times_ms.setdefault(situation.name, []).append(press(session))
            return


def go(session: WatchedSession, situation: Situation) -> None:
    """From standing into the situation. Raises InterlockError."""
    for action in situation.after:
        act(session, action)
    if situation.during is not None:
        session.send(OperatorKind.ACT, situation.during)
        reach(session, lambda s: s.action is situation.during and s.progress > MIDDLE, situation.name)


def act(session: WatchedSession, action: Action) -> None:
    """Carry one action out to its end. Raises InterlockError."""
    reach(session, lambda s: action in s.allowed, f"leave for {action.value}")
    session.send(OperatorKind.ACT, action)
    reach(session, lambda s: s.action is action, action.value)
    reach(session, lambda s: s.action is None and bool(s.allowed), f"the end of {action.value}")


def reach(session: WatchedSession, wanted: Callable[[ControlSnapshot], bool], what: str) -> ControlSnapshot:
    """Look until control says so. Raises InterlockError where the legs are held instead."""
    now = session.until(lambda s: wanted(s) or s.effect >= Effect.HOLD, what)
    if now.effect >= Effect.HOLD:
        raise InterlockError(render(now.why_not) if now.why_not else "")
    return now


def press(session: WatchedSession) -> float:
    """One STOP: ms until the first command after it has been written."""
    pressed_ns = time.monotonic_ns()
    session.send(OperatorKind.STOP)
    return (stop_written(session, pressed_ns) - pressed_ns) / 1e6


def stop_written(session: WatchedSession, pressed_ns: int) -> int:
    """When the first command after this press left."""
    return session.until(lambda s: s.stop_command_ns > pressed_ns, "the stop").stop_command_ns


def stand(session: WatchedSession) -> None:
    """From wherever the legs are back to standing; where the way back is refused, by torque off and on again.

    Raises InterlockError.
    """
    while (now := session.settle()).state is not GaitState.STANDING:
        back = next(action for action in WAYS_BACK if action in now.allowed)
        refused = now.refusal_count
        session.send(OperatorKind.ACT, back)
        if not granted(session, refused):
            torque_off(session)


def granted(session: WatchedSession, refusals: int) -> bool:
    """Whether the action just asked for is carried out, to its end; refusals: how many there had been."""
    reach(session, lambda s: s.action is not None or s.refusal_count > refusals, "an answer")
    return reach(session, lambda s: s.action is None, "the end of the action").refusal_count == refusals


def torque_off(session: WatchedSession) -> None:
    """STOP twice, torque off when the joints have given way, acknowledge."""
    session.send(OperatorKind.STOP)
    session.send(OperatorKind.STOP)
    session.until(lambda s: s.effect is Effect.DAMP, "giving way")
    session.send(OperatorKind.TORQUE_OFF)
    session.until(lambda s: not s.enabled, "torque off")
    session.send(OperatorKind.ACKNOWLEDGE)
    session.until(lambda s: s.effect < Effect.HOLD and bool(s.allowed), "acknowledgement")


def console_killed(home: Path) -> float:
    """From the console's death to the pause that becomes a hold after a second, ms."""
    with RealSession(home) as session:
        session.walk()
        killed_ns = session.kill("console")
        session.until(lambda s: _console_lost_ns(s) > 0, "its event")
        paused_ns = _console_lost_ns(session.snapshot)
        session.until(lambda s: s.effect >= Effect.HOLD, "hold")
        return (paused_ns - killed_ns) / 1e6


def _console_lost_ns(now: ControlSnapshot | None) -> int:
    """Since when control has missed its console; 0: it has not."""
    events = now.events if now else ()
    return next((one.since_ns for one in events if one.event is Event.CONSOLE_TIMEOUT and one.present), 0)


def control_killed(home: Path) -> float:
    """From control's death to the last of the four drives' damping frames on the bus, ms."""
    drives = {joint.can_id for joint in load_exoskeleton().joints}
    with emulated_drives(JointsConfig(kind="can"), wearer=None) as joints:
        sniffer = Sniffer(joints.interface, joints.channel)
        try:
            with RealSession(home, joints) as session:
                session.send(OperatorKind.CONFIRM_PATIENT)
                session.until(lambda s: s.patient_confirmed and bool(s.allowed), "readiness")
                session.send(OperatorKind.ACT, Action.INITIALISE)
                session.until(lambda s: s.enabled and s.action is Action.INITIALISE and s.progress > 0.1, "power")
                killed_ns = session.kill("control", signal.SIGKILL)
                session.until(lambda _: session.guardian is not None and session.guardian.acted, "the guardian")
        finally:
            sniffer.close()
    first: dict[int, int] = {}
    for at, identifier, data in sniffer.frames:
        slack = not (data[3] & 0x0F or data[4]) and not data.startswith(b"\xff" * 7)
        if at > killed_ns and identifier in drives and slack:
            first.setdefault(identifier, at)
    return (max(first.values()) - killed_ns) / 1e6 if len(first) == len(drives) else float("inf")


def main() -> None:
    """Measure and print."""
    asked = arguments()
    load = busy_processes(len(os.sched_getaffinity(0))) if asked.saturate else contextlib.nullcontext()
    with tempfile.TemporaryDirectory() as folder, load:
        home = Path(folder)
        with RealSession(home, perception=not asked.no_perception) as session:
            found = stops(session, asked.presses)
        console_ms = [console_killed(home) for _ in range(asked.kills)]
        control_ms = [control_killed(home) for _ in range(asked.kills)]
    every = np.concatenate(list(found.times_ms.values()))
    rows = {
        "stop_p50": float(np.percentile(every, 50)),
        "stop_p99": float(np.percentile(every, 99)),
        "stop_max": float(every.max()),
        **(
            {"console_killed_to_pause": max(console_ms), "control_killed_to_damping": max(control_ms)}
            if console_ms
            else {}
        ),
    }
    show(found, rows)
    if asked.json:
        worst = {name: max(ms) for name, ms in found.times_ms.items()}
        written = {"presses": len(every), "interlocks": found.interlocks, **rows, "worst_by_state": worst}
        asked.json.write_text(json.dumps(written, indent=1) + "\n", encoding="utf-8")


def arguments() -> argparse.Namespace:
    """What the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--presses", type=int, default=200)
    parser.add_argument("--kills", type=int, default=5)
    parser.add_argument("--saturate", action="store_true", help="a process that never rests on every core meanwhile")
    parser.add_argument("--no-perception", action="store_true", help="without the camera's load beside it")
    parser.add_argument("--json", type=Path)
    return parser.parse_args()


def show(found: Stops, rows: dict[str, float]) -> None:
    """The figures beside their bounds, and the worst press of every state."""
    states = Table("STOP pressed", "times", "worst ms")
    for name, times_ms in found.times_ms.items():
        states.add_row(name, str(len(times_ms)), f"{max(times_ms):.1f}")
    table = Table("measure", "ms", "bound")
    for name, value in rows.items():
        bound = LIMITS_MS.get(name)
        table.add_row(name, f"{value:.1f}", "" if bound is None else f"≤ {bound:g} {'yes' if value <= bound else 'NO'}")
    console = Console()
    console.print(states)
    console.print(table)
    console.print(f"held by an interlock before the press, and begun again: {found.interlocks}")


if __name__ == "__main__":
    main()
