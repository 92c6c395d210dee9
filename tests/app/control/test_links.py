"""Control's links: what the guardian reports is waited for when control comes back."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from app.control.executor import ENABLE_LIMIT_MS
from app.control.links import COMMANDS_A_TICK, ControlLinks
from app.ipc import streams
from app.ipc.links import Publisher, address, new_link_directory
from app.ipc.messages import GuardianHealth

SINCE_NS = 1_000


@pytest.fixture
def directory(tmp_path: Path) -> streams.LinkDirectory:
    return new_link_directory(tmp_path)


@pytest.fixture
def reports(directory: streams.LinkDirectory) -> Iterator[list[GuardianHealth]]:
    """What a guardian sends over and over, one after the other."""
    sent, over = [GuardianHealth(at_ns=SINCE_NS - 1)], threading.Event()

    def send() -> None:
        with closing(Publisher(address(directory, streams.GUARDIAN.name))) as guardian:
            while not over.wait(0.005):
                guardian.send(sent[0])

    sender = threading.Thread(target=send)
    sender.start()
    yield sent
    over.set()
    sender.join()


def test_an_older_report_is_not_what_is_waited_for(
    directory: streams.LinkDirectory, reports: list[GuardianHealth]
) -> None:
    with closing(ControlLinks(directory)) as links:
        assert links.await_guardian(SINCE_NS - 1, 10.0), "connected"
        assert not links.await_guardian(SINCE_NS, 0.05)


def test_the_report_that_was_waited_for_is_received_in_the_next_tick_that_reads_slow_streams(
    directory: streams.LinkDirectory, reports: list[GuardianHealth]
) -> None:
    acted = GuardianHealth(at_ns=SINCE_NS, acted=True)
    with closing(ControlLinks(directory)) as links:
        assert links.await_guardian(SINCE_NS - 1, 10.0), "connected"
        reports[0] = acted
        assert links.await_guardian(SINCE_NS, 10.0)
        assert links.receive(slow=False, planning=False).guardian is None
        assert links.receive(slow=True, planning=False).guardian == acted


def test_a_tick_takes_all_heartbeats_of_a_stall_that_control_may_survive() -> None:
    """With some of them left, the newest would look as if the console had been silent."""
    assert COMMANDS_A_TICK / streams.OPERATOR.rate_hz > ENABLE_LIMIT_MS / 1000
