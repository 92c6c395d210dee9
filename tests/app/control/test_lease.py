"""Who commands: the console with the newest lease, and nobody moves anything by taking over."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from app.control.effects import END_HOLD_NS
from app.control.inputs import Settings
from app.control.operator_commands import admits
from app.ipc.messages import STOP_KINDS, OperatorCommand, OperatorKind
from app.ipc.states import ConsoleChange, Effect, Event, GaitState
from app.ipc.streams import DAMP_NS
from app.motion.follower import DAMPING_RAMP_S, Mode
from hal.joints.protocol import DriveState
from logs import records
from logs.reason import Reason, key_of
from tests.app.control.moments import RESTS, A, K, S, drives, moving, now, records_of, resting, standing
from tests.app.control.rig import TICK_NS, Rig

COMMANDS = st.builds(
    OperatorCommand,
    lease=st.integers(1, 4),
    sequence=st.integers(1, 5),
    kind=st.sampled_from(OperatorKind),
    sent_ns=st.integers(0, 10),
)


def take_over(rig: Rig, lease: int = 2, operator: str = "Ada") -> None:
    """Another console's first command; from now on the rig's commands are its own."""
    rig.lease, rig._sequence = lease, 0
    rig.send(K.TAKE_OVER)
    rig._commands[-1] = replace(rig._commands[-1], operator=operator)
    rig.tick()


def unattended_after(rig: Rig, limit_s: float) -> Settings:
    """The rig's settings with another time until a session without a console ends."""
    return dataclasses.replace(rig.settings, unattended_ns=int(limit_s * 1e9))


def notes(rig: Rig) -> list[str]:
    """Codes of control's notes."""
    found = [one.text for one in records_of(rig, records.Note)]
    return [text.code for text in found if isinstance(text, Reason)]


@given(commands=st.lists(COMMANDS, max_size=30))
def test_the_lease_only_grows_and_an_earlier_console_is_never_heard_again_but_for_stop(
    commands: list[OperatorCommand],
) -> None:
    lease, sequence = 1, 0
    for command in commands:
        heard = admits(lease, sequence, command)
        if heard and command.kind not in STOP_KINDS:
            assert command.lease >= lease
            assert command.lease == lease or command.kind is OperatorKind.TAKE_OVER
        if command.kind in STOP_KINDS and command.lease != lease:
            assert heard, "everybody may stop"
        if heard and command.lease >= lease and command.kind is OperatorKind.TAKE_OVER:
            lease, sequence = command.lease, command.sequence
        elif heard and command.lease == lease:
            assert command.sequence > sequence, "each once and in order"
            sequence = command.sequence


@pytest.mark.parametrize("state", RESTS)
def test_nothing_moves_by_a_takeover_at_rest(state: GaitState) -> None:
    rig = resting(state)
    before = rig.command.position_rad.copy()
    rig.send(K.ARM)
    rig.tick(2)
    take_over(rig)
    rig.tick(500)
    assert now(rig).effect is Effect.HOLD
    assert now(rig).armed_ns == 0
    assert now(rig).gait.state is state
    assert np.array_equal(rig.command.position_rad, before)
    rig.send(K.ACKNOWLEDGE)
    rig.tick(2)
    assert now(rig).effect < Effect.HOLD
    assert now(rig).operator == "Ada"


def test_a_takeover_holds_as_stop_does_and_shows_no_time_that_stop_took() -> None:
    rig = moving()
    rig.send(K.STOP)
    rig.tick(3)
    assert now(rig).stop_received_ns < now(rig).stop_command_ns
    for of in (rig, moving()):
        take_over(of)
        of.tick(3)
        assert Event.STOP.value in of.events()
        assert now(of).stop_received_ns == 0


def test_a_step_that_pauses_is_held_by_a_takeover_and_led_back_to_standing() -> None:
    rig = moving()
    rig.alive = False
    rig.run_until(lambda m: m.effect is Effect.PAUSE)
    rig.alive = True
    take_over(rig)
    rig.tick(500)
    assert now(rig).gait.state is S.BETWEEN
    assert now(rig).running is None
    assert key_of(ConsoleChange.TAKEN_OVER) in notes(rig)
    rig.send(K.ACKNOWLEDGE)
    rig.tick(2)
    assert rig.act(A.INITIALISE).gait.state is S.STANDING


def test_an_acknowledgement_received_in_the_tick_of_a_takeover_does_not_undo_it() -> None:
    rig = moving()
    rig.lease, rig._sequence = 2, 0
    rig.send(K.TAKE_OVER, age_ms=30)
    rig.send(K.ACKNOWLEDGE, age_ms=10)
    rig.tick()
    assert now(rig).lease == 2
    assert Event.STOP.value in rig.events()
    assert now(rig).gait.state is S.BETWEEN


def test_a_takeover_after_stop_is_no_second_stop() -> None:
    rig = standing()
    rig.send(K.STOP)
    rig.tick(2)
    take_over(rig)
    rig.tick(2)
    assert now(rig).effect is Effect.HOLD
    assert now(rig).stop_presses == 1


@pytest.mark.parametrize("spoken", [False, True])
def test_a_stop_pressed_while_the_link_was_lost_holds_after_its_takeover_and_a_second_one_damps(spoken: bool) -> None:
    rig = standing()
    rig.lease, rig._sequence = 2, 0
    rig.send(K.TAKE_OVER)
    if spoken:
        rig.send(K.VOICE_STOP, age_ms=1800)
    rig.send(K.STOP, age_ms=1500)
    rig.tick(2)
    assert (now(rig).effect, now(rig).stop_presses) == (Effect.HOLD, 1)
    rig.send(K.STOP, age_ms=1000)
    rig.tick(2)
    assert (now(rig).effect, now(rig).stop_presses) == (Effect.DAMP, 2)
    assert [stop.effect for stop in records_of(rig, records.Stop) if stop.by == "key"] == ["hold", "damp"]


def test_a_second_stop_that_a_takeover_overtook_damps() -> None:
    rig = standing()
    rig.send(K.STOP)
    rig.tick(1000)
    rig.lease, rig._sequence = 2, 0
    rig.send(K.TAKE_OVER)
    rig.send(K.STOP, age_ms=1500)
    rig.tick(2)
    assert now(rig).effect is Effect.DAMP


def test_the_earlier_console_moves_nothing_and_keeps_nothing_alive_but_its_stop_is_heard() -> None:
    rig = standing()
    take_over(rig)
    rig.send(K.ACKNOWLEDGE)
    rig.tick(2)
    rig.alive = False
    for _ in range(6):
        for kind in (K.HEARTBEAT, K.ACT, K.ARM, K.SHUT_DOWN):
            late = OperatorCommand(lease=1, sequence=10_000, kind=kind, sent_ns=rig.now_ns, action=A.WALK)
            rig._commands.append(late)
        rig.tick(25)
    assert "console-timeout" in rig.events()
    assert now(rig).running is None
    assert now(rig).armed_ns == 0
    assert now(rig).ending_ns == 0
    rig._commands.append(OperatorCommand(lease=1, sequence=1, kind=K.STOP, sent_ns=rig.now_ns))
    rig.tick()
    assert Event.STOP.value in rig.events()


@pytest.mark.parametrize("state", [S.STANDING, S.SITTING])
def test_a_session_without_a_console_is_held_then_damped_for_long_and_switched_off(state: GaitState) -> None:
    rig = resting(state)
    rig.settings = unattended_after(rig, 2.0)
    rig.alive = False
    began_ns = rig.now_ns
    rig.run_until(lambda m: m.unattended)
    assert 1.9e9 < rig.now_ns - began_ns < 2.1e9
    assert key_of(ConsoleChange.NOBODY_CAME) in notes(rig)
    assert now(rig).motion.mode is Mode.HOLDING
    ended_ns = rig.now_ns
    rig.run_until(lambda m: m.motion.fully_damped)
    rig.run_until(lambda _: rig.outputs is not None and rig.outputs.finished)
    assert rig.now_ns - ended_ns >= END_HOLD_NS + DAMP_NS - TICK_NS
    assert drives(rig) is DriveState.DISABLED
    assert notes(rig).count(key_of(ConsoleChange.NOBODY_CAME)) == 1


def test_a_session_that_its_console_ends_is_not_damped_for_long_though_the_console_goes_before_it() -> None:
    rig = standing()
    rig.settings = unattended_after(rig, 0.1)
    rig.send(K.SHUT_DOWN)
    rig.tick()
    ended_ns, rig.alive = rig.now_ns, False
    rig.run_until(lambda _: rig.outputs is not None and rig.outputs.finished)
    assert rig.now_ns - ended_ns == pytest.approx(END_HOLD_NS + DAMPING_RAMP_S * 1e9, abs=3 * TICK_NS)
    assert (now(rig).unattended, notes(rig)) == (False, [])


def test_a_console_that_control_could_not_hear_was_there() -> None:
    rig = standing()
    rig.settings = unattended_after(rig, 2.0)
    rig.now_ns += 3_000_000_000
    rig.spoil = {"late_ns": 3_000_000_000, "missed_ticks": 1500}
    rig.tick()
    assert not rig.events() & {Event.CLOCK_JUMP.value, Event.HOST_SUSPENDED.value}, "its clocks went on"
    rig.tick(200)
    assert now(rig).ending_ns == 0
    rig.alive = False
    rig.run_until(lambda m: m.unattended)


def test_a_control_that_is_late_again_and_again_still_notices_that_nobody_came() -> None:
    rig = standing()
    rig.settings = unattended_after(rig, 2.0)
    rig.alive = False
    for _ in range(30):
        rig.now_ns += 4_000_000
        rig.spoil = {"late_ns": 4_000_000, "missed_ticks": 2}
        rig.tick(40)
    assert now(rig).unattended


def test_a_console_in_time_keeps_the_session() -> None:
    rig = standing()
    rig.settings = unattended_after(rig, 2.0)
    rig.alive = False
    rig.tick(900)
    rig.alive = True
    take_over(rig)
    rig.tick(1500)
    assert now(rig).ending_ns == 0
