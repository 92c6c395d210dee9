"""Whether a stop button is connected, and which are still to be pressed, stands where somebody looks."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import pytest

from app.console.guidance import ready, results
from app.console.screens.checks import check_lines
from app.console.state import SessionState
from app.console.widgets.status import status_line
from app.ipc.snapshot import StopInputSnapshot
from app.system.config import JointsConfig
from app.text.catalogue import tr, use_language
from hal.inputs.device import InputDevice, InputRole
from tests.app.console.test_sizes import KEYS, MOVING, READY, STOPPED, text_of

PENDANT = InputDevice(name="pendant", role=InputRole.WEARER, kind="simulated")
THERE = JointsConfig(host="exo.local:7447")


def with_pendant(state: SessionState, *, is_open: bool = False, pressed_once: bool = False) -> SessionState:
    """The state with a configured button, as control tells of it."""
    config = msgspec.structs.replace(state.setup.config, inputs=(PENDANT,))
    one = StopInputSnapshot(name="pendant", role=InputRole.WEARER, open=is_open, pressed_once=pressed_once)
    assert state.snapshot is not None
    return replace(
        state,
        setup=msgspec.structs.replace(state.setup, config=config),
        snapshot=msgspec.structs.replace(state.snapshot, stop_inputs=(one,)),
    )


@pytest.mark.parametrize("language", ["en", "zh"])
@pytest.mark.parametrize("width", [60, 80, 119, 120, 200])
@pytest.mark.parametrize("state", [READY, MOVING, STOPPED])
def test_the_status_line_always_says_that_no_stop_button_is_connected(
    state: SessionState, width: int, language: str
) -> None:
    use_language(language)
    wanted = tr("status.no_stop_input" if width >= 120 else "status.no_stop_input_short")
    assert wanted in text_of(status_line(state, width, "i"))
    assert wanted not in text_of(status_line(with_pendant(state), width, "i"))


@pytest.mark.parametrize("language", ["en", "zh"])
@pytest.mark.parametrize("width", [80, 120, 200])
@pytest.mark.parametrize("state", [READY, MOVING, STOPPED])
def test_the_status_line_says_once_what_joints_they_are(state: SessionState, width: int, language: str) -> None:
    use_language(language)
    text = text_of(status_line(state, width, "i"))
    wordings = (tr(f"{key}.simulated") for key in ("joints", "joints_short"))
    assert sum(f" {wording} " in text for wording in wordings) == 1, text


def test_the_checks_say_so_too_and_hold_nobody_up() -> None:
    use_language("en")
    assert "No stop button connected" in text_of(check_lines(READY, KEYS))
    assert "stop_inputs" not in results(READY)


@pytest.mark.parametrize(
    ("is_open", "pressed_once", "stands"),
    [(False, False, "to be pressed once"), (True, False, "open"), (True, True, "open"), (False, True, "works")],
)
def test_a_connected_button_is_to_be_pressed_once_before_arming(is_open: bool, pressed_once: bool, stands: str) -> None:
    use_language("en")
    state = with_pendant(READY, is_open=is_open, pressed_once=pressed_once)
    text = text_of(check_lines(state, KEYS))
    assert f"pendant (wearer): {stands}" in text
    assert "No stop button connected" not in text
    assert ready(with_pendant(READY, pressed_once=True)) is ready(READY)
    assert not ready(with_pendant(READY))


def elsewhere(state: SessionState) -> SessionState:
    """The state with the joints, and so the stop buttons, on another computer."""
    config = msgspec.structs.replace(state.setup.config, joints=THERE)
    return replace(state, setup=msgspec.structs.replace(state.setup, config=config))


def without_reported(state: SessionState) -> SessionState:
    """The state with control telling of no button, whatever this computer's configuration describes."""
    assert state.snapshot is not None
    return replace(state, snapshot=msgspec.structs.replace(state.snapshot, stop_inputs=()))


def only_reported(state: SessionState) -> SessionState:
    """The state with control telling of a button that this computer's configuration does not describe."""
    config = msgspec.structs.replace(state.setup.config, inputs=())
    return replace(state, setup=msgspec.structs.replace(state.setup, config=config))


@pytest.mark.parametrize(
    ("state", "connected"),
    [
        (only_reported(with_pendant(READY)), True),
        (without_reported(with_pendant(READY)), False),
        (replace(with_pendant(READY), snapshot=None), False),  # nothing is known of the other computer yet
    ],
    ids=["there alone", "here alone", "before control's first word"],
)
def test_of_two_computers_the_one_with_the_joints_has_the_stop_buttons(state: SessionState, connected: bool) -> None:
    use_language("en")
    state = elsewhere(state)
    assert ("no_stop_input" in results(state), "stop_inputs" in results(state)) == (not connected, connected)
    assert (tr("status.no_stop_input") in text_of(status_line(state, 200, "i"))) is not connected


def test_before_controls_first_word_this_computers_configuration_says_what_is_connected() -> None:
    use_language("en")
    state = replace(with_pendant(READY), snapshot=None)
    assert "stop_inputs" in results(state)
    assert tr("status.no_stop_input") not in text_of(status_line(state, 200, "i"))
