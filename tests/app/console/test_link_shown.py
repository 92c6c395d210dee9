"""What the console shows of a second computer: STOP sent and acknowledged, the link's figures, why there is none."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from msgspec.structs import replace as with_fields

from app.console.state import SessionState, fold
from app.console.widgets.health import Health, health_lines, health_of
from app.console.widgets.status import EventsPanel, event_lines
from app.ipc.messages import LinkHealth, ProcessStatus
from app.ipc.states import Effect, Event
from app.ipc.streams import LinkDirectory
from app.link.wire import LinkFault
from app.session.latest import Latest
from app.system.config import Config, SessionSetup
from hal.joints.device import load_exoskeleton
from logs.reason import Reason, reason
from profiles.schema import DEMO_PATIENT
from testing.fake_host import FakeHost
from testing.messages import event
from tests.app.console.test_sizes import NOW_NS, with_snapshot

MS = 1_000_000
LINK = LinkHealth(
    at_ns=1_000 * MS,
    host="exo.local:7447",
    connected=True,
    round_trip_ms=7.25,
    jitter_ms=1.5,
    loss=0.012,
    offset_ns=3_600_000 * MS,
    uncertainty_ns=3 * MS,
)


def folded(**fields: object) -> SessionState:
    setup = SessionSetup(
        session="20261121T093000Z-1a2b",
        home=Path(),
        links=LinkDirectory(path=Path(), public=b"", secret=b""),
        config=Config(),
        profile=DEMO_PATIENT,
        operator="",
    )
    host = FakeHost(setup, clock=lambda: 1_000 * MS)
    host.start()
    latest = host.poll()
    state = SessionState(setup=setup, started_ns=0, now_ns=0)
    return fold(state, replace(latest, **fields), 1_000 * MS)  # type: ignore[arg-type]


def text_of(state: SessionState) -> str:
    lines = health_lines(state, load_exoskeleton().joints, 120)
    return "\n".join("".join(part for part, _ in line) for line in lines)


def test_figures_of_the_link_are_on_the_health_page() -> None:
    shown = text_of(folded(link=LINK))
    for figure in ("7.2 ms", "1.5 ms", "1.2 %", "+3600000.0 ms ± 3.0 ms"):
        assert figure in shown
    assert "exo.local" not in text_of(folded())


@pytest.mark.parametrize(
    ("count", "shown"),
    [
        (1, ("stepped 1 time\n", "planner: running, restarted 1 time\n", "1 record written, 3 waiting")),
        (2, ("stepped 2 times\n", "planner: running, restarted 2 times\n", "2 records written, 3 waiting")),
    ],
)
def test_what_happened_once_is_told_as_one(count: int, shown: tuple[str, ...]) -> None:
    state = folded(link=with_fields(LINK, steps=count))
    planner = ProcessStatus(name="planner", pid=9, alive=True, exit_code=None, restarts=count)
    assert state.audit is not None
    audit = with_fields(state.audit, written=count, waiting=3)
    text = text_of(replace(state, processes=(*state.processes, planner), audit=audit))
    assert [part for part in shown if part not in text] == []


def test_a_process_that_ended_on_the_other_computer_is_bad() -> None:
    ended = ProcessStatus(name="guardian", pid=1, alive=False, restarts=0, exit_code=1)
    assert health_of(folded(link=LINK)) is not Health.BAD
    assert health_of(folded(link=with_fields(LINK, processes=(ended,)))) is Health.BAD


def test_a_link_that_does_not_answer_says_so() -> None:
    assert "exo.local:7447 does not answer" in text_of(folded(link=with_fields(LINK, connected=False)))


@pytest.mark.parametrize(("age_ms", "current"), [(1_000, True), (1_001, False)])
def test_figures_of_a_link_whose_process_is_silent_are_not_shown_as_current(age_ms: int, current: bool) -> None:
    shown = text_of(folded(link=with_fields(LINK, at_ns=(1_000 - age_ms) * MS)))
    assert ("7.2 ms" in shown) is current
    assert ("exo.local:7447 does not answer" in shown) is not current


def test_why_there_is_no_link_takes_the_place_of_no_event() -> None:
    fault = reason(LinkFault.NOBODY_ANSWERS, host="exo.local:7447", limit_s=5.0)
    broken = folded(link=with_fields(LINK, fault=fault))
    (line,) = event_lines(broken)
    assert "No answer from exo.local:7447" in line[0][0]
    (line,) = event_lines(replace(broken, snapshot=None))
    assert "No answer from exo.local:7447" in line[0][0]
    stopped = with_snapshot(events=(event(Event.STOP, Effect.HOLD, NOW_NS),))
    assert event_lines(replace(stopped, link=broken.link)) == (line, *event_lines(stopped))


@pytest.mark.parametrize("fault", [reason(LinkFault.SESSION_RUNS, session="20261129T105245Z-8904"), None])
def test_why_a_session_does_not_begin_over_the_link_is_in_sight(fault: Reason | None) -> None:
    panel = EventsPanel()
    panel.show(replace(folded(link=with_fields(LINK, fault=fault)), snapshot=None))
    assert panel.has_class("-quiet") is (fault is None)


@pytest.mark.parametrize(("sent_ns", "waits_ms"), [(0, 0.0), (900 * MS, 100.0)])
def test_a_stop_waits_until_it_is_acknowledged(sent_ns: int, waits_ms: float) -> None:
    assert folded(stop_sent_ns=sent_ns).stop_waits_ms == waits_ms


def test_latest_has_no_link_on_one_computer() -> None:
    empty = Latest(snapshot=None, report=None, preview=None, audit=None, processes=())
    assert empty.link is None
    assert empty.stop_sent_ns == 0
