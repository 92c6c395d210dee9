"""The recording has each frame's report once, at its capture, and a pause where the button counts one."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import pytest
from msgspec.structs import replace

from app.ipc.links import OrderedReceiver, address, new_link_directory
from app.ipc.messages import TriggerReport
from app.ipc.recording import HandFrame, Recorded, TickBatch
from app.ipc.streams import RECORDING
from app.perception.recording import ReportRecorder
from app.recording.schemas import BUTTON, HAND_TOPICS
from app.recording.topics import of_hand
from kgdfa.button_state import STALE_NS, ButtonState
from kgdfa.pipeline import Report
from testing.messages import without_hand

FRAME_NS = 33_000_000
BEGIN_NS = 10**12


def sent(captured_ns: int, sent_ns: int, *, pressed: bool) -> tuple[TriggerReport, Report | None]:
    """What perception sends, with a report while it is in force."""
    message = replace(without_hand(captured_ns, 7, 0.2), sent_ns=sent_ns, hand=pressed, pressed=pressed)
    report = Report(
        captured_ns=captured_ns,
        hand=None,
        verdict=None,
        gesture=None,
        recognised_ns=0,
        votes=0,
        distance=None,
        depth_distance=None,
        button=ButtonState(pressed=pressed),
    )
    return message, report if pressed else None


def recorded(tmp_path: Path, reports: list[tuple[TriggerReport, Report | None]]) -> list[tuple[int, int, bool]]:
    """Number, moment and whether it is pressed, of what was recorded."""
    links = new_link_directory(tmp_path)
    receiver: OrderedReceiver[TickBatch | HandFrame] = OrderedReceiver(address(links, RECORDING.name), Recorded)
    recorder = ReportRecorder(links)
    with closing(receiver):
        for message, report in reports:
            recorder.take(message, report)
        found = list[tuple[int, int, bool]]()
        made = recorder.close().messages
        while len(found) < made[BUTTON] and (one := receiver.receive(5.0)) is not None:
            assert isinstance(one, HandFrame)
            ((at_ns, button),) = [(at_ns, what) for topic, at_ns, what in of_hand(one) if topic == BUTTON]
            found.append((one.report.sequence, at_ns, button.pressed))  # type: ignore[attr-defined]
    assert made == dict.fromkeys(HAND_TOPICS, len(found))
    return found


def test_a_frame_keeps_its_report_while_the_camera_pauses(tmp_path: Path) -> None:
    frames = [BEGIN_NS + number * FRAME_NS for number in range(3)]
    last_ns, next_ns = frames[-1], frames[-1] + 10**9
    reports = [
        *(sent(at_ns, at_ns + 20_000_000, pressed=True) for at_ns in frames),
        *(sent(last_ns, last_ns + after_ms * 10**6, pressed=True) for after_ms in (120, 220)),
        *(sent(last_ns, last_ns + after_ms * 10**6, pressed=False) for after_ms in (320, 420, 520)),
        sent(next_ns, next_ns + 20_000_000, pressed=True),
        sent(next_ns, next_ns + 300_000_000, pressed=False),
    ]
    assert recorded(tmp_path, reports) == [
        *((number, at_ns, True) for number, at_ns in enumerate(frames, start=1)),
        (4, last_ns + STALE_NS, False),
        (5, next_ns, True),
        (6, next_ns + STALE_NS, False),
    ]


@pytest.mark.parametrize(("period_ms", "loading"), [(150, False), (500, False), (200, True)])
def test_a_slow_camera_has_each_frame_once(tmp_path: Path, period_ms: int, loading: bool) -> None:
    """Without a hand model there is no report, and no pause of one."""
    frames = [BEGIN_NS + number * period_ms * 10**6 for number in range(4)]
    reports = [
        sent(at_ns, at_ns + after_ms * 10**6, pressed=after_ms <= 250 and not loading)
        for at_ns in frames
        for after_ms in range(20, period_ms, 100)
    ]
    found = recorded(tmp_path, reports)
    assert [at_ns for _, at_ns, pressed in found if pressed or loading] == frames
    assert [number for number, _, _ in found] == list(range(1, len(found) + 1))


def test_a_pause_hides_no_frame_that_was_captured_before_it_was_sent(tmp_path: Path) -> None:
    frames = [BEGIN_NS + number * 270_000_000 for number in range(4)]
    reports = [
        report
        for at_ns in frames
        for report in (
            sent(at_ns, at_ns + 60_000_000, pressed=True),
            sent(at_ns, at_ns + 290_000_000, pressed=False),
        )
    ]
    found = recorded(tmp_path, reports)
    for at_ns in frames:
        newest = max((one for one in found if one[1] <= at_ns + 100_000_000), key=lambda one: one[1])
        assert newest[1:] == (at_ns, True)


def test_before_the_first_image_one_report_has_the_moment_at_which_it_was_sent(tmp_path: Path) -> None:
    reports = [sent(0, BEGIN_NS + number * 100_000_000, pressed=False) for number in range(5)]
    assert recorded(tmp_path, reports) == [(1, BEGIN_NS, False)]
