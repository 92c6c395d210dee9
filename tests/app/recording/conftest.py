"""A session's recording made in lockstep: the step's own ticks, handed over as control hands them over."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from app.audit.sink import AuditSink
from app.control.inputs import Inputs
from app.control.recording import TickRecorder
from app.control.telemetry import LoopStatus, snapshot
from app.ipc.links import OrderedReceiver, address, new_link_directory
from app.ipc.messages import OperatorKind, TriggerReport
from app.ipc.recording import BATCH_TICKS, HandFrame, Recorded, TickBatch
from app.ipc.snapshot import Lateness, RealTime
from app.ipc.states import Action
from app.ipc.streams import RECORDING
from app.recording.process import SessionRecording
from app.system.config import Config, RecordingConfig, SessionSetup
from kgdfa.gesture import Gesture
from logs.records import Body
from profiles.schema import DEMO_PATIENT
from testing.trails import write_sample
from tests.app.control.rig import Rig


class WatchedRig(Rig):
    """Keeps what each tick was given."""

    given: Inputs

    def _inputs(self) -> Inputs:
        self.given = super()._inputs()
        return self.given


class Collector(AuditSink):
    """Keeps what would go into the trail."""

    def __init__(self) -> None:
        self.bodies: list[Body] = []

    def emit(self, body: Body) -> bool:
        self.bodies.append(body)
        return True


@dataclass
class Session:
    """What was sent, and the file that was made of it."""

    setup: SessionSetup
    path: Path
    sink: Collector = field(default_factory=Collector)
    ticks: list[tuple[int, list[float], list[float]]] = field(default_factory=list)  # time, measured, commanded
    commands: int = 0
    frames: list[HandFrame] = field(default_factory=list)
    trail_lines: int = 0


def setup_in(home: Path, session: str = "20261122T100000Z-0001") -> SessionSetup:
    (home / "links").mkdir(parents=True, exist_ok=True)
    return SessionSetup(
        session=session,
        home=home,
        links=new_link_directory(home / "links"),
        config=Config(recording=RecordingConfig(on=True)),
        profile=DEMO_PATIENT,
        operator="ann",
        host_pid=1,
    )


def record(home: Path, ticks: int = 513) -> Session:
    """So many ticks of a session that stands up, with a frame each 17 ticks, and a trail."""
    trail = write_sample(home, minutes=0.2)
    setup = setup_in(home, trail.stem)
    receiver: OrderedReceiver[TickBatch | HandFrame] = OrderedReceiver(address(setup.links, RECORDING.name), Recorded)
    recorder = TickRecorder(setup.links)
    made = Session(setup=setup, path=home / "logs" / f"{setup.session}.mcap")
    made.trail_lines = len(trail.read_bytes().splitlines())
    recording = SessionRecording(setup, made.sink)
    rig = WatchedRig()
    for number in range(ticks):
        if number in {20, 40}:
            rig.send(OperatorKind.CONFIRM_PATIENT if number == 20 else OperatorKind.ACT, Action.INITIALISE)
            made.commands += 1
        state = rig.tick()
        assert rig.outputs is not None
        shown = snapshot(state, rig.given, STATUS)
        recorder.add(rig.given, rig.outputs.command)
        recorder.add_contact(rig.now_ns, (1.0, 2.0))
        command = rig.outputs.command
        held_rad = np.where(command.stiffness_nm_rad > 0, command.position_rad, np.nan)
        made.ticks.append((rig.now_ns, rig.given.feedback.position_rad.tolist(), held_rad.tolist()))
        if number % BATCH_TICKS == BATCH_TICKS - 1:
            recorder.send(state.streams, shown)
            recording.take(received(receiver))
        if number % 17 == 0:
            made.frames.append(frame(len(made.frames) + 1, rig.now_ns))
            recording.take(made.frames[-1])
        recording.settle(rig.now_ns)
    recorder.close(state.streams, shown)
    recording.take(received(receiver))
    recording.close()
    receiver.close()
    return made


STATUS = LoopStatus(incarnation=1, sequence=1, lateness=Lateness(), real_time=RealTime())


def received(receiver: OrderedReceiver[TickBatch | HandFrame]) -> TickBatch | HandFrame:
    message = receiver.receive(5.0)
    assert message is not None
    return message


def frame(number: int, at_ns: int) -> HandFrame:
    report = TriggerReport(
        incarnation=1,
        sequence=number,
        captured_ns=at_ns,
        sent_ns=at_ns,
        hand=number % 2 == 0,
        gesture=Gesture.ONE,
        distance_m=0.25,
    )
    if number % 2:
        return HandFrame(report=report, lost=0)
    rng = np.random.default_rng(number)
    image_px, world_m = rng.random((21, 2)), rng.random((21, 3))
    return HandFrame(report=report, lost=0, image_px=image_px.tobytes(), world_m=world_m.tobytes())


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Session:
    """One recording that several tests read."""
    return record(tmp_path_factory.mktemp("recorded"))
