"""The camera's pictures of a session: a file of their own, with the patient's consent, deleted when it is withdrawn.

The trail decides: pictures are taken only while its newest word on them is yes. A slow or full disk refuses pictures
before anything else of the recording.
"""

from __future__ import annotations

from hashlib import sha256
from pathlib import Path

from app.audit.sink import AuditSink
from app.ipc.recording import Picture
from app.recording import schemas
from app.recording.schemas import CompressedImage, time_of
from app.recording.writer import RETRY_NS, RecorderFault, RecordingWriter, file_record
from app.system.paths import pictures_path
from logs.disk import FLOOR_BYTES
from logs.reading.errors import cause_of
from logs.reason import Reason, reason
from logs.records import Body, Recording, RecordingDeleted, RecordingFile

MOST_PENDING = 4 << 20  # bytes that wait for the disk, of pictures; the rest of the recording has four times that
MOST_BEHIND = 1 << 20  # of the rest: then no picture is taken
PICTURE_FLOOR_BYTES = 2 * FLOOR_BYTES  # of the disk stay free
FRAME_ID = "camera"


class PicturesFile:
    """A session's pictures, from the consent to their hash in the trail, or to their deletion."""

    def __init__(
        self, folder: Path, session: str, clock_offset_ns: int, sink: AuditSink, key: bytes | None = None
    ) -> None:
        """key: the station's, by which the file is encrypted; None: it is not."""
        self.path = pictures_path(folder, session)
        self.writer: RecordingWriter | None = None
        self._offset_ns = clock_offset_ns
        self._sink = sink
        self._key = key
        self._consent = self._must_delete = False
        self._retry_ns = 0
        self._lost = 0  # on the way here
        self._incarnation = 0  # of perception, of the newest picture
        self._counted = 0  # of the lost ones by that perception, since its start
        self._refused = 0  # here: the file could not be made, or the disk is behind
        self._fault: Reason | None = None

    def follow(self, body: Body) -> None:
        """What the trail says."""
        if isinstance(body, Recording):
            self._consent = body.on and body.consent
            if not self._consent:  # a later consent does not keep what came before
                self._must_delete = self.writer is not None
                self._lost = self._refused = 0

    def take(self, picture: Picture, waiting_bytes: int) -> None:
        """One picture. waiting_bytes: of the rest of the recording, for the disk."""
        if not self._consent:
            return
        if picture.incarnation != self._incarnation:
            self._incarnation, self._counted = picture.incarnation, 0
        self._lost += picture.lost - self._counted
        self._counted = picture.lost
        writer = None if self._must_delete else self._opened()
        if writer is None or waiting_bytes > MOST_BEHIND:
            self._refused += 1
            return
        for topic, data, kind in (
            (schemas.IMAGE, picture.image_jpeg, "jpeg"),
            (schemas.DEPTH, picture.depth_png, "png"),
        ):
            if data:
                when = time_of(picture.captured_ns + self._offset_ns)
                message = CompressedImage(timestamp=when, frame_id=FRAME_ID, data=data, format=kind)
                writer.add(topic, picture.captured_ns, message)

    def settle(self, now_ns: int) -> None:
        """Bring to the disk what is due; delete what is to be deleted."""
        if self._must_delete and now_ns >= self._retry_ns:
            self._retry_ns = now_ns + RETRY_NS
            self._delete()
        elif self.writer is not None:
            self.writer.settle(now_ns)

    def close(self) -> None:
        """The index, and the file's hash in the trail; nothing where there is no file."""
        if self._must_delete:
            self._delete()
        if self.writer is not None:
            missed = self._lost + self._refused
            self.writer.lost[schemas.IMAGE] += missed
            if self.writer.written[schemas.DEPTH]:
                self.writer.lost[schemas.DEPTH] += missed
            whole = self.writer.finish()
            self._sink.emit(file_record(self.writer, whole=whole))
        elif self._refused:
            self._sink.emit(
                RecordingFile(
                    file=self.path.name,
                    sha256=sha256().hexdigest(),
                    size_bytes=0,
                    messages={},
                    lost={schemas.IMAGE: self._lost + self._refused},
                    whole=False,
                    fault=self._fault,
                )
            )

    def _opened(self) -> RecordingWriter | None:
        if self.writer is None:
            try:
                self.writer = RecordingWriter(
                    self.path,
                    schemas.PICTURE_TOPICS,
                    self._offset_ns,
                    floor_bytes=PICTURE_FLOOR_BYTES,
                    most_pending=MOST_PENDING,
                    key=self._key,
                )
            except OSError as error:
                self._fault = reason(RecorderFault.DISK, detail=cause_of(error))
        return self.writer

    def _delete(self) -> None:
        """Again at the next call where the disk refuses; at the session's end the trail then names the file."""
        writer = self.writer
        assert writer is not None
        try:
            self.path.unlink(missing_ok=True)
        except OSError as error:
            writer.fault = reason(RecorderFault.DISK, detail=cause_of(error))
            return
        self.writer, self._must_delete = None, False
        writer.abandon()
        messages = writer.written.total()
        self._sink.emit(RecordingDeleted(file=self.path.name, size_bytes=writer.size_bytes, messages=messages))
