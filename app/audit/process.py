"""The audit process: receives every process's records, writes them, and reports how far it is.

It ends last: asked by SIGTERM when the others are gone, or by itself when the session's process has died and no record
has come for a while.
"""

from __future__ import annotations

import platform
import shutil
import signal
import sys
import threading
import time
from enum import Enum, auto
from hashlib import sha256
from importlib.metadata import version
from types import FrameType

import msgspec
from msgspec.structs import replace

from app.ipc.links import OrderedReceiver, Publisher, address
from app.ipc.messages import AuditHealth
from app.ipc.streams import AUDIT, AUDIT_HEALTH
from app.system.config import SessionSetup
from app.system.diagnostics_log import get_logger
from app.system.hand_model import MODEL_NAME
from app.system.paths import Home
from app.system.program import program_identity
from app.system.scheduling import set_scheduling
from logs.disk import Disk
from logs.journal import Moment
from logs.keys import ConsoleKey, load_or_make_key
from logs.mirror import CheckpointCopy
from logs.reading.regular import path_named
from logs.reason import Reason, reason
from logs.records import Body, Entry, EventRaised, Loss, PatientChosen, RecordsLost, SessionStart, SignIn
from logs.trail import DiskFault
from logs.writer import SessionWriter

LIBRARIES = ("mediapipe", "mujoco", "numpy", "opencv-python-headless", "python-can", "textual", "pyzmq")
BATCH = 4096  # messages between two checks of the disk and the clock
WAIT_S = 0.01
IDLE_S = 0.2  # asked to end: nothing has come for so long
ORPHAN_IDLE_S = 3.0  # console dead: control holds, damps, disables within this silence
GIVE_UP_S = 10.0  # trying to write the end on a disk that refuses
DISK_TIMEOUT_S = 2.0  # a disk that spins up, or a burst of other programs, is not a fault yet

_log = get_logger("audit")


def run_audit(setup: SessionSetup) -> None:
    """Write one session's trail from its first record to its signed end."""
    set_scheduling("audit")
    home = Home(setup.home)
    home.logs.mkdir(parents=True, exist_ok=True, mode=0o700)
    key = load_or_make_key(home.keys)
    writer = SessionWriter(home.logs, setup.session, key, Disk(), CheckpointCopy(setup.config.checkpoint_copy))
    receiver = OrderedReceiver(address(setup.links, AUDIT.name), Entry)
    loop = _AuditLoop(setup, writer, receiver)
    signal.signal(signal.SIGTERM, loop.on_term)
    with _HealthPublisher(setup, loop):
        loop.begin(key)
        loop.run()
        done = loop.end()
    receiver.close()
    writer.close()
    loop.remove_links()
    if not done:
        _log.error("trail not written", why=writer.fault)
        sys.exit(1)


class Notice(Enum):
    """What the audit process notes in the trail; the value is the event's name there."""

    EARLIER_TRAIL_NOT_CLOSED = "earlier-trail-not-closed"  # file, how
    KEY_WAS_EXPOSED = "key-was-exposed"
    CHECKPOINT_COPY_FAILED = "checkpoint-copy-failed"  # cause


class EndCause(Enum):
    """Why a session's trail ends."""

    BY_CONSOLE = auto()
    CONSOLE_GONE = auto()


class _AuditLoop:
    """Clocks, queue and ending, around the writer."""

    def __init__(self, setup: SessionSetup, writer: SessionWriter, receiver: OrderedReceiver[Entry]) -> None:
        self.writer = writer
        self.cycle_ns = time.monotonic_ns()  # when the last cycle began
        self.foreign_peers = 0
        self._setup = setup
        self._receiver = receiver
        self._rejected = 0
        self._operator = setup.operator
        self._ending = False
        self._received_ns = self.cycle_ns
        self._polled_ns = self.cycle_ns  # when records were last asked for
        self._wanted_ns = self.cycle_ns  # when the session was last seen to go on
        self._copy_fault: Reason | None = None

    def on_term(self, _number: int, _frame: FrameType | None) -> None:
        """Asked to end: finish what is queued first."""
        self._ending = True

    def begin(self, key: ConsoleKey) -> None:
        """The first records: what runs, for whom, and what earlier crashes left."""
        found = self.writer.begin(start_record(self._setup), self._now())
        patient = self._setup.profile
        self._record(
            PatientChosen(
                patient=patient.identifier,
                profile_sha256=sha256(msgspec.json.encode(patient)).hexdigest(),
                parameters=_parameters(self._setup),
            )
        )
        if self._setup.operator:
            self._record(SignIn(name=self._setup.operator, role=self._setup.role))
        for entry in found:
            self._notice(Notice.EARLIER_TRAIL_NOT_CLOSED, file=entry.file, how=entry.text)
        if key.was_exposed:
            self._notice(Notice.KEY_WAS_EXPOSED)

    def run(self) -> None:
        """Until it is time to end: receive, write, settle."""
        while not self._must_end():
            self.cycle_ns = time.monotonic_ns()
            if self.writer.is_full:
                time.sleep(WAIT_S)
            else:
                self._take_waiting()
            self.writer.settle_when_due(time.monotonic_ns())

    def end(self) -> bool:
        """The signed end; tries again for a while when the disk refuses."""
        cause = EndCause.BY_CONSOLE if self._ending else EndCause.CONSOLE_GONE
        if self.writer.is_full:
            self._record_untaken()
        self.writer.end(reason(cause), self._now())
        deadline = time.monotonic() + GIVE_UP_S
        while not self.writer.finish(self._now()):
            if time.monotonic() > deadline:
                return False
            self.cycle_ns = time.monotonic_ns()
            time.sleep(0.1)
        return True

    def remove_links(self) -> None:
        """The sockets' directory, which a console that has died could not remove."""
        if self._setup.orphaned:
            shutil.rmtree(self._setup.links, ignore_errors=True)

    def _record_untaken(self) -> None:
        count = 0
        while self._receiver.receive() is not None:
            count += 1
        if count:
            self._record(RecordsLost(count=count, reason=reason(Loss.QUEUE_FULL)))

    def _take_waiting(self) -> None:
        entry = self._receiver.receive(WAIT_S)
        taken = 0
        while entry is not None:
            self.writer.take(self._signed(entry))
            taken += 1
            entry = self._receiver.receive() if taken < BATCH else None
        self._polled_ns = time.monotonic_ns()
        if taken:
            self._received_ns = self._polled_ns
        self.foreign_peers += self._receiver.foreign_peers()
        self._record_rejected()
        self._record_copy_fault()

    def _signed(self, entry: Entry) -> Entry:
        """With who commands the legs now: control hears of a takeover, the others only know who began the session."""
        if entry.process == "control":
            self._operator = entry.operator
        if entry.operator != self._setup.operator or entry.process == "console":
            return entry
        return replace(entry, operator=self._operator)

    def _record_rejected(self) -> None:
        lost, self._rejected = self._receiver.rejected - self._rejected, self._receiver.rejected
        if lost:
            self._record(RecordsLost(count=lost, reason=reason(Loss.NOT_A_RECORD)))

    def _record_copy_fault(self) -> None:
        fault = self.writer.copy_fault
        if fault is not None and fault != self._copy_fault:
            self._notice(Notice.CHECKPOINT_COPY_FAILED, cause=fault)
        self._copy_fault = fault

    def _must_end(self) -> bool:
        now_ns = time.monotonic_ns()
        if not (self._ending or self._setup.orphaned):
            self._wanted_ns = now_ns
            return False
        if self.writer.is_full:
            return now_ns - self._wanted_ns > GIVE_UP_S * 1e9
        idle_s = (self._polled_ns - self._received_ns) / 1e9  # waiting for the disk is not idle: records queue up
        return idle_s > (IDLE_S if self._ending else ORPHAN_IDLE_S)

    def _notice(self, notice: Notice, **values: object) -> None:
        self._record(EventRaised(event=notice.value, effect="note", text=reason(notice, **values)))

    def _record(self, body: Body) -> None:
        now = self._now()
        self.writer.take(now.entry(body))

    def _now(self) -> Moment:
        return Moment(wall_ns=time.time_ns(), monotonic_ns=time.monotonic_ns(), operator=self._operator)


class _HealthPublisher:
    """Publishes the health from a thread of its own: a slow disk is reported, not taken for a dead process."""

    def __init__(self, setup: SessionSetup, loop: _AuditLoop) -> None:
        self._where = address(setup.links, AUDIT_HEALTH.name)
        self._loop = loop
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="audit-health", daemon=True)

    def __enter__(self) -> None:
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()

    def _run(self) -> None:
        publisher = Publisher(self._where)
        peers = 0
        while not self._ended.wait(1.0 / AUDIT_HEALTH.rate_hz):
            peers += publisher.foreign_peers()
            now = health(self._loop.writer, self._loop.cycle_ns, time.monotonic_ns())
            publisher.send(replace(now, foreign_peers=peers + self._loop.foreign_peers))
        publisher.close()


def health(writer: SessionWriter, cycle_ns: int, now_ns: int) -> AuditHealth:
    """How far the writer is; a fault when the disk refuses or has not answered for a while."""
    fault = writer.fault
    silent_s = (now_ns - cycle_ns) / 1e9
    if fault is None and silent_s > DISK_TIMEOUT_S:
        fault = reason(DiskFault.NOT_ANSWERING, silent_s=silent_s)
    return AuditHealth(at_ns=now_ns, written=writer.written, waiting=writer.waiting, newest=writer.newest, fault=fault)


def start_record(setup: SessionSetup) -> SessionStart:
    return SessionStart(
        versions=_versions(setup),
        configuration=msgspec.to_builtins(setup.config),
        simulated=setup.config.joints.kind == "simulated" and not setup.config.joints.host,
        role=setup.role,
        purpose=setup.purpose,
    )


def _versions(setup: SessionSetup) -> dict[str, str]:
    found = program_identity() | {name: version(name) for name in LIBRARIES}
    model = path_named(setup.config.model) if setup.config.model else Home(setup.home).models / MODEL_NAME
    if model.is_file():
        found["hand model, SHA-256"] = sha256(model.read_bytes()).hexdigest()
    return found | {"python": platform.python_version(), "system": platform.platform()}


def _parameters(setup: SessionSetup) -> dict[str, object]:
    """Everything that shapes the motion; never the free note, which may hold a name."""
    everything: dict[str, object] = msgspec.to_builtins(setup.profile)
    return {name: value for name, value in everything.items() if name not in ("note", "identifier")}
