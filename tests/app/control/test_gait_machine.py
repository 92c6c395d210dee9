"""The gait table, exhaustively: every state × action × what runs, against the paper's list written down again."""

from __future__ import annotations

from functools import partial
from itertools import product

import pytest

from app.control.gait import machine as gait_machine
from app.control.gait.machine import Change, Gait, Ignored, Latched, Refused, Started, changed
from app.ipc.states import ACTION_OF, Action, GaitState, RequestRefusal
from app.motion.plan import Phase
from app.text.catalogue import render
from kgdfa.gesture import Gesture
from logs.reason import reason

S, G = GaitState, Gesture
# The paper's twelve transitions (digest, gait state machine), and the way out of a stop.
PAPER = {
    (S.UNPOWERED, G.ZERO): S.STANDING,
    (S.SITTING, G.ROCK): S.STANDING,
    (S.STANDING, G.LOVE): S.SITTING,
    (S.STANDING, G.ONE): S.RIGHT_FORWARD,
    (S.RIGHT_FORWARD, G.TWO): S.LEFT_FORWARD,
    (S.LEFT_FORWARD, G.THREE): S.RIGHT_FORWARD,
    (S.RIGHT_FORWARD, G.FOUR): S.STANDING,
    (S.STANDING, G.FIVE): S.LEFT_FORWARD,
    (S.STANDING, G.SEVEN): S.STANDING,
    (S.STANDING, G.EIGHT): S.STANDING,
    (S.STANDING, G.NINE): S.STANDING,
    (S.BETWEEN, G.ZERO): S.STANDING,
}
THROUGH = {G.SEVEN: S.RIGHT_HIGH_STEP, G.EIGHT: S.RIGHT_LOW_STEP, G.NINE: S.RIGHT_OBSTACLE}
WALKING = (
    Gait(state=S.STANDING, running=Action.WALK, phase=Phase.WALK_START),
    Gait(state=S.LEFT_FORWARD, running=Action.WALK, phase=Phase.WALK_RIGHT),
    Gait(state=S.RIGHT_FORWARD, running=Action.WALK, phase=Phase.WALK_LEFT),
)
complete = partial(changed, change=Change.COMPLETED)
abandon = partial(changed, change=Change.ABANDONED)
interrupt = partial(changed, change=Change.INTERRUPTED)
power_off = partial(changed, change=Change.POWER_LOST)
close_walk = partial(changed, change=Change.WALK_CLOSED)


def running_gaits() -> list[Gait]:
    """Every gait in which something runs."""
    by_wish = [
        answer.gait
        for state, action in product(GaitState, Action)
        if isinstance(answer := gait_machine.ask(Gait(state=state), action), Started)
    ]
    closing = [close_walk(gait) for gait in WALKING]
    ends = [complete(gait) for gait in closing]
    return [*by_wish, *WALKING[1:], *closing, *ends]


@pytest.mark.parametrize(("state", "gesture"), list(product(GaitState, Gesture)))
def test_at_rest_exactly_the_papers_transitions_are_granted(state: GaitState, gesture: Gesture) -> None:
    answer = gait_machine.ask(Gait(state=state), ACTION_OF[gesture])
    if (state, gesture) not in PAPER:
        assert isinstance(answer, Refused)
        assert render(answer.reason)
        return
    assert isinstance(answer, Started)
    assert answer.gait.running is ACTION_OF[gesture]
    assert answer.gait.state is THROUGH.get(gesture, state)
    assert complete(answer.gait).state is PAPER[state, gesture]


@pytest.mark.parametrize("gait", running_gaits())
@pytest.mark.parametrize("action", Action)
def test_while_something_runs_only_the_end_of_a_walk_is_latched(gait: Gait, action: Action) -> None:
    answer = gait_machine.ask(gait, action)
    if action is Action.WALK_END and gait.walking and not gait.closing:
        assert isinstance(answer, Latched)
        assert answer.gait == close_walk(gait)
        assert answer.gait.closing
        assert (answer.gait.state, answer.gait.phase) == (gait.state, gait.phase)
    else:
        assert isinstance(answer, Ignored)
        assert gait.running is not None
        assert answer.reason == reason(RequestRefusal.ACTION_RUNNING, action=gait.running)


def test_a_walk_continues_left_and_right_until_it_is_asked_to_stop() -> None:
    gait, states = WALKING[0], []
    for _ in range(5):
        gait = complete(gait)
        states.append(gait.state)
        assert gait.walking
    assert states == [S.LEFT_FORWARD, S.RIGHT_FORWARD, S.LEFT_FORWARD, S.RIGHT_FORWARD, S.LEFT_FORWARD]


@pytest.mark.parametrize("gait", WALKING)
def test_the_latched_end_is_carried_out_after_the_running_step(gait: Gait) -> None:
    onward, close = gait_machine.following_phases(gait)
    assert complete(gait).phase is onward
    last = complete(close_walk(gait))
    assert (last.running, last.phase, last.closing) == (Action.WALK_END, close, False)
    assert complete(last) == Gait(state=S.STANDING)


@pytest.mark.parametrize("gait", WALKING)
def test_the_following_steps_belong_to_their_actions(gait: Gait) -> None:
    onward, close = gait_machine.following_phases(gait)
    assert gait_machine.action_of(onward) is Action.WALK
    assert gait_machine.action_of(close) is Action.WALK_END
    assert "CLOSE" in close.name
    # the leg that is behind swings, whether it passes or closes
    assert onward.name.rsplit("_", 1)[1] == close.name.rsplit("_", 1)[1]


def test_outside_of_a_walk_nothing_follows() -> None:
    assert gait_machine.following_phases(Gait(state=S.STANDING)) == ()
    assert gait_machine.following_phases(complete(close_walk(WALKING[0]))) == ()


@pytest.mark.parametrize("gait", [*running_gaits(), *(Gait(state=state) for state in GaitState)])
def test_a_stop_and_a_loss_of_power_are_possible_from_everywhere(gait: Gait) -> None:
    assert interrupt(gait) == Gait(state=S.BETWEEN)
    assert power_off(gait) == Gait(state=S.UNPOWERED)


@pytest.mark.parametrize("gait", running_gaits())
def test_what_was_given_up_before_it_moved_leaves_the_legs_where_it_began(gait: Gait) -> None:
    rests = abandon(gait)
    assert rests.running is None
    assert not rests.closing
    assert rests.state is (S.STANDING if gait.state in THROUGH.values() else gait.state)


@pytest.mark.parametrize("state", GaitState)
def test_at_rest_there_is_nothing_to_complete_close_or_give_up(state: GaitState) -> None:
    gait = Gait(state=state)
    with pytest.raises(ValueError, match="nothing runs"):
        complete(gait)
    assert abandon(gait) == gait
    assert close_walk(gait) == gait


@pytest.mark.parametrize("gait", [*running_gaits(), *(Gait(state=state) for state in GaitState)])
def test_allowed_is_what_would_be_granted(gait: Gait) -> None:
    granted = {action for action in Action if isinstance(gait_machine.ask(gait, action), Started | Latched)}
    assert set(gait_machine.allowed(gait)) == granted


@pytest.mark.parametrize("state", [S.UNPOWERED, S.BETWEEN])
@pytest.mark.parametrize("action", [action for action in Action if action is not Action.INITIALISE])
def test_the_reason_names_the_recovery(state: GaitState, action: Action) -> None:
    answer = gait_machine.ask(Gait(state=state), action)
    assert isinstance(answer, Refused)
    assert "Gesture 0" in render(answer.reason) or action is Action.WALK_END


def test_a_reason_names_where_the_action_starts_and_where_the_legs_are() -> None:
    answer = gait_machine.ask(Gait(state=S.SITTING), Action.STEP_LEFT)
    assert isinstance(answer, Refused)
    assert answer.reason == reason(
        RequestRefusal.WRONG_STATE, action=Action.STEP_LEFT, sources=[S.RIGHT_FORWARD], state=S.SITTING
    )


def test_the_library_adds_no_bypass_of_the_table() -> None:
    assert set(gait_machine._MACHINE.events) == {
        *(action.name for action in Action),
        "complete",
        "abandon",
        "interrupt",
        "power_off",
    }
    assert gait_machine._MACHINE.ignore_invalid_triggers is None


def test_an_answer_depends_on_nothing_but_the_question() -> None:
    first = gait_machine.ask(Gait(state=S.STANDING), Action.WALK)
    gait_machine.ask(Gait(state=S.SITTING), Action.STAND_UP)
    assert gait_machine.ask(Gait(state=S.STANDING), Action.WALK) == first


@pytest.mark.parametrize("action", [None, Action.SIT_DOWN])
def test_a_request_that_no_row_grants_is_no_change(action: Action | None) -> None:
    with pytest.raises(ValueError, match="no row grants"):
        changed(Gait(state=S.SITTING), Change.REQUESTED, action)
