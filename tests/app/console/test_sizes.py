"""The contract of the session's screen at any size: nothing overflows, no figure is cut, STOP is in sight."""

from __future__ import annotations

import random
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.console.state import SessionState, fold
from app.console.widgets.bars import StopBar
from app.console.widgets.curves import Curves, draw_joints
from app.console.widgets.gait import gait_lines
from app.console.widgets.gesture import distance_lines
from app.console.widgets.health import health_lines
from app.console.widgets.hold import hold_lines
from app.console.widgets.panel import Lines, cells, wrapped
from app.console.widgets.push import Push
from app.console.widgets.status import dose_lines, status_line
from app.ipc.snapshot import ActionReport
from app.ipc.states import Action, Effect, Event, GaitState, Outcome, Source
from app.ipc.streams import LinkDirectory
from app.system.config import Config, SessionSetup
from app.text.catalogue import use_language
from hal.joints.device import load_exoskeleton
from kgdfa.gesture import Gesture
from profiles.schema import DEMO_PATIENT
from testing.fake_host import FakeHost
from testing.messages import event
from tests.app.console.conftest import Opener

NOW_NS = 1_000_000_000_000
KEYS = {"acknowledge": "k", "act": "t", "confirm": "c", "patients_vocabulary": "g", "torque_off": "o"}
DEVICES = load_exoskeleton().joints
NUMBER = re.compile(r"\d+(?:[.:]\d+)*")


def state_of(*, moving: bool = False, stopped: bool = False) -> SessionState:
    """What a console knows of a session, with large figures everywhere."""
    links = LinkDirectory(path=Path(), public=b"", secret=b"")
    setup = SessionSetup(
        session="S", home=Path(), links=links, config=Config(), profile=DEMO_PATIENT, operator="therapist-name"
    )
    host = FakeHost(setup, clock=lambda: NOW_NS, state=GaitState.STANDING, gesture=Gesture.SEVEN)
    host.armed = host.confirmed = host.started = True
    if stopped:
        host.effect, host.state = Effect.HOLD, GaitState.BETWEEN
        host.events = (
            event(Event.STOP, Effect.HOLD, NOW_NS - 1_000_000_000),
            event(Event.OVER_TEMPERATURE, Effect.HOLD, NOW_NS - 900_000_000, temperature_c=81.0),
        )
    state = SessionState(setup=setup, started_ns=NOW_NS - 754_000_000_000, now_ns=NOW_NS)
    state = fold(state, host.poll(), NOW_NS)
    assert state.snapshot is not None
    report = ActionReport(
        number=3,
        action=Action.STAIR_UP,
        source=Source.GESTURE,
        from_state=GaitState.STANDING,
        outcome=Outcome.STOPPED if stopped else Outcome.RUNNING,
        accepted_ns=NOW_NS - 3_456_000_000,
        first_motion_ns=NOW_NS - 3_210_000_000,
        ended_ns=NOW_NS - 850_000_000 if stopped else 0,
    )
    more: dict[str, object] = {"steps": 1234, "distance_walked_m": 123.4, "reports": (report,)}
    if stopped:
        more |= {"stop_received_ns": NOW_NS - 1_000_000_000, "stop_command_ns": NOW_NS - 996_000_000}
    if moving:
        more |= {"action": Action.STAIR_UP, "progress": 0.62, "allowed": (), "pending": Action.WALK_END}
    snapshot = msgspec.structs.replace(state.snapshot, **more)
    return replace(state, snapshot=snapshot)


READY, MOVING, STOPPED = state_of(), state_of(moving=True), state_of(stopped=True)


def curves_of(state: SessionState) -> Curves:
    """A step that is half done."""
    curves = Curves()
    assert state.snapshot is not None
    for share in range(60):
        curves.take(msgspec.structs.replace(state.snapshot, action=Action.STAIR_UP, progress=share / 100))
    return curves


CURVES = curves_of(MOVING)
Draw = Callable[[SessionState, int, int], Lines]


def joints_of(state: SessionState, width: int, height: int) -> Lines:
    """The joints' panel."""
    assert state.snapshot is not None
    return draw_joints(state.snapshot, CURVES, DEVICES, width, height)


PANELS: dict[str, Draw] = {
    "status": lambda state, width, _: status_line(state, width, "i"),
    "gait": gait_lines,
    "distance": lambda state, width, height: distance_lines(state, width, height, Push()),
    "joints": joints_of,
    "dose": lambda state, width, _: dose_lines(state, width),
    "hold": lambda state, width, height: hold_lines(state, KEYS, width, height, watching=False),
    "health": lambda state, width, _: health_lines(state, DEVICES, width),
}
STATES = {"ready": READY, "moving": MOVING, "stopped": STOPPED}
FREE = {"status", "health", "dose", "distance"}  # of one row, scrolled, or in a panel of their own height


@pytest.mark.parametrize("panel", PANELS)
@pytest.mark.parametrize("language", ["en", "zh"])
@settings(max_examples=30, deadline=None)
@given(width=st.integers(20, 300), height=st.integers(3, 100), name=st.sampled_from(sorted(STATES)))
def test_no_line_is_wider_than_its_panel_and_no_figure_is_cut(
    panel: str, language: str, width: int, height: int, name: str
) -> None:
    use_language(language)
    state = STATES[name]
    lines, whole = PANELS[panel](state, width, height), PANELS[panel](state, 400, 200)
    assert all(cells(text_of((line,))) <= width for line in lines), text_of(lines)
    assert set(NUMBER.findall(text_of(lines))) <= set(NUMBER.findall(text_of(whole)))
    assert panel in FREE or len(lines) <= height


@given(
    width=st.integers(4, 40),
    words=st.lists(st.sampled_from(["耗时", "0.15", "120", "毫秒。", " ", "\u3000", "cm"]), max_size=12),
)
def test_no_number_is_broken_and_nothing_is_lost(width: int, words: list[str]) -> None:
    text = "".join(words)
    lines = wrapped(text, width)
    assert all(cells(line) <= width for line in lines)
    assert "".join("".join(lines).split()) == "".join(text.split())
    whole = [number for number in NUMBER.findall(text) if len(number) <= width]
    assert len(whole) != len(NUMBER.findall(text)) or set(NUMBER.findall(" ".join(lines))) == set(whole)


def with_report(**changes: object) -> SessionState:
    """The session with these fields of perception's report."""
    assert READY.report is not None
    return replace(READY, report=msgspec.structs.replace(READY.report, **changes))


def with_snapshot(**changes: object) -> SessionState:
    """The session with these fields of control's snapshot."""
    assert READY.snapshot is not None
    return replace(READY, snapshot=msgspec.structs.replace(READY.snapshot, **changes))


def text_of(lines: Lines) -> str:
    """Without styles, as a terminal without colours shows it."""
    return "\n".join("".join(text for text, _ in line) for line in lines)


async def test_stop_is_in_sight_at_any_size(console: Opener) -> None:
    rng = random.Random(1)
    sizes = [(20, 5), (300, 100), (80, 24), *((rng.randint(20, 160), rng.randint(5, 60)) for _ in range(3))]
    async with console() as opened:
        app = opened.app
        for at, size in enumerate(sizes):
            if at == 3:
                await opened.press("space")
                await opened.until(lambda: (state := app.live_state()) and state.effect is Effect.HOLD)
            await opened.pilot.resize_terminal(*size)
            bar = app.screen.query_one(StopBar)
            await opened.until(lambda bar=bar, size=size: bar.region.bottom == size[1] - 1)  # type: ignore[misc]
            assert bar.region.width == size[0]
            assert "■" in opened.text()
            for widget in app.screen.query("#main > *"):
                if widget.display and widget.region.area:
                    assert app.screen.region.contains_region(widget.region), (size, widget)
                    assert widget.region.bottom <= bar.region.y, (size, widget)
