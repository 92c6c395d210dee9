"""Buttons that stop, in lockstep: pressed, unplugged, bouncing, in every state; the way back; trying each once."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from app.control.running_action import Stage
from app.ipc.messages import OperatorKind
from app.ipc.states import Action, Effect, Event, GaitState
from app.motion.follower import Mode
from hal.errors import HardwareError, StopInputFault
from hal.inputs.device import Contact, InputReading, InputReadings, InputRole
from logs import records
from logs.reason import reason_of
from tests.app.control.causes import Switch, lag, with_switch
from tests.app.control.moments import HOLD_TICKS, RESTS, A, K, S, moving, now, records_of, resting, standing
from tests.app.control.rig import TICK_NS, Rig
from tests.app.control.test_step_stop import MOVEMENTS

LIMIT_NS = 25_000_000
ENDED_NS = 205_000_000  # a reader that has read nothing for 200 ms, and a tick


def pressed(switch: Switch, tick: int) -> None:
    switch.contact = Contact.OPEN


def unplugged(switch: Switch, tick: int) -> None:
    switch.contact = Contact.SILENT


def bouncing(switch: Switch, tick: int) -> None:
    """Open and closed by turns for 20 ms, then open."""
    switch.contact = Contact.CLOSED if tick < 10 and tick % 4 >= 2 else Contact.OPEN


def reader_died(switch: Switch, tick: int) -> None:
    pass


CHANGES = (pressed, unplugged, bouncing, reader_died)


def hold_in_time(rig: Rig, change: Callable[[Switch, int], None], switch: Switch) -> None:
    """The change, until after the legs are held; without a reader they pause in the time of a hold, and are held."""
    begun_ns = rig.now_ns
    first = {Effect.HOLD: LIMIT_NS}
    if change is reader_died:
        assert rig.stop_inputs is not None
        begun_ns = rig.stop_inputs.newest.at_ns
        rig.reading = False
        first = {Effect.PAUSE: LIMIT_NS, Effect.HOLD: ENDED_NS}
    after_ns: dict[Effect, int] = {}
    for tick in range(120):
        change(switch, tick)
        effect = rig.tick().effect
        for wanted in first:
            if effect >= wanted:
                after_ns.setdefault(wanted, rig.now_ns - begun_ns)
    assert after_ns.keys() == first.keys()
    assert all(after_ns[wanted] <= limit_ns for wanted, limit_ns in first.items())


def with_pressed_once(rig: Rig, role: InputRole = InputRole.WEARER) -> Switch:
    """A button that has been tried, while nothing ran."""
    switch = with_switch(rig, role)
    rig.tick(5)
    switch.contact = Contact.OPEN
    rig.tick(10)
    switch.contact = Contact.CLOSED
    rig.tick(60)
    rig.send(K.ACKNOWLEDGE)
    rig.tick()
    assert rig.events() == set()
    return switch


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize(("phase", "state"), [(number % 3, state) for number, state in enumerate(RESTS)])
def test_at_rest_the_legs_are_held_in_time_and_keep_their_state(
    phase: int, state: GaitState, change: Callable[[Switch, int], None]
) -> None:
    rig = resting(state)
    switch = with_pressed_once(rig)
    rig.tick(phase)  # the reader reads between ticks
    hold_in_time(rig, change, switch)
    assert now(rig).effect is Effect.HOLD, "bouncing is no second STOP"
    assert now(rig).gait.state is state
    rig.send(K.ACT, Action.INITIALISE)
    rig.tick(2)
    assert now(rig).running is None


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize(("state", "action"), MOVEMENTS)
def test_every_movement_is_held_in_time_and_only_a_new_request_after_the_acknowledgement_moves(
    state: GaitState, action: Action, change: Callable[[Switch, int], None]
) -> None:
    rig = resting(state)
    switch = with_pressed_once(rig)
    rig.send(K.ACT, action)
    rig.run_until(lambda m: m.running is not None and m.running.stage is Stage.MOVING)
    rig.tick(40)
    hold_in_time(rig, change, switch)
    rig.tick(HOLD_TICKS)
    assert now(rig).motion.mode is Mode.HOLDING
    assert now(rig).gait.state is S.BETWEEN
    held = rig.command
    rig.send(K.ACKNOWLEDGE)
    rig.tick(3)
    assert now(rig).effect is Effect.HOLD, "not while it is pressed"
    switch.contact = Contact.CLOSED
    rig.reading = True
    rig.tick(60)
    assert now(rig).effect is Effect.HOLD, "letting it go does not suffice, nor does the earlier acknowledgement"
    assert rig.command is held
    rig.send(K.ACKNOWLEDGE)
    rig.tick(50)
    assert rig.events() == set()
    assert rig.command is held
    assert now(rig).running is None


@pytest.mark.parametrize("role", InputRole)
def test_each_role_has_its_event_which_names_the_input_and_the_trail_records_it(role: InputRole) -> None:
    events = {
        InputRole.EMERGENCY_STOP: Event.HARDWIRED_STOP,
        InputRole.WEARER: Event.WEARER_STOP,
        InputRole.THERAPIST: Event.THERAPIST_STOP,
    }
    rig = standing()
    switch = with_pressed_once(rig, role)
    rig.audit.clear()
    switch.contact = Contact.OPEN
    rig.tick(5)
    assert rig.events() == {events[role].value}
    (raised,) = [one for one in now(rig).events if one.in_force]
    assert raised.detail["input"] == "pendant"
    switch.contact = Contact.CLOSED
    rig.tick(40)
    found = [(one.name, one.role, one.contact) for one in records_of(rig, records.StopInput)]
    assert found == [("pendant", role.value, "open"), ("pendant", role.value, "closed")]


def test_an_acknowledgement_sent_while_the_button_was_down_does_not_count_once_it_is_up() -> None:
    rig = standing()
    switch = with_pressed_once(rig)
    switch.contact = Contact.OPEN
    rig.tick(10)
    switch.contact = Contact.CLOSED
    rig.run_until(lambda m: not any(one.present for one in m.events))
    up_ns = next(one.last_ns for one in now(rig).events)
    rig.tick(10)
    for age_ns in (rig.now_ns + TICK_NS - up_ns, 0):
        assert rig.events() == {Event.WEARER_STOP.value}
        rig.send(K.ACKNOWLEDGE, age_ms=age_ns / 1e6)
        rig.tick()
    assert rig.events() == set()


def test_the_trail_says_why_a_stop_input_tells_nothing() -> None:
    rig = standing()
    switch = with_pressed_once(rig)
    rig.audit.clear()
    fault = HardwareError(StopInputFault.UNPLUGGED, name="pendant")
    silent = InputReading("pendant", InputRole.WEARER, Contact.SILENT, rig.now_ns, fault)
    rig.spoil["stop_inputs"] = InputReadings(rig.now_ns, (silent,))
    rig.tick()
    switch.contact = Contact.CLOSED
    rig.tick(40)
    assert [one.reason for one in records_of(rig, records.StopInput)] == [reason_of(fault), None]


def test_a_press_that_is_over_before_a_late_tick_still_holds() -> None:
    rig = moving()
    switch = with_pressed_once(standing())  # its reader is what counts
    source = with_switch(rig)
    rig.tick(5)
    assert rig.stop_inputs is not None
    source.contact = Contact.OPEN
    rig.stop_inputs.poll(rig.now_ns + 1_000_000)
    source.contact = switch.contact
    rig.now_ns += 30_000_000
    rig.spoil.update(late_ns=30_000_000, missed_ticks=15)
    rig.stop_inputs.poll(rig.now_ns)
    rig.tick()
    assert Event.WEARER_STOP.value in rig.events()


def test_a_reader_that_a_busy_host_lets_wait_pauses_a_movement_which_goes_on_by_itself() -> None:
    rig = standing()
    with_pressed_once(rig)
    rig.send(K.ACT, A.STEP_RIGHT_FIRST)
    rig.run_until(lambda m: m.running is not None and m.running.stage is Stage.MOVING)
    rig.reading = False
    rig.tick(50)
    assert rig.events() == {Event.STOP_INPUTS_LATE.value}
    rig.reading = True
    rig.run_until(lambda m: m.running is None)
    assert now(rig).gait.state is S.RIGHT_FORWARD
    (paused,) = records_of(rig, records.Pause)
    assert paused.cause == "stop-inputs-late"
    assert paused.resumed


def test_a_tick_that_is_late_is_not_the_readers_silence() -> None:
    rig = standing()
    with_pressed_once(rig)
    rig.now_ns += 30_000_000
    rig.spoil.update(late_ns=30_000_000, missed_ticks=15, stop_inputs=rig.stop_inputs.newest)  # type: ignore[union-attr]
    rig.tick()
    assert rig.events() == {Event.TICK_LATE.value, Event.CONTROL_LATE.value}


@pytest.mark.parametrize("every_ms", [4, 18, 100, 190])
def test_a_reader_that_ended_is_noticed_while_control_misses_a_tick_now_and_then(every_ms: int) -> None:
    """Only the ticks that it misses are not the reader's silence."""
    rig = standing()
    switch = with_pressed_once(rig)
    rig.plan_s = 3.0
    rig.send(K.ACT, A.STEP_RIGHT_FIRST)
    rig.run_until(lambda m: m.running is not None and m.running.stage is Stage.MOVING)
    rig.reading, switch.contact = False, Contact.OPEN
    assert rig.stop_inputs is not None
    read_ns, missed_ns = rig.stop_inputs.newest.at_ns, 0
    after_ns: dict[Effect, int] = {}
    for tick in range(1, 200):
        if tick % (every_ms * 1_000_000 // TICK_NS) == 0:
            rig.now_ns += TICK_NS
            missed_ns += TICK_NS
            rig.spoil.update(late_ns=TICK_NS, missed_ticks=1)
        effect = rig.tick().effect
        for wanted in (Effect.PAUSE, Effect.HOLD):
            if effect >= wanted:
                after_ns.setdefault(wanted, rig.now_ns - read_ns - missed_ns)
    assert LIMIT_NS - 5_000_000 <= after_ns[Effect.PAUSE] <= LIMIT_NS
    assert ENDED_NS - 5_000_000 <= after_ns[Effect.HOLD] <= ENDED_NS


def test_nothing_moves_until_each_button_was_pressed_once_and_let_go() -> None:
    rig = resting(S.UNPOWERED)
    switch = with_switch(rig)
    rig.tick(5)
    rig.send(K.ACT, A.INITIALISE)
    rig.tick(2)
    assert now(rig).running is None
    assert now(rig).refusal is not None
    assert now(rig).refusal.code == "Event.STOP_INPUT_UNPRESSED"  # type: ignore[union-attr]
    switch.contact = Contact.SILENT  # unplugging it is no proof of its contact
    rig.tick(10)
    switch.contact = Contact.CLOSED
    rig.tick(60)
    assert Event.STOP_INPUT_UNPRESSED.value in rig.events()
    switch.contact = Contact.OPEN
    rig.tick(10)
    assert not now(rig).stop_inputs[0].pressed_once, "held down it is not tried"
    switch.contact = Contact.CLOSED
    rig.tick(60)
    rig.send(OperatorKind.ACKNOWLEDGE)
    rig.tick()
    assert rig.act(A.INITIALISE).gait.state is S.STANDING


def test_a_button_held_down_from_the_start_is_not_tried_by_letting_it_go() -> None:
    rig = resting(S.UNPOWERED)
    switch = with_switch(rig, contact=Contact.OPEN)
    rig.tick(10)
    switch.contact = Contact.CLOSED
    rig.tick(60)
    assert not now(rig).stop_inputs[0].pressed_once


def test_legs_that_sink_while_the_supply_is_cut_are_damped_before_it_comes_back() -> None:
    rig = standing()
    switch = with_pressed_once(rig, InputRole.EMERGENCY_STOP)
    switch.contact = Contact.OPEN
    rig.tick(10)
    assert now(rig).effect is Effect.HOLD, "a broken wire drops nobody"
    lag(0.15)(rig)
    rig.tick()
    assert now(rig).effect is Effect.DAMP
