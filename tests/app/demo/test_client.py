"""What the demo's client makes of the reports that it polls."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from app.demo.client import SessionClient
from app.ipc.messages import TriggerReport
from app.session.host import SessionHost
from app.session.latest import Latest
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
