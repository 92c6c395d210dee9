"""A recorded session in simulated time: hand, decisions, commands and joints, its trail beside its recording."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from app.control.recording import TickRecorder
from app.control.telemetry import snapshot
from app.ipc.links import OrderedReceiver, address
from app.ipc.messages import TriggerReport
from app.ipc.recording import BATCH_TICKS, HandFrame, Recorded, TickBatch
from app.ipc.snapshot import ControlSnapshot
from app.ipc.streams import RECORDING
from app.perception.reporting import hand_frame
from app.recording.process import SessionRecording
from kgdfa.gesture import Gesture
from kgdfa.hand import Hand
from kgdfa.pipeline import Report
from tests.app.control.rig import Rig
from tests.app.recording.conftest import STATUS, Collector, WatchedRig, received, setup_in
from tests.support.live_session import NEAR_M, K, Live12, hand_at, written

SESSION = "s"


@dataclass
class RecordedLive(Live12):
    """Hands what control and perception record to the session's recording, in lockstep."""

    home: Path = Path()
    rig: Rig = field(default_factory=lambda: WatchedRig(watching=False))
    measured: list[tuple[int, list[float]]] = field(default_factory=list)  # time, angles
    recorded: list[ControlSnapshot] = field(default_factory=list)  # as the screen had them

    def __post_init__(self) -> None:
        super().__post_init__()
        setup = setup_in(self.home, SESSION)
        self._receiver: OrderedReceiver[TickBatch | HandFrame] = OrderedReceiver(
            address(setup.links, RECORDING.name), Recorded
        )
        self._recorder = TickRecorder(setup.links)
        self.recording = SessionRecording(setup, Collector())

    def frame(self, *hands: Hand) -> Report:
        report = super().frame(*hands)
        message: TriggerReport = self.reports[report.captured_ns][1]
        self.recording.take(hand_frame(message, report, 0))
        return report

    def ticks(self, count: int) -> None:
        assert isinstance(self.rig, WatchedRig)
        for _ in range(count):
            super().ticks(1)
            assert self.rig.state is not None
            assert self.rig.outputs is not None
            self._recorder.add(self.rig.given, self.rig.outputs.command)
            self.measured.append((self.rig.now_ns, self.rig.given.feedback.position_rad.tolist()))
            if self._recorder.full:
                self.recorded.append(snapshot(self.rig.state, self.rig.given, STATUS))
                self._recorder.send(self.rig.state.streams, self.recorded[-1])
                self.recording.take(received(self._receiver))
            self.recording.settle(self.rig.now_ns)

    def close(self) -> Path:
        """The trail, and the recording with its copy; the recording's path."""
        assert self.rig.state is not None
        assert isinstance(self.rig, WatchedRig)
        self._recorder.close(self.rig.state.streams, snapshot(self.rig.state, self.rig.given, STATUS))
        if len(self.measured) % BATCH_TICKS:
            self.recording.take(received(self._receiver))
        written(self.home, self.entries)
        self.recording.close()
        self._receiver.close()
        return self.recording.writer.path


def lived(home: Path) -> RecordedLive:
    """Stand, a step, a cancelled push, a refusal, and a STOP in the next step."""
    live = RecordedLive(home=home)
    live.rest()
    live.key(K.CONFIRM_PATIENT)
    live.key(K.ARM)
    for gesture in (Gesture.ZERO, Gesture.ONE):
        live.push(gesture)
        live.settle()
    live.sign(Gesture.FOUR)
    live.approach(Gesture.FOUR)
    for _ in range(3):
        live.frame(hand_at(Gesture.FOUR, NEAR_M, aside_px=500.0))  # cancelled: left sideways
    live.rest()
    live.push(Gesture.ROCK)  # refused: the legs stand
    live.rest()
    live.push(Gesture.FOUR)
    live.ticks(20)
    live.key(K.STOP)
    live.settle()
    return live


@dataclass(frozen=True)
class Lived:
    """The session, and the path of its recording."""

    live: RecordedLive
    path: Path
