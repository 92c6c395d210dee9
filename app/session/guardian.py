"""The guardian: when control has gone silent with the drives powered, it puts the joints to damping, then off.

It shares nothing with control but a heartbeat and has its own socket on the bus. Simulated joints live inside
control's process and are gone with it: there the guardian can only report.
"""

from __future__ import annotations

import os
import signal
import time
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path

from app.audit.sink import AuditSink
from app.ipc import streams as processes
from app.ipc.links import LatestReceiver, Publisher, address
from app.ipc.messages import GuardianHealth, Heartbeat
from app.system.config import SessionSetup
from app.system.scheduling import gc_freeze, set_scheduling
from hal.errors import HardwareError
from hal.joints.can.bus import with_bus
from hal.joints.can.safe_stop import SafeStop
from hal.joints.device import DEFAULT_DEVICE, load_exoskeleton
from logs.reason import plain
from logs.records import HeartbeatLost, Note, ProcessEnd, ProcessStart

LOOK_S = 0.004  # twice, after the stale limit of 35 ms: the joints are damped before 50 ms are over
NS_PER_MS = 1_000_000
DAMP_NS = 3_000 * NS_PER_MS  # the wearer sinks into the harness; then the torque goes off
ENDING_DAMP_NS = 500 * NS_PER_MS
LATE_LOOK_NS = 12 * NS_PER_MS
LOOKS = 2
OFF_NS = 300 * NS_PER_MS
RETRY_NS = 1_000 * NS_PER_MS
HEALTH_NS = int(1e9 / processes.GUARDIAN.rate_hz)


class Doing(Enum):
    """What the guardian does for the joints."""

    WATCH = "watch"
    DAMP = "damp"
    OFF = "off"


@dataclass(frozen=True, slots=True, kw_only=True)
class Watch:
    """All that it remembers."""

    heartbeat: Heartbeat | None = None
    doing: Doing = Doing.WATCH
    since_ns: int = 0
    looked_ns: int = 0
    missed: int = 0  # looks in a row that found the heartbeat stale


def look(watch: Watch, heartbeat: Heartbeat | None, now_ns: int, *, ending: bool = False) -> Watch:
    """The watch after one look. Once it has acted, it goes on until the drives are off, whatever control says.

    It watches again when a control that lives says, after that, that no drive carries power.

    It acts on the second look in a row that finds the heartbeat stale, and one that was itself late, and so knows
    nothing of the last moments, does not count.
    ending: the session is being closed, and the wearer is not left in damped joints for long.
    """
    punctual = now_ns - watch.looked_ns <= LATE_LOOK_NS
    newest = heartbeat or watch.heartbeat
    missed = watch.missed + 1 if punctual and _lost(newest, now_ns) else 0
    watch = replace(watch, heartbeat=newest, looked_ns=now_ns, missed=missed)
    damped_ns = ENDING_DAMP_NS if ending else DAMP_NS
    if watch.doing is Doing.DAMP and now_ns - watch.since_ns > damped_ns:
        return replace(watch, doing=Doing.OFF, since_ns=now_ns)
    if watch.doing is Doing.WATCH and missed >= LOOKS:
        return replace(watch, doing=Doing.DAMP, since_ns=now_ns)
    if watch.doing is Doing.OFF and now_ns - watch.since_ns > OFF_NS and _unpowered(heartbeat):
        return replace(watch, doing=Doing.WATCH)
    return watch


def _unpowered(heartbeat: Heartbeat | None) -> bool:
    """Whether control has just said so; the last word of one that ends does not count."""
    return heartbeat is not None and not heartbeat.enabled and not heartbeat.last


def _lost(heartbeat: Heartbeat | None, now_ns: int) -> bool:
    """Whether control has gone silent with the drives powered."""
    if heartbeat is None or not heartbeat.enabled or heartbeat.last:
        return False
    return now_ns - heartbeat.at_ns > processes.HEARTBEAT.stale_ms * NS_PER_MS


def run_guardian(setup: SessionSetup) -> None:
    """Look until the session ends and control is gone or in good order."""
    guardian = Guardian(setup)
    gc_freeze()
    signal.signal(signal.SIGTERM, lambda *_: guardian.end())
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        while not guardian.done(time.monotonic_ns()):
            guardian.look_once(time.monotonic_ns())
            time.sleep(LOOK_S)
    finally:
        guardian.close()


class Guardian:
    """The shell around `look`: its links and its way to the drives."""

    def __init__(self, setup: SessionSetup) -> None:
        set_scheduling("guardian")  # first: the threads of the links inherit it
        self._console_pid = setup.console_pid
        self._sink = AuditSink(setup.links, "guardian", setup.operator)
        self._heartbeats = LatestReceiver(address(setup.links, processes.HEARTBEAT.name), Heartbeat)
        self._health = Publisher(address(setup.links, processes.GUARDIAN.name))
        self._stop = _way_to_the_drives(setup)
        self._watch = Watch()
        self._fault = "" if self._stop is None else "not opened yet"
        self._ending = False
        self._told_ns = 0
        self._tried_ns = -RETRY_NS
        self._sink.emit(ProcessStart(pid=os.getpid()))

    def look_once(self, now_ns: int) -> None:
        """One look, and what follows from it."""
        self._open(now_ns)
        before = self._watch
        self._watch = look(before, self._heartbeats.receive(), now_ns, ending=self._ended())
        self._act()
        if before.doing is Doing.WATCH and self._watch.doing is Doing.DAMP:
            self._tell_loss(now_ns)
        if now_ns - self._told_ns >= HEALTH_NS:
            self._told_ns = now_ns
            self._health.send(self._told(now_ns))

    def end(self) -> None:
        """The session wants to end; it does when nothing needs the guardian any more."""
        self._ending = True

    def done(self, now_ns: int) -> bool:
        """Whether nothing is left to guard."""
        heartbeat, doing = self._watch.heartbeat, self._watch.doing
        if self._stop is not None and doing is Doing.DAMP:
            return False
        if self._stop is not None and doing is Doing.OFF:
            return self._ended() and now_ns - self._watch.since_ns > OFF_NS
        if heartbeat is not None and heartbeat.last:
            return True
        return self._ended() and (heartbeat is None or not heartbeat.enabled or doing is not Doing.WATCH)

    def close(self) -> None:
        """Say goodbye and release everything."""
        self._sink.emit(ProcessEnd(pid=os.getpid(), reason=self._watch.doing.value))
        if self._stop is not None:
            self._stop.close()
        self._heartbeats.close()
        self._health.close()
        self._sink.close()

    def _ended(self) -> bool:
        return self._ending or os.getppid() != self._console_pid

    def _act(self) -> None:
        """Every look anew: a drive that limps on silence needs its damping again and again."""
        if self._stop is None:
            return
        if self._watch.doing is Doing.DAMP:
            self._stop.damp()
        elif self._watch.doing is Doing.OFF:
            self._stop.exit()

    def _open(self, now_ns: int) -> None:
        """The way to the drives, tried again while it fails: the guardian may be up before the bus is."""
        if self._stop is None or not self._fault or now_ns - self._tried_ns < RETRY_NS:
            return
        self._tried_ns = now_ns
        try:
            self._stop.open()
        except HardwareError as error:
            self._fault = str(error)
        else:
            self._fault = ""

    def _told(self, now_ns: int) -> GuardianHealth:
        acted = self._watch.doing is not Doing.WATCH
        return GuardianHealth(at_ns=now_ns, acted=acted, fault=plain(self._fault))

    def _tell_loss(self, now_ns: int) -> None:
        heartbeat = self._watch.heartbeat
        assert heartbeat is not None
        age_ms = (now_ns - heartbeat.at_ns) / NS_PER_MS
        self._sink.emit(HeartbeatLost(stream=processes.HEARTBEAT.name, age_ms=age_ms))
        self._sink.emit(Note(text=_NO_WAY if self._stop is None else _ACTED))


_ACTED = "Control was silent with the drives powered: the guardian damps the joints, then switches them off."
_NO_WAY = "Control was silent with the joints powered; simulated joints live in control, nothing else can be reached."


def _way_to_the_drives(setup: SessionSetup) -> SafeStop | None:
    """The guardian's own bus, or None where the joints are simulated."""
    joints = setup.config.joints
    if joints.kind == "simulated":
        return None
    device = load_exoskeleton(Path(joints.device) if joints.device else DEFAULT_DEVICE)
    motors = Path(joints.motors) if joints.motors else None
    return SafeStop(with_bus(device, joints.interface, joints.channel), motors)
