"""Control's process is gone: what the STOP bar and the next step say of the legs, with and without the guardian."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import pytest

from app.console.guidance import next_step
from app.console.state import SessionState
from app.console.stop import StopSwitch
from app.console.widgets.bars import StopBar
from app.ipc.messages import GuardianHealth
from app.ipc.states import Effect, Event, GaitState
from app.session.guardian import GuardianNotice
from app.system.config import JointsConfig, JointsKind
from app.text.catalogue import tr
from logs.reason import reason
from testing.messages import event
from tests.app.console.conftest import Opener
from tests.app.console.test_sizes import READY

SECOND_NS = 1_000_000_000
ENDS = (event(Event.SHUTDOWN_DAMPING, Effect.DAMP),)
SILENT = (event(Event.JOINT_TIMEOUT, Effect.HOLD),)


def gone(
    *processes: str,
    kind: JointsKind = "can",
    enabled: bool = True,
    state: GaitState = GaitState.STANDING,
    ending: bool = False,
    silent: bool = False,
    off: bool = False,
    fault: bool = False,
    unanswered: tuple[str, ...] = (),
) -> SessionState:
    """A second after control's process and these were gone; the other fields are the last of control and guardian."""
    assert READY.snapshot is not None
    ended = {"control", *processes}
    now_ns = READY.snapshot.at_ns + SECOND_NS
    health = GuardianHealth(
        at_ns=READY.snapshot.at_ns if "guardian" in ended else now_ns,
        acted=True,
        off=off,
        fault=reason(GuardianNotice.BUS_NOT_OPENED) if fault else None,
        unanswered=unanswered,
    )
    config = msgspec.structs.replace(READY.setup.config, joints=JointsConfig(kind=kind))
    events = (*(ENDS if ending else ()), *(SILENT if silent else ()))
    return replace(
        READY,
        now_ns=now_ns,
        setup=msgspec.structs.replace(READY.setup, config=config),
        snapshot=msgspec.structs.replace(READY.snapshot, enabled=enabled, state=state, events=events),
        guardian=health,
        processes=tuple(msgspec.structs.replace(one, alive=one.name not in ended) for one in READY.processes),
    )


@pytest.mark.parametrize(
    ("state", "step", "bar"),
    [
        (gone(), "control_ended", "stop.ended"),
        (gone(off=True), "ended", "stop.ended"),
        (gone(fault=True), "nobody_stops", "stop.left_on"),
        (gone(unanswered=("left_knee",)), "drives_silent", "stop.left_on"),
        (gone("guardian"), "nobody_stops", "stop.left_on"),
        (gone("guardian", kind="simulated"), "ended", "stop.ended"),
        (gone("guardian", enabled=False), "ended", "stop.ended"),
        (gone("guardian", enabled=False, silent=True, state=GaitState.UNPOWERED), "nobody_stops", "stop.ended"),
        (gone("guardian", ending=True), "nobody_stops", "stop.left_on"),
        (gone("guardian", "audit", ending=True, enabled=False), "ended", "stop.ended"),
        (gone("guardian", "audit", ending=True, off=True), "ended", "stop.ended"),
        (gone("guardian", "audit", ending=True, unanswered=("left_knee",)), "drives_silent", "stop.left_on"),
    ],
    ids=[
        "the guardian damps",
        "the guardian has switched off",
        "the guardian can't reach the drives",
        "a drive does not answer the guardian",
        "the guardian is gone too",
        "both gone, no drives",
        "both gone, drives without power",
        "both gone, a drive without power that did not answer",
        "both gone while control ended the session",
        "control ended the session in order",
        "the guardian ended it",
        "a drive has not confirmed the end",
    ],
)
def test_stop_is_not_asked_for_and_what_is_known_of_the_legs_is_told(state: SessionState, step: str, bar: str) -> None:
    switch = StopSwitch()
    switch.connect(lambda: None)
    shown = StopBar(switch, {}, watching=False)
    shown.show(state)
    assert (next_step(state)[0], shown.text) == (step, tr(bar))
    assert not shown.has_class("-live")
    for key in ("guide.nobody_stops", "guide.drives_silent", "stop.left_on"):
        assert "emergency stop" in tr(key)


@pytest.mark.parametrize("effect", [Effect.NOTE, Effect.HOLD, Effect.DAMP])
def test_a_frozen_control_is_still_given_a_stop_and_no_other_key_is_named(effect: Effect) -> None:
    state = replace(gone(), processes=READY.processes)
    assert state.snapshot is not None
    held = replace(state, snapshot=msgspec.structs.replace(state.snapshot, effect=effect))
    switch = StopSwitch()
    switch.connect(lambda: None)
    shown = StopBar(switch, {"acknowledge": "k", "torque_off": "o"}, watching=False)
    shown.show(held)
    assert shown.text == tr("stop.ready", key=tr("key.space"))
    assert shown.has_class("-live")
    assert not shown.has_class("-held")


async def test_a_note_that_no_audit_process_takes_is_not_said_to_be_in_the_trail(console: Opener) -> None:
    async with console() as opened:
        await opened.press("e")
        await opened.shows("After the session")
        assert not opened.app.screen.query_one("#unwritten").display
        opened.host.silent = True
        await opened.shows(tr("after.no_trail"))


async def test_a_session_without_control_ends_without_a_question_about_legs_that_it_will_not_move(
    console: Opener,
) -> None:
    async with console() as opened:
        opened.host.state = GaitState.STANDING
        await opened.until(opened.app.powered)
        opened.host.control_ended = opened.host.silent = True
        await opened.until(lambda: not opened.app.powered())
        await opened.press("e")
        await opened.shows("After the session")
