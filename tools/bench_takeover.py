"""A terminal closed in each gait state and in movement, and the session taken over from another: real `rleex run`s.

For each situation: the legs are brought there by keys; a second `rleex run` meanwhile must be refused; the terminal is
closed; the next one finds the held session, acknowledges, and leads the legs back to standing. Ctrl-C ends it with what
has been done; --json FILE writes it too.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

from rich.console import Console
from rich.progress import track
from rich.table import Table

from app.ipc.messages import OperatorKind
from app.ipc.states import Action, Effect, GaitState
from app.system.paths import Home
from testing.watched_session import WatchedSession
from tools.bench_console import Terminal
from tools.bench_control import ConsoleSession, links_of
from tools.bench_stop import MIDDLE, SITUATIONS, InterlockError, Situation, go, reach, stand
from tools.pty_program import configure

GONE_S = 2.0  # docs/safety.md: the console is gone within it
POWER_ON = Situation(during=Action.INITIALISE)
ANSWER_S = 3.0
TRIES = 5  # a busy host may hold the legs on their way


class Terminals(ConsoleSession):
    """One session under one terminal after the other."""

    def __init__(self, home: Path, environment: dict[str, str]) -> None:
        self._home, self._environment = home, environment
        first = self._open()
        first.wait(b"STOP")
        super().__init__(first, links_of(Home(home), first))

    def poll(self, wait_s: float = 0.02) -> None:
        """Without the keys that a bench of the console types meanwhile."""
        WatchedSession.poll(self, wait_s)

    def send(self, kind: OperatorKind, action: Action | None = None) -> None:
        """Type it; an action's key that did nothing, as on a busy host, is typed again."""
        before = self.snapshot.refusal_count if self.snapshot else 0
        for _ in range(TRIES):
            super().send(kind, action)
            limit_s = time.monotonic() + ANSWER_S
            while action is not None and time.monotonic() < limit_s:
                self.poll()
                now = self.now
                if action in {now.action, now.pending} or now.refusal_count > before or now.effect >= Effect.HOLD:
                    return
            if action is None:
                return

    def hang_up(self) -> float:
        """Close the terminal, as a lost SSH connection does: seconds until its console has ended."""
        self._stop_drawing()
        closed_s = time.monotonic()
        os.close(self._terminal.master)
        self._terminal.child.wait(30.0)
        return time.monotonic() - closed_s

    def take_over(self) -> float:
        """`rleex run` in another terminal: seconds until control hears it."""
        assert self.snapshot is not None
        lease, begun_s = self.snapshot.lease, time.monotonic()
        self._terminal = self._open()
        self._start_drawing()
        self.until(lambda now: now.lease > lease, "the takeover")
        return time.monotonic() - begun_s

    def second_is_refused(self) -> bool:
        """Whether another console beside this one ends by itself, with an error."""
        second = self._open()
        with suppress(OSError):
            while second.child.poll() is None:
                second.idle(0.05)
        os.close(second.master)
        return second.child.returncode == 2

    def close(self) -> None:
        """End the session, whichever terminal is there."""
        self.end()
        self._terminal.close()

    def _open(self) -> Terminal:
        return Terminal(self._home, 80, 24, self._environment)


def bring(session: Terminals, situation: Situation | None) -> None:
    """The legs into the situation; None: without power. Raises InterlockError."""
    if situation is None:
        session.send(OperatorKind.CONFIRM_PATIENT)
        session.until(lambda s: s.patient_confirmed and bool(s.allowed), "readiness")
    elif situation is POWER_ON:
        session.settle()
        session.send(OperatorKind.ACT, Action.INITIALISE)
        reach(session, lambda s: s.action is Action.INITIALISE and s.progress > MIDDLE, "the way to standing")
    else:
        stand(session)
        go(session, situation)


def taken_over(session: Terminals, name: str, situation: Situation | None) -> dict[str, object]:
    """One situation: what was found. Raises TimeoutError when no console is to be had."""
    for _ in range(TRIES):
        with suppress(InterlockError):
            bring(session, situation)
            break
    there = session.now
    gone_s = session.hang_up()
    took_s = session.take_over()
    after = session.until(lambda s: s.effect >= Effect.HOLD and s.action is None, "hold")
    refused = session.second_is_refused()
    row: dict[str, object] = {
        "situation": name,
        "left_in": there.state.value,
        "acting": there.action.value if there.action else "",
        "console_gone_s": round(gone_s, 2),
        "taken_over_s": round(took_s, 2),
        "held_in": after.state.value,
        "held_by": ", ".join(one.event.value for one in after.events if one.effect >= Effect.HOLD),
        "armed": after.armed,
        "second_refused": refused,
    }
    session.settle()
    if situation is None:
        return row | {"back": session.now.state is GaitState.UNPOWERED}
    stand(session)
    return row | {"back": session.now.state is GaitState.STANDING}


def good(row: dict[str, object]) -> bool:
    """Gone in time, held and disarmed by the takeover, the only console, and back."""
    in_time = isinstance(gone_s := row["console_gone_s"], float) and gone_s <= GONE_S
    return in_time and row["armed"] is False and row["second_refused"] is True and row["back"] is True


def main() -> None:
    """Go through the situations and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="situations whose name this expression fits, e.g. during")
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    every: dict[str, Situation | None] = {"unpowered": None, POWER_ON.name: POWER_ON}
    every |= {situation.name: situation for situation in SITUATIONS}
    chosen = {name: one for name, one in every.items() if re.search(asked.only, name)}
    rows: list[dict[str, object]] = []
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryDirectory(prefix="bench-") as sockets:
        home = Path(folder)
        configure(home)
        session = Terminals(home, dict(os.environ) | {"TMPDIR": sockets})
        try:
            session.until(lambda _: True, "control's first message")
            for name, situation in track(chosen.items(), description="terminals", disable=not os.isatty(1)):
                if situation is not None and not session.now.patient_confirmed:
                    bring(session, None)
                rows.append(taken_over(session, name, situation))
        except KeyboardInterrupt:
            pass
        finally:
            show(rows)
            session.close()
    if asked.json:
        asked.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    sys.exit(0 if rows and all(map(good, rows)) else 1)


def show(rows: list[dict[str, object]]) -> None:
    """A row a situation."""
    if not rows:
        return
    table = Table(*rows[0])
    for row in rows:
        table.add_row(*map(str, row.values()))
    Console(width=None if os.isatty(1) else 160).print(table)
    Console().print(f"{sum(map(good, rows))} of {len(rows)}")


if __name__ == "__main__":
    main()
