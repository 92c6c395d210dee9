"""What perception hands to the recording: the report of each frame once, and one where the frames pause."""

from __future__ import annotations

from msgspec.structs import replace

from app.ipc.messages import TriggerReport
from app.ipc.streams import RECORDING, LinkDirectory
from app.perception.reporting import hand_frame
from app.recording.schemas import HAND_TOPICS
from app.recording.sink import RecordingSink
from kgdfa.button_state import STALE_NS
from kgdfa.pipeline import Report
from logs.records import RecordingSent


class ReportRecorder:
    """Numbers what it hands over by itself, without gaps: the recording counts by it what was lost."""

    def __init__(self, links: LinkDirectory) -> None:
        self._sink = RecordingSink(links, RECORDING)
        self._number = 0
        self._captured_ns = 0  # of the newest frame
        self._paused = False

    def take(self, message: TriggerReport, report: Report | None) -> None:
        """One sent report. Between two frames only the first without a hand is new; it has its own time, no capture."""
        if message.captured_ns != self._captured_ns:
            self._captured_ns, self._paused = message.captured_ns, report is None
        elif report is not None or self._paused:
            return
        else:
            self._paused = True
            # Not later than the button counts a pause: the next frame may be captured before this report is sent.
            stale_ns = self._captured_ns + STALE_NS if self._captured_ns else message.sent_ns
            message = replace(message, captured_ns=0, sent_ns=min(message.sent_ns, stale_ns))
        self._number += 1
        self._sink.send(hand_frame(replace(message, sequence=self._number), report, self._sink.lost))

    def close(self) -> RecordingSent:
        """Let what is queued leave; how much was made, lost included."""
        self._sink.close()
        return RecordingSent(messages=dict.fromkeys(HAND_TOPICS, self._number))
