"""The control process: a thin shell that reads, steps, guards, writes and publishes, 500 times a second.

All decisions are in `step`; here are the clock, the sockets, the signals and the records that need no decision.
"""

from __future__ import annotations

import os
import signal
import time

from msgspec.structs import replace as with_fields

from app.audit.sink import AuditSink
from app.control.assembly import cleared_of, drives_of, settings_of
from app.control.inputs import DriveOrder, Inputs, Outputs
from app.control.links import ControlLinks
from app.control.snapshot import Shell, snapshot
from app.control.state import ControlState
from app.control.statistics import Histogram, JointSecond
from app.control.step import begin, step
from app.ipc import streams as processes
from app.ipc.messages import Heartbeat, RealTime
from app.motion.plan import Phase
from app.system.config import SessionSetup
from app.system.scheduling import PeriodicTimer, acquire_real_time, disable_gc, pin_to_control_core
from hal.joints.protocol import TICK_HZ, TICK_NS, DriveState
from logs import records

HEARTBEAT_TICKS = TICK_HZ // int(processes.HEARTBEAT.rate_hz)
SNAPSHOT_TICKS = TICK_HZ // int(processes.SNAPSHOT.rate_hz)
PARENT_TICKS = 25  # 50 ms
CLEARED_TICKS = 2 * TICK_HZ
LATENESS_TICKS = 60 * TICK_HZ


def run_control(setup: SessionSetup) -> None:
    """Run until the session ends: SHUT_DOWN, a signal, or the console's death."""
    control = Control(setup, acquire_real_time())
    for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT):
        signal.signal(number, lambda *_: control.end())
    try:
        control.run()
    finally:
        control.close()


class Control:
    """Owns the links, the drives and the memory of the step."""

    def __init__(self, setup: SessionSetup, real_time: RealTime) -> None:
        self._setup = setup
        self._cleared = cleared_of(setup)
        self._console_pid = setup.console_pid
        self._real_time = real_time
        self._settings = settings_of(setup)
        self._drives = drives_of(setup, self._settings)
        self._links = ControlLinks(setup.links)
        self._sink = AuditSink(setup.links, "control", setup.operator)
        self._histogram = Histogram()
        self._second = JointSecond()
        self._incarnation = time.monotonic_ns() // 1_000_000
        self._tick = 0
        self._must_end = False
        self._audit_full = False
        self._drive_state = DriveState.UNCONFIGURED
        self._memory: ControlState | None = None

    def end(self) -> None:
        """Bring the legs to rest and end, as if the console had asked for it."""
        self._must_end = True

    def run(self) -> None:
        """Tick until the step says that it is finished."""
        self._sink.emit(records.ProcessStart(pid=os.getpid()))
        self._real_time = with_fields(self._real_time, core=pin_to_control_core())
        self._sink.emit(_privilege(self._real_time))
        self._drives.open(time.monotonic_ns())
        disable_gc()
        pace = PeriodicTimer(period_ns=TICK_NS, next_ns=time.monotonic_ns() + TICK_NS)
        finished = False
        while not finished:
            now_ns, late_ns, missed = pace.wait()
            self._histogram.add(late_ns, missed)
            inputs = self._read(now_ns, late_ns, missed)
            self._memory, outputs = step(self._memory or begin(inputs), inputs, self._settings)
            self._drives.write(outputs.command, inputs.feedback, now_ns)
            self._publish(self._memory, inputs, outputs)
            if outputs.drives is DriveOrder.DISABLE:
                self._beat(False)  # slack already; their answers may take longer than the guardian's patience
            if self._drives.execute(outputs.drives, now_ns):
                pace.next_ns = time.monotonic_ns() + TICK_NS  # the drives' answers were waited for
            finished = outputs.finished
            self._tick += 1

    def close(self) -> None:
        """Leave nothing powered and nothing open behind, whatever has happened."""
        unconfirmed = self._drives.close(self._beat)
        if unconfirmed:
            self._sink.emit(records.Drives(state="unconfirmed", detail=unconfirmed))
        self._links.heartbeat(Heartbeat(at_ns=time.monotonic_ns(), enabled=False, last=True))
        self._sink.emit(self._lateness_record())
        self._sink.emit(records.ProcessEnd(pid=os.getpid(), reason="asked to end" if self._must_end else ""))
        self._links.close()
        self._sink.close()

    def _beat(self, powered: bool) -> None:
        self._links.heartbeat(Heartbeat(at_ns=time.monotonic_ns(), enabled=powered))

    def _read(self, now_ns: int, late_ns: int, missed: int) -> Inputs:
        feedback = self._drives.read(now_ns)
        task = self._memory.task if self._memory else None
        heard = self._links.receive(self._tick, planning=task is not None and bool(task.awaited))
        if self._tick % CLEARED_TICKS == 0 and not self._drives.powered:
            self._cleared = cleared_of(self._setup)  # somebody may have run it meanwhile; it reads files
        if self._tick % PARENT_TICKS == 0:
            self._must_end = self._must_end or os.getppid() != self._console_pid
        return Inputs(
            now_ns=now_ns,
            wall_ns=time.time_ns(),
            boot_ns=time.clock_gettime_ns(time.CLOCK_BOOTTIME),
            feedback=feedback,
            report=heard.report,
            commands=heard.commands,
            plans=heard.plans,
            audit=heard.audit,
            guardian=heard.guardian,
            late_ns=late_ns,
            missed_ticks=missed,
            written=self._drives.written,
            written_ns=self._drives.written_ns,
            guard_refusal=self._drives.refusal,
            audit_full=self._audit_full,
            rejected_messages=heard.rejected,
            drive_error=self._drives.error,
            must_end=self._must_end,
            cleared=self._cleared,
        )

    def _publish(self, memory: ControlState, inputs: Inputs, outputs: Outputs) -> None:
        self._links.ask(outputs.requests)
        for request in outputs.requests:
            if request.phase in {Phase.WHOLE, Phase.WALK_START}:
                self._drives.expect(request.action)
        if self._tick % HEARTBEAT_TICKS == 0:
            self._beat(self._drives.powered)
        if self._tick % SNAPSHOT_TICKS == 0:
            self._links.show(snapshot(memory, inputs, self._shell()))
        self._record(memory, inputs, outputs)

    def _record(self, memory: ControlState, inputs: Inputs, outputs: Outputs) -> None:
        bodies = list(outputs.audit)
        feedback = inputs.feedback
        if feedback.state is not self._drive_state:
            self._drive_state = feedback.state
            bodies.append(records.Drives(state=feedback.state.value, detail=feedback.detail))
        self._second.add(feedback, memory.motion.command.position_rad)
        if self._second.ticks == TICK_HZ:
            bodies.append(self._second.take(1.0, memory.gait.state.value))
        if self._tick % LATENESS_TICKS == LATENESS_TICKS - 1:
            bodies.append(self._lateness_record())
        taken = [self._sink.emit(body) for body in bodies]
        self._audit_full = not all(taken)

    def _shell(self) -> Shell:
        return Shell(
            incarnation=self._incarnation,
            sequence=self._tick,
            simulated=self._settings.simulated,
            lateness=self._histogram.summary(),
            real_time=self._real_time,
        )

    def _lateness_record(self) -> records.TickLateness:
        late = self._histogram.summary()
        return records.TickLateness(
            ticks=late.ticks,
            missed=late.missed,
            p50_ms=late.p50_ms,
            p99_ms=late.p99_ms,
            p999_ms=late.p999_ms,
            max_ms=late.max_ms,
        )


def _privilege(real_time: RealTime) -> records.RealTimePrivilege:
    return records.RealTimePrivilege(
        fifo=real_time.fifo,
        memory_locked=real_time.memory_locked,
        core=real_time.core,
        cores_awake=real_time.cores_awake,
    )
