"""STOP under load, and what follows a death: measured with real processes, printed as a table or --json FILE.

STOP is pressed in the console's own process while everything else runs; a press counts until the first changed joint
command has been written. Between presses the legs are brought back and walk again, or step and rest in turn.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from app.config import JointsConfig
from app.control.states import Action, Effect, GaitState
from app.demo.emulation import emulated_drives
from app.messages import OperatorKind
from hal.joints.device import load_exoskeleton

sys.path.insert(0, str(Path(__file__).parent.parent))  # run as a script, `tools` is a folder of the tree

from tools.real_session import RealSession, Sniffer, real_session

LIMITS_MS = {"stop_p99": 25.0, "console_killed_to_hold": 250.0, "control_killed_to_damping": 50.0}


def stops(session: RealSession, presses: int) -> list[float]:
    """From the key to the first changed joint command, ms, while the legs move."""
    times_ms = []
    session.stand()
    for _ in track(range(presses), description="STOP", disable=not os.isatty(1)):
        session.send(OperatorKind.ACT, Action.WALK)
        session.until(lambda s: s.action is Action.WALK and s.progress > 0.1, "a walk")
        pressed_ns = time.monotonic_ns()
        session.send(OperatorKind.STOP)
        times_ms.append((stop_written(session, pressed_ns) - pressed_ns) / 1e6)
        recover(session)
    return times_ms


def stop_written(session: RealSession, pressed_ns: int) -> int:
    """When the first command after this press left."""
    return session.until(lambda s: s.stop_command_ns > pressed_ns, "the stop").stop_command_ns


def recover(session: RealSession) -> None:
    """Acknowledge, and bring the legs back to standing."""
    time.sleep(0.2)  # the hold's own time
    session.send(OperatorKind.ACKNOWLEDGE)
    session.until(lambda s: s.effect < Effect.HOLD and bool(s.allowed), "acknowledgement")
    session.send(OperatorKind.ACT, Action.INITIALISE)
    session.until(lambda s: s.state is GaitState.STANDING and s.action is None, "the way back")


def console_killed(home: Path) -> float:
    """From the console's death to the hold, ms."""
    with real_session(home) as session:
        session.walk()
        killed_ns = session.kill("console")
        held = session.until(lambda s: s.effect >= Effect.HOLD, "hold")
        first = next((at for at, name in session.effects if name == "HOLD" and at > killed_ns), held.at_ns)
        return (first - killed_ns) / 1e6


def control_killed(home: Path) -> float:
    """From control's death to the last of the four drives' damping frames on the bus, ms."""
    drives = {joint.can_id for joint in load_exoskeleton().joints}
    with emulated_drives(JointsConfig(kind="can"), wearer=False) as joints:
        sniffer = Sniffer(joints.interface, joints.channel)
        try:
            with real_session(home, joints) as session:
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
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--presses", type=int, default=200)
    parser.add_argument("--kills", type=int, default=5)
    parser.add_argument("--no-perception", action="store_true", help="without the camera's load beside it")
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        with real_session(home, perception=not asked.no_perception) as session:
            times_ms = stops(session, asked.presses)
        console_ms = [console_killed(home) for _ in range(asked.kills)]
        control_ms = [control_killed(home) for _ in range(asked.kills)]
    rows = {
        "stop_p50": float(np.percentile(times_ms, 50)),
        "stop_p99": float(np.percentile(times_ms, 99)),
        "stop_max": max(times_ms),
        "console_killed_to_hold": max(console_ms),
        "control_killed_to_damping": max(control_ms),
    }
    table = Table("measure", "ms", "bound")
    for name, value in rows.items():
        bound = LIMITS_MS.get(name)
        table.add_row(name, f"{value:.1f}", "" if bound is None else f"≤ {bound:g} {'yes' if value <= bound else 'NO'}")
    Console().print(table)
    if asked.json:
        asked.json.write_text(json.dumps({"presses": len(times_ms), **rows}, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
