"""The recording process: receives what control and perception hand over, follows the trail, writes the files.

It is beside the session: nothing waits for it, and nothing stops when it ends. The file's hash goes into the trail,
which ends after it.
"""

from __future__ import annotations

import os
import signal
import time
from functools import partial
from pathlib import Path
from typing import BinaryIO

from app.audit.sink import AuditSink
from app.ipc.links import OrderedReceiver, address
from app.ipc.recording import HandFrame, Picture, Recorded, TickBatch
from app.ipc.streams import PICTURES, RECORDING
from app.recording import schemas
from app.recording.encryption import load_or_make_secret
from app.recording.pictures import PicturesFile
from app.recording.sink import QUEUE
from app.recording.topics import TickMessages, log_of, of_hand
from app.recording.writer import RecordingWriter, file_record
from app.system.config import SessionSetup
from app.system.paths import Home, recording_path
from app.system.scheduling import set_scheduling
from logs.line import MAX_LINE
from logs.read import understand
from logs.reading.regular import open_regular
from logs.records import ProcessEnd, ProcessStart, Record

WAIT_S = 0.02
BATCH = 200  # messages between two looks at disk and trail
TRAIL_NS = 200_000_000
IDLE_S = 0.2  # asked to end: nothing has come for so long
ORPHAN_IDLE_S = 3.0


def run_recording(setup: SessionSetup) -> None:
    """Record until asked to end, or orphaned and idle."""
    set_scheduling("recording")
    sink = AuditSink(setup.links, "recording", setup.operator)
    sink.emit(ProcessStart(pid=os.getpid()))
    receiver: OrderedReceiver[TickBatch | HandFrame] = OrderedReceiver(
        address(setup.links, RECORDING.name), Recorded, queue=QUEUE
    )
    pictures: OrderedReceiver[Picture] = OrderedReceiver(address(setup.links, PICTURES.name), Picture, queue=BATCH)
    recorder = SessionRecording(setup, sink)
    ending = _Ending(setup)
    signal.signal(signal.SIGTERM, ending.ask)
    while not ending.is_due():
        if take_batch(receiver, recorder):
            ending.received_s = time.monotonic()
        while (picture := pictures.receive()) is not None:
            recorder.take_picture(picture)
        for link in (receiver, pictures):
            link.foreign_peers()
        recorder.settle(time.monotonic_ns())
    recorder.close()
    receiver.close()
    pictures.close()
    sink.emit(ProcessEnd(pid=os.getpid()))
    sink.close()


def take_batch(receiver: OrderedReceiver[TickBatch | HandFrame], recorder: SessionRecording) -> int:
    """Hand over what has come, at most BATCH messages; how many."""
    for taken in range(BATCH):
        message = receiver.receive(0.0 if taken else WAIT_S)
        if message is None:
            return taken
        recorder.take(message)
    return BATCH


class SessionRecording:
    """A session's file, from its first message to its hash in the trail."""

    def __init__(self, setup: SessionSetup, sink: AuditSink) -> None:
        """Raises OSError when the file or its key can't be made."""
        home = Home(setup.home)
        home.logs.mkdir(parents=True, exist_ok=True, mode=0o700)
        self._sink = sink
        self._offset_ns = time.time_ns() - time.monotonic_ns()
        key = load_or_make_secret(home.keys) if setup.config.recording.encrypt else None
        path = recording_path(home.logs, setup.session)
        self.writer = RecordingWriter(path, schemas.TOPICS, self._offset_ns, key=key)
        self.pictures = PicturesFile(home.logs, setup.session, self._offset_ns, sink, key)
        self._ticks = TickMessages(self._offset_ns)
        self._trail = TrailLines(home.logs / f"{setup.session}.jsonl")
        self._lost_frames = 0
        self._sequence = self._counted = 0  # of the newest frame, and the losses that its process had counted
        self._trail_ns = 0

    def take(self, message: TickBatch | HandFrame) -> None:
        """One message."""
        if isinstance(message, TickBatch):
            messages = self._ticks.of(message)
        else:
            self._count_lost(message)
            messages = of_hand(message)
        for topic, at_ns, what in messages:
            self.writer.add(topic, at_ns, what)

    def take_picture(self, picture: Picture) -> None:
        """One picture of the camera."""
        self.pictures.take(picture, self.writer.waiting_bytes)

    def settle(self, now_ns: int) -> None:
        """Follow the trail, and bring to the disk what is due."""
        if now_ns - self._trail_ns >= TRAIL_NS:
            self._trail_ns = now_ns
            self._follow_trail()
        self.writer.settle(now_ns)
        self.pictures.settle(now_ns)

    def close(self) -> None:
        """The index, and the file's hash in the trail."""
        self._follow_trail()
        self._trail.close()
        writer = self.writer
        writer.lost.update(self._ticks.lost)
        for topic in schemas.HAND_TOPICS:
            writer.lost[topic] += self._lost_frames
        whole = writer.finish()
        self._sink.emit(file_record(writer, whole=whole))
        self.pictures.close()

    def _count_lost(self, frame: HandFrame) -> None:
        """A perception that was restarted numbers its frames and counts its losses from 0 again."""
        restarted = frame.report.sequence <= self._sequence
        self._lost_frames += frame.lost - (0 if restarted else self._counted)
        self._sequence, self._counted = frame.report.sequence, frame.lost

    def _follow_trail(self) -> None:
        for number, line in self._trail.new():
            record = understand(line, number)
            if isinstance(record, Record):
                self.pictures.follow(record.body)
                self.writer.add(schemas.TRAIL, record.monotonic_ns, line.rstrip(b"\n"))
                self.writer.add(schemas.LOG, record.monotonic_ns, log_of(record, line, self._offset_ns))


class TrailLines:
    """The whole lines that have been added to a file since the last call."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file: BinaryIO | None = None
        self._number, self._rest = 0, b""

    def new(self) -> list[tuple[int, bytes]]:
        """Number and text of each; none while there is no file."""
        if self._file is None:
            try:
                self._file = open_regular(self._path)
            except OSError:
                return []
        found = []
        for part in iter(partial(self._file.readline, MAX_LINE), b""):
            self._rest += part
            if part.endswith(b"\n"):
                self._number += 1
                found.append((self._number, self._rest))
                self._rest = b""
        return found

    def close(self) -> None:
        """Release the file."""
        if self._file is not None:
            self._file.close()


class _Ending:
    """Whether to end: asked to, or orphaned, and nothing comes any more."""

    def __init__(self, setup: SessionSetup) -> None:
        self._setup = setup
        self._asked = False
        self.received_s = time.monotonic()

    def ask(self, _number: int, _frame: object) -> None:
        """The signal's handler."""
        self._asked = True

    def is_due(self) -> bool:
        idle_s = time.monotonic() - self.received_s
        return (self._asked and idle_s > IDLE_S) or (self._setup.orphaned and idle_s > ORPHAN_IDLE_S)
