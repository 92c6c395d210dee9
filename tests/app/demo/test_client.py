"""What the demo's client and runner make of the reports that they poll."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from app.demo.client import SessionClient
from app.demo.runner import ScenarioRunner
from app.demo.scenario import AttemptFault
from app.ipc.messages import TriggerReport
from app.session.host import SessionHost
from app.session.latest import Latest
from kgdfa.button_state import PressCancel, PressHint
from kgdfa.gesture import HandRefusal
from logs.reason import Reason, reason
from tests.app.recording.conftest import frame


class Reports(SessionHost):
    """A host without a session: each poll brings the next report."""

    def __init__(self, reports: list[TriggerReport]) -> None:
        self.reports = reports

    def heartbeat(self) -> None:
        pass

    def poll(self) -> Latest:
        return Latest(snapshot=None, report=self.reports.pop(0), preview=None, audit=None, processes=())


def test_the_frame_rate_counts_each_frame_once_from_the_first_one() -> None:
    began_ns = 9 * 3600 * 10**9  # of the host's clock
    captured_ns = [began_ns + number * 33_333_333 for number in range(900)]
    report = frame(1, 0).report
    reports = [replace(report, captured_ns=at_ns) for at_ns in (0, 0, *captured_ns) for _ in range(2)]
    host = Reports(reports)
    client = SessionClient(host, approach_m=0.0, watch=print)
    while host.reports:
        client._poll()
    assert client.perception_fps() == pytest.approx(30.0, abs=0.1)


PLAIN = replace(frame(1, 0).report, press_hint=None, hand_refusal=None, cancel_count=0, cancel_reason=None)
REFUSED, HINT = reason(HandRefusal.STILL, moved=0.0, limit=0.08, duration_s=2.0), reason(PressHint.PUSH_NEARER)
CANCELLED = reason(PressCancel.TOO_SHORT)


@pytest.mark.parametrize(("reports", "expected"), [
    ([PLAIN], reason(AttemptFault.NOT_NEAR_ENOUGH)),
    ([replace(PLAIN, hand_refusal=REFUSED), PLAIN], reason(AttemptFault.NOT_PRESSED, reason=REFUSED)),
    ([replace(PLAIN, press_hint=HINT), PLAIN], reason(AttemptFault.NOT_PRESSED, reason=HINT)),
    (
        [replace(PLAIN, hand_refusal=REFUSED), replace(PLAIN, press_hint=HINT)],
        reason(AttemptFault.NOT_PRESSED, reason=HINT),
    ),
    (
        [replace(PLAIN, cancel_count=1, cancel_reason=CANCELLED, press_hint=HINT)],
        reason(AttemptFault.NOT_PRESSED, reason=CANCELLED),
    ),
])  # fmt: skip
def test_a_push_without_a_press_names_what_perception_said_of_it(
    reports: list[TriggerReport], expected: Reason
) -> None:
    runner = ScenarioRunner(Reports([*reports]))
    for _ in reports:
        runner._poll()
    assert runner._why_no_action(pressed=False) == expected


def test_a_cancel_before_the_attempt_is_no_reason_for_it() -> None:
    runner = ScenarioRunner(Reports([replace(PLAIN, cancel_count=1, cancel_reason=CANCELLED)]))
    runner._cancels = 1
    runner._poll()
    assert runner._why_no_action(pressed=False) == reason(AttemptFault.NOT_NEAR_ENOUGH)
