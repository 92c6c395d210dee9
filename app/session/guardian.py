"""The guardian: when control is silent with the drives powered, it puts the joints to damping, then off.

It shares nothing with control but a heartbeat and has its own socket on the bus. Simulated joints live inside
control's process and are gone with it: there the guardian can only report.
"""

from __future__ import annotations

import os
import signal
import time
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING

from app.audit.sink import AuditSink
from app.ipc import streams
from app.ipc.links import LatestReceiver, Publisher, address
from app.ipc.messages import GuardianHealth, Heartbeat
from app.ipc.streams import NS_PER_MS
from app.session.heartbeat_check import (
    DAMPING_NS,
    OFF_NS,
    GuardianAction,
    GuardianState,
    check_heartbeat,
    needs_guarding,
)
from app.system.config import SessionSetup, load_device
from app.system.diagnostics_log import get_logger
from app.system.legs_lock import share_legs
from app.system.scheduling import gc_freeze, place_guardian, set_scheduling
from hal.errors import HardwareError
from hal.joints.protocol import Joint
from logs.reason import reason, reason_of
from logs.records import HeartbeatLost, Note, ProcessEnd, ProcessStart

if TYPE_CHECKING:
    from hal.joints.can.safe_stop import SafeStop

_log = get_logger("guardian")

CHECK_S = 0.004  # twice, after the stale limit of 65 ms: the joints are damped before 80 ms are over
NAMING_NS = 1_200 * NS_PER_MS  # at most, of switching off: with wait and damping before, less than `END_PATIENCE_S`
# 25 checks read 6,400 frames a bus: more replies to control than a socket keeps waiting. 25 more ask every drive again.
# Of checks that come late, on a busy machine, as many are needed: what is still waiting is no answer.
BACKLOG_NS, BACKLOG_CHECKS = 100 * NS_PER_MS, 25
ANSWER_NS, ANSWER_CHECKS = 200 * NS_PER_MS, 50
RETRY_NS = 1_000 * NS_PER_MS


class GuardianNotice(Enum):
    """What the guardian reports."""

    DAMPS = "damps"
    CANNOT_REACH = "cannot reach"
    BUS_NOT_OPENED = "bus not opened"
    NOT_ANSWERED = "not answered"  # action, joints
    ENDED = "ended"


def run_guardian(setup: SessionSetup) -> None:
    """Check until the session ends and control is gone or ended in good order. Raises AppError without the lock."""
    legs = share_legs(setup)
    guardian = Guardian(setup)
    gc_freeze()
    signal.signal(signal.SIGTERM, lambda *_: guardian.end())
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        while not guardian.done(time.monotonic_ns()):
            guardian.check(time.monotonic_ns())
            time.sleep(CHECK_S)
    finally:
        guardian.close()
        legs.close()


class Guardian:
    """The process around `check_heartbeat`: its links and its own bus."""

    def __init__(self, setup: SessionSetup) -> None:
        real_time = set_scheduling("guardian")  # first: the threads of the links inherit both
        place_guardian(setup.config.control_core, real_time=real_time)
        self._setup = setup
        self._sink = AuditSink(setup.links, "guardian", setup.operator)
        self._heartbeats = LatestReceiver(address(setup.links, streams.HEARTBEAT.name), Heartbeat)
        self._health = Publisher(address(setup.links, streams.GUARDIAN.name))
        self._stop = _safe_stop_of(setup)
        self._state = GuardianState()
        self._fault = None if self._stop is None else reason(GuardianNotice.BUS_NOT_OPENED)
        self._silent = frozenset(Joint)  # whose drives have not answered the present action
        self._asked = 0  # checks in it
        self._unanswered = (GuardianAction.MONITOR, tuple[Joint, ...]())  # which action by whom, as it was recorded
        self._ending = False
        self._health_ns = 0
        self._foreign_peers = 0
        self._tried_ns = -RETRY_NS
        self._stale = False  # the drives have lost power since the bus was opened
        self._sink.emit(ProcessStart(pid=os.getpid()))

    def check(self, now_ns: int) -> None:
        """One check, and what follows from it."""
        self._open(now_ns)
        before, was_powered, unanswered = self._state.action, self._powered, self._unanswered
        heartbeat, last = self._heartbeats.receive(), self._state.heartbeat
        self._state = check_heartbeat(self._state, heartbeat, now_ns, ending=self._ended())
        self._stale = self._stale or (was_powered and not self._powered)
        if self._stale and self._state.action is GuardianAction.MONITOR:
            self._reopen(now_ns)
        self._act()
        self._listen(before, now_ns)
        if before is GuardianAction.MONITOR and self._state.missed and self._state.action in DAMPING_NS:
            self._record_loss(now_ns)
        # at once when it acts, and to a control that comes back: it must not grip what it was not holding any more
        absent_ns = heartbeat.at_ns - last.at_ns if heartbeat and last and needs_guarding(last) else 0
        news = absent_ns >= streams.ABSENT_NS or self._state.action is not before or self._unanswered != unanswered
        if news or now_ns - self._health_ns >= streams.GUARDIAN.period_ns:
            self._health_ns = now_ns
            acted = self._state.action is not GuardianAction.MONITOR
            self._foreign_peers += self._heartbeats.foreign_peers() + self._health.foreign_peers()
            self._health.send(
                GuardianHealth(
                    at_ns=now_ns,
                    acted=acted,
                    off=self._state.action is GuardianAction.SWITCH_OFF,
                    fault=self._fault,
                    unanswered=tuple(joint.name.lower() for joint in self._unanswered[1]),
                    foreign_peers=self._foreign_peers,
                )
            )

    def end(self) -> None:
        """The session wants to end; it does when nothing needs the guardian any more."""
        self._ending = True

    def done(self, now_ns: int) -> bool:
        """Whether nothing is left to guard, and who does not answer has been named, where its checks allow it."""
        heartbeat, action = self._state.heartbeat, self._state.action
        if self._stop is not None and action in DAMPING_NS:
            return False
        if self._stop is not None and action is GuardianAction.SWITCH_OFF:
            least_ns = OFF_NS if self._unanswered[0] is action else NAMING_NS
            return self._ended() and now_ns - self._state.since_ns > least_ns
        if heartbeat is not None and heartbeat.last:
            return True
        monitoring = action is GuardianAction.MONITOR
        return self._ended() and (not needs_guarding(heartbeat) or not monitoring)

    def close(self) -> None:
        """Record the end and release everything."""
        self._sink.emit(ProcessEnd(pid=os.getpid(), reason=reason(GuardianNotice.ENDED, action=self._state.action)))
        if self._stop is not None:
            self._stop.close()
        self._heartbeats.close()
        self._health.close()
        self._sink.close()

    def _ended(self) -> bool:
        return self._ending or self._setup.orphaned

    def _act(self) -> None:
        """At every check: a drive that goes limp without commands needs its damping again and again."""
        if self._stop is None:
            return
        if self._state.action is GuardianAction.DAMP:
            self._stop.damp()
        elif self._state.action is GuardianAction.DAMP_LEFT_ON:
            self._stop.damp_left_on()
        elif self._state.action is GuardianAction.SWITCH_OFF:
            self._stop.exit()

    def _listen(self, before: GuardianAction, now_ns: int) -> None:
        """Which drives answer what the guardian commands: a frame that was sent has not taken effect by that."""
        action, since_ns = self._state.action, now_ns - self._state.since_ns
        if self._stop is None or action is GuardianAction.MONITOR:
            self._unanswered = (action, ())
            return
        if action is not before:
            self._silent, self._asked = frozenset(Joint), 0
        self._asked += 1
        answered = self._stop.answered()
        if since_ns > BACKLOG_NS and self._asked >= BACKLOG_CHECKS:
            self._silent -= answered
        silent = tuple(sorted(self._silent))
        if since_ns > ANSWER_NS and self._asked >= ANSWER_CHECKS and (action, silent) != self._unanswered:
            self._unanswered = (action, silent)
            if silent:
                self._sink.emit(Note(text=reason(GuardianNotice.NOT_ANSWERED, action=action, joints=silent)))
                _log.error("drives silent", action=action.value, joints=[joint.name for joint in silent])

    @property
    def _powered(self) -> bool:
        """Whether control has reported power last."""
        return self._state.heartbeat is not None and self._state.heartbeat.enabled

    def _reopen(self, now_ns: int) -> None:
        """After torque off, as control does: an adapter may have been plugged in again, and be another one."""
        self._stale = False
        if self._stop is not None:
            self._stop.close()
            self._fault = reason(GuardianNotice.BUS_NOT_OPENED)
            self._tried_ns = now_ns - RETRY_NS
            self._open(now_ns)

    def _open(self, now_ns: int) -> None:
        """Open the bus, again while it fails: the guardian may be up before the bus is, and an adapter may go.

        While there is nothing to do, a look once a second finds out whether the bus is there.
        """
        if self._stop is None or now_ns - self._tried_ns < RETRY_NS:
            return
        self._tried_ns = now_ns
        if self._fault is None:
            self._stop.look()
        if self._fault is None and not self._stop.failed:
            return
        try:
            self._stop.open()
        except HardwareError as error:
            self._fault = reason_of(error)
            _log.warning("bus not opened", detail=str(error))
        else:
            self._fault = None

    def _record_loss(self, now_ns: int) -> None:
        heartbeat = self._state.heartbeat
        assert heartbeat is not None
        age_ms = (now_ns - heartbeat.at_ns) / NS_PER_MS
        self._sink.emit(HeartbeatLost(stream=streams.HEARTBEAT.name, age_ms=age_ms))
        notice = GuardianNotice.CANNOT_REACH if self._stop is None else GuardianNotice.DAMPS
        self._sink.emit(Note(text=reason(notice)))
        _log.error("control silent", age_ms=round(age_ms, 1), notice=notice.value)


def _safe_stop_of(setup: SessionSetup) -> SafeStop | None:
    """The guardian's own bus, or None where the joints are simulated."""
    joints = setup.config.joints
    if joints.kind == "simulated":
        return None
    from hal.joints.can.bus import with_bus
    from hal.joints.can.safe_stop import SafeStop

    device = load_device(joints)
    motors = Path(joints.motors) if joints.motors else None
    return SafeStop(with_bus(device, joints.interface, joints.channel), motors)
