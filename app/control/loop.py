"""The control process: at every tick it reads, steps, writes and publishes.

All decisions are in `step`; here are the clock, the sockets, the signals and the periodic records.
"""

from __future__ import annotations

import os
import signal
import time

from msgspec.structs import asdict, replace

from app.audit.sink import AuditSink
from app.control.assembly import clearance_of, drives_of, settings_of
from app.control.inputs import DriveOrder, Inputs, Outputs, Settings
from app.control.links import SLOW_STREAM_TICKS, ControlLinks
from app.control.recording import TickRecorder
from app.control.state import ControlState
from app.control.step import initial_state, step
from app.control.telemetry import Histogram, JointStatisticsCollector, LoopStatus, quad, snapshot
from app.ipc import streams
from app.ipc.messages import Heartbeat
from app.ipc.snapshot import ControlSnapshot, RealTime
from app.motion.plan import Phase
from app.system.config import SessionSetup
from app.system.legs_lock import share_legs
from app.system.scheduling import PeriodicTimer, acquire_real_time, disable_gc, pin_to_control_core
from app.system.vocabulary import by_key_only
from hal.inputs.reader import InputReader, make_input
from hal.joints.protocol import TICK_HZ, TICK_NS, DriveState, JointFeedback
from logs import records
from logs.reason import reason_of

HEARTBEAT_TICKS = TICK_HZ // int(streams.HEARTBEAT.rate_hz)
SNAPSHOT_TICKS = TICK_HZ // int(streams.SNAPSHOT.rate_hz)
PARENT_TICKS = 25  # 50 ms
CLEARED_TICKS = 2 * TICK_HZ
CONTACT_TICKS = TICK_HZ // 50
LATENESS_TICKS = 60 * TICK_HZ
GUARDIAN_WAIT_S = 0.1  # it answers a heartbeat after a silence in its next check, 4 ms later


def run_control(setup: SessionSetup) -> None:
    """Run until the session ends: asked to, orphaned, or left alone. Raises AppError without the lock."""
    legs = share_legs(setup)
    real_time = acquire_real_time()
    if not real_time.fifo:
        pin_to_control_core(setup.config.control_core)  # before the links' threads are there
    control = Control(setup, real_time)
    for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT):
        signal.signal(number, lambda *_: control.end())
    try:
        control.run()
    finally:
        control.close()
        legs.close()


class Control:
    """Owns the links, the drives and the state of `step`."""

    def __init__(self, setup: SessionSetup, real_time: RealTime) -> None:
        self._setup = setup
        self._clearance = clearance_of(setup)
        self._cleared = self._clearance()
        self._real_time = real_time
        self._settings = settings_of(setup)
        self._by_key_only = by_key_only(self._settings.vocabulary)
        self._drives = drives_of(setup, self._settings)
        self._links = ControlLinks(setup.links, linked=setup.linked)
        devices = setup.config.inputs
        self._stop_inputs = InputReader(devices, tuple(make_input(one, setup.links.path) for one in devices))
        self._sink = AuditSink(setup.links, "control", setup.operator)
        self._recorder = TickRecorder(setup.links) if setup.config.recording.on else None
        self._histogram = Histogram()
        self._joint_statistics = JointStatisticsCollector(TICK_HZ)
        self._incarnation = time.monotonic_ns() // 1_000_000
        self._tick = 0
        self._waited = False  # for the drives' answers, in the tick before
        self._must_end = False
        self._audit_full = False
        self._snapshot: ControlSnapshot | None = None
        self._drive_state = DriveState.UNCONFIGURED
        self._state: ControlState | None = None

    def end(self) -> None:
        """Bring the legs to rest and end, as after SHUT_DOWN."""
        self._must_end = True

    def run(self) -> None:
        """Tick until the step says that it is finished."""
        self._sink.emit(records.ProcessStart(pid=os.getpid()))
        self._real_time = replace(self._real_time, core=pin_to_control_core(self._setup.config.control_core))
        self._sink.emit(records.RealTimePrivilege(**asdict(self._real_time)))
        self._sink.emit(limits_record(self._settings))
        self._drives.open(time.monotonic_ns())
        self._stop_inputs.start()
        disable_gc()
        timer = PeriodicTimer(period_ns=TICK_NS, next_ns=time.monotonic_ns() + TICK_NS)
        finished = False
        while not finished:
            now_ns, late_ns, missed = self._next_tick(timer)
            self._histogram.add(late_ns, missed)
            inputs = self._read(now_ns, late_ns, missed)
            self._state, outputs = step(self._state or initial_state(inputs), inputs, self._settings)
            if time.monotonic_ns() - now_ns < streams.ABSENT_NS:
                self._drives.write(outputs.command, inputs.feedback, now_ns, outputs.unheld)
            else:  # frozen in this tick, with a command of before
                self._drives.withhold()
            self._publish(self._state, inputs, outputs)
            if self._recorder is not None:
                self._record_tick(self._recorder, self._state, inputs, outputs)
            if outputs.drives is not DriveOrder.NONE:  # unpowered, or damped already
                self._send_wait()
            self._waited = self._drives.execute(outputs.drives, now_ns)
            if self._waited:
                timer.next_ns = time.monotonic_ns() + TICK_NS
            finished = outputs.finished
            self._tick += 1

    def close(self) -> None:
        """Switch off and close everything, after any error too."""
        unconfirmed = self._drives.close(beat=lambda: self._send_heartbeat(True), awaiting=self._send_wait)
        if unconfirmed:
            self._sink.emit(records.Drives(state="unconfirmed", detail=unconfirmed))
        at_ns, left = time.monotonic_ns(), unconfirmed is not None
        self._links.send_heartbeat(Heartbeat(at_ns=at_ns, enabled=False, last=True, unconfirmed=left))
        if self._snapshot is not None:  # what consoles show from now on
            last = replace(self._snapshot, at_ns=at_ns, sequence=self._snapshot.sequence + 1, enabled=left)
            self._links.send_snapshot(last)
        self._sink.emit(lateness_record(self._histogram))
        if self._recorder is not None and self._state is not None and self._snapshot is not None:
            self._recorder.close(self._state.streams, self._snapshot)
            self._sink.emit(self._recorder.made)
        self._sink.emit(records.ProcessEnd(pid=os.getpid(), reason="asked to end" if self._must_end else ""))
        self._stop_inputs.close()
        self._links.close()
        self._sink.close()

    def _send_heartbeat(self, powered: bool) -> None:
        at_ns, unconfirmed = time.monotonic_ns(), self._drives.unconfirmed
        self._links.send_heartbeat(Heartbeat(at_ns=at_ns, enabled=powered, unconfirmed=unconfirmed))

    def _send_wait(self) -> None:
        """The drives' answers may take longer than the guardian's limit, and until then none has confirmed."""
        at_ns = time.monotonic_ns()
        self._links.send_heartbeat(Heartbeat(at_ns=at_ns, enabled=False, unconfirmed=True, awaits_drives=True))

    def _next_tick(self, timer: PeriodicTimer) -> tuple[int, int, int]:
        """As the timer's wait. After an absence in which the guardian may have acted, its report comes first."""
        now_ns, late_ns, missed = timer.wait()
        drives = self._drives
        if not (
            late_ns >= streams.ABSENT_NS
            and (drives.powered or drives.unconfirmed)
            and self._guarded_until(now_ns - late_ns)
        ):
            return now_ns, late_ns, missed
        self._send_heartbeat(drives.powered)
        self._links.await_guardian(now_ns, GUARDIAN_WAIT_S)
        answered_ns, _, more = timer.wait()
        return answered_ns, late_ns + answered_ns - now_ns, missed + 1 + more

    def _guarded_until(self, at_ns: int) -> bool:
        guardian = self._state.streams.guardian if self._state else None
        return guardian is not None and at_ns - guardian.at_ns <= streams.GUARDIAN.stale_ms * streams.NS_PER_MS

    def _read(self, now_ns: int, late_ns: int, missed: int) -> Inputs:
        feedback = self._drives.read(now_ns)
        running = self._state.running if self._state else None
        received = self._links.receive(
            # after a wait nothing is as old as it looks, and the guardian may have acted in missed ticks
            slow=self._waited or self._tick % SLOW_STREAM_TICKS == 0 or missed > 0 or self._awaits_guardian,
            planning=running is not None and bool(running.awaited_plans),
        )
        if self._tick % CLEARED_TICKS == 0 and not self._drives.powered:
            self._cleared = self._clearance()  # a pre-flight may have passed meanwhile; it reads files
        if self._tick % PARENT_TICKS == 0:
            self._must_end = self._must_end or self._setup.orphaned
        passed_ns = time.monotonic_ns() - now_ns  # of this tick; it may have been frozen in it, and the clocks go on
        return Inputs(
            now_ns=now_ns,
            wall_ns=time.time_ns() - passed_ns,
            boot_ns=time.clock_gettime_ns(time.CLOCK_BOOTTIME) - passed_ns,
            feedback=feedback,
            late_ns=late_ns,
            missed_ticks=missed,
            written=self._drives.written,
            written_ns=self._drives.written_ns,
            guard_refusal=self._drives.refusal,
            withheld=self._drives.withheld,
            audit_full=self._audit_full,
            drive_error=self._drives.error,
            stop_inputs=self._stop_inputs.newest,
            must_end=self._must_end,
            cleared=self._cleared,
            **asdict(received),
        )

    @property
    def _awaits_guardian(self) -> bool:
        """Whether what the guardian did in control's missed ticks is still unknown."""
        if self._state is None:
            return False
        guardian, resumed_ns = self._state.streams.guardian, self._state.streams.resumed_ns
        if time.monotonic_ns() - resumed_ns > streams.GUARDIAN.stale_ms * streams.NS_PER_MS:
            return False  # it does not report any more, as *guardian-timeout* says
        return guardian is None or guardian.at_ns < resumed_ns

    def _publish(self, state: ControlState, inputs: Inputs, outputs: Outputs) -> None:
        self._links.send_plan_requests(outputs.plan_requests)
        for plan_request in outputs.plan_requests:
            if plan_request.phase in {Phase.WHOLE, Phase.WALK_START}:
                self._drives.stage_scene(plan_request.action)
        if self._tick % HEARTBEAT_TICKS == 0:
            self._send_heartbeat(self._drives.powered)
        if self._tick % SNAPSHOT_TICKS == 0:
            self._snapshot = snapshot(state, inputs, self._status())
            self._links.send_snapshot(self._snapshot)
        self._record(state, inputs, outputs)

    def _record(self, state: ControlState, inputs: Inputs, outputs: Outputs) -> None:
        self._sink.operator = state.operator or self._setup.operator
        bodies = list(outputs.audit)
        feedback = inputs.feedback
        if feedback.state is not self._drive_state:
            self._drive_state = feedback.state
            bodies.append(drives_record(feedback))
        self._joint_statistics.add(feedback, state.motion.command)
        if self._joint_statistics.full:
            bodies.append(self._joint_statistics.take(1.0, state.gait.state.value))
        if self._tick % LATENESS_TICKS == LATENESS_TICKS - 1:
            bodies.append(lateness_record(self._histogram))
        taken = [self._sink.emit(body) for body in bodies]
        self._audit_full = not all(taken)

    def _record_tick(self, recorder: TickRecorder, state: ControlState, inputs: Inputs, outputs: Outputs) -> None:
        if self._tick % CONTACT_TICKS == 0:
            recorder.add_contact(inputs.now_ns, self._drives.contact_n())
        recorder.add(inputs, outputs.command)
        if recorder.full and self._snapshot is not None:
            recorder.send(state.streams, self._snapshot)

    def _status(self) -> LoopStatus:
        return LoopStatus(
            incarnation=self._incarnation,
            sequence=self._tick,
            by_key_only=self._by_key_only,
            lateness=self._histogram.summary(),
            real_time=self._real_time,
        )


def limits_record(settings: Settings) -> records.JointLimits:
    """What the joints are compared with, for the audit trail."""
    limits = settings.limits
    return records.JointLimits(
        low_rad=quad(limits.low_rad),
        high_rad=quad(limits.high_rad),
        speed_rad_s=quad(limits.speed_rad_s),
        torque_nm=quad(limits.torque_nm),
        warn_c=quad(settings.warn_c),
        limit_c=quad(settings.limit_c),
    )


def lateness_record(histogram: Histogram) -> records.TickLateness:
    """How late the ticks began so far, for the audit trail."""
    return records.TickLateness(**asdict(histogram.summary()))


def drives_record(feedback: JointFeedback) -> records.Drives:
    """The drives' state for the audit trail, with what is known of the newest fault."""
    detail = None if feedback.detail is None else reason_of(feedback.detail)
    return records.Drives(state=feedback.state.value, detail=detail)
