"""After a hold: what happened in order, what the legs do, the next key; and the dot that sums up the health."""

from __future__ import annotations

import re
from dataclasses import replace
from math import nan
from typing import Literal

import msgspec
import pytest

from app.console.guidance import Light, needs_torque_off, next_step, results
from app.console.screens.checks import check_lines
from app.console.state import SessionState
from app.console.widgets.bars import StopBar
from app.console.widgets.curves import Curves, draw_joints
from app.console.widgets.health import Health, health_dot, health_lines, health_of
from app.console.widgets.hold import held, hold_lines
from app.console.widgets.status import status_line
from app.console.widgets.wearer import FigurePanel
from app.control.gait.machine import Gait, allowed
from app.ipc.messages import ProcessStatus, TriggerReport
from app.ipc.snapshot import Lateness, RealTime
from app.ipc.states import GESTURE_OF, Action, Effect, Event, GaitState
from app.motion.wearer import load_wearer
from app.system.config import JointsConfig
from app.text.catalogue import tr, use_language
from hal.errors import CameraFault
from hal.joints.device import Joint
from hal.joints.protocol import DriveFault
from kgdfa.gesture import Gesture
from logs.reason import reason
from testing.messages import event
from tests.app.console.conftest import Opener
from tests.app.console.test_sizes import DEVICES, KEYS, MOVING, READY, STOPPED, text_of


def test_what_happened_stands_in_order_with_times_from_the_first_cause() -> None:
    text = text_of(hold_lines(STOPPED, KEYS, 76, 20, watching=False))
    times = [float(time) for time in re.findall(r"^ *([+-]?\d+\.\d+) s ", text, re.MULTILINE)]
    assert times == [-2.46, -2.21, 0.0, 0.0, 0.1, 0.15]
    order = [
        "gesture accepted: climb stair",
        "began to move",
        "STOP:",
        "4 ms after the key",
        "too hot",
        "stopped: climb",
    ]
    places = [text.index(words) for words in order]
    assert places == sorted(places)
    assert text.index(tr("hold.held")) > places[-1]


def test_what_is_still_there_comes_before_the_key_and_an_observer_gets_none() -> None:
    assert "remove it" in text_of(hold_lines(STOPPED, KEYS, 76, 20, watching=False))
    watched = text_of(hold_lines(STOPPED, KEYS, 76, 20, watching=True))
    assert tr("hold.watching") in watched
    assert " k " not in watched


def test_the_joint_and_what_is_wrong_with_it_are_named() -> None:
    assert STOPPED.snapshot is not None
    joints = list(STOPPED.snapshot.joints)
    joints[Joint.RIGHT_KNEE] = msgspec.structs.replace(
        joints[Joint.RIGHT_KNEE], faults=(reason(DriveFault.OVER_CURRENT),)
    )
    state = replace(STOPPED, snapshot=msgspec.structs.replace(STOPPED.snapshot, joints=tuple(joints)))
    text = text_of(hold_lines(state, KEYS, 76, 20, watching=False))
    assert re.search(rf"‼ {tr('joints.right_knee')}: .*over-current", text)


@pytest.mark.parametrize("language", ["en", "zh"])
def test_drives_that_are_all_silent_leave_room_for_the_event_itself(language: str) -> None:
    use_language(language)
    silent = event(Event.JOINT_TIMEOUT, Effect.HOLD, joint=Joint.LEFT_HIP, age_ms=137.0)
    state = changed(effect=Effect.HOLD, state=GaitState.UNPOWERED, enabled=False, joints=SILENT, events=(silent,))
    text = text_of(hold_lines(state, KEYS | {"stop": "SPACE"}, 76, 8, watching=False))  # the panel at 80 x 24
    assert " 0.00 s  " in text
    assert text.count("‼") == 1
    assert all(tr(f"joints.{joint.name.lower()}").rstrip() in text for joint in Joint)


@pytest.mark.parametrize("enabled", [True, False])
def test_torque_off_is_named_only_where_its_key_is_not_refused(enabled: bool) -> None:
    keys = KEYS | {"stop": "SPACE"}
    state = changed(effect=Effect.HOLD, state=GaitState.UNPOWERED, enabled=enabled, events=FAULTY)
    text = " ".join(text_of(hold_lines(state, keys, 76, 20, watching=False)).split())
    assert tr("guide.drive_held", **keys) in text
    assert tr("hold.torque_off_key", **keys) not in text


def test_in_little_room_the_legs_and_the_key_stay() -> None:
    text = text_of(hold_lines(STOPPED, KEYS, 60, 3, watching=False))
    assert tr("hold.held") in text
    assert "▶" in text


def test_only_a_hold_takes_the_middle() -> None:
    assert held(STOPPED)
    assert not held(READY)


async def test_it_leaves_with_the_acknowledgement(console: Opener) -> None:
    async with console() as opened:
        await opened.press("space")
        await opened.shows("What happened")
        await opened.shows("The legs are held stiffly")
        await opened.press("k", "y")
        await opened.until(lambda: "What happened" not in opened.text())


def changed(**more: object) -> SessionState:
    """A ready session whose control reports this."""
    assert READY.snapshot is not None
    return replace(READY, snapshot=msgspec.structs.replace(READY.snapshot, **more))


assert READY.snapshot is not None
assert READY.report is not None
FAULTY = (event(Event.DRIVE_FAULT, Effect.HOLD, detail=""),)
BLIND = reason(CameraFault.UNPLUGGED, camera="webcam")
SILENT = tuple(
    msgspec.structs.replace(joint, angle_rad=nan, target_rad=nan, torque_nm=nan, temperature_c=nan, age_ms=1e9)
    for joint in READY.snapshot.joints
)


@pytest.mark.parametrize(
    ("state", "health"),
    [
        (READY, Health.GOOD),
        (changed(lateness=Lateness(p99_ms=3.0)), Health.SLOW),
        (changed(report_age_ms=200.0), Health.SLOW),
        (changed(real_time=RealTime()), Health.SLOW),
        (replace(READY, now_ns=READY.now_ns + 10_000_000_000), Health.BAD),
        (replace(READY, processes=(msgspec.structs.replace(READY.processes[0], alive=False),)), Health.BAD),
        (replace(READY, snapshot=None), Health.SLOW),
        (replace(READY, report=None, started_ns=READY.now_ns - 9_000_000_000), Health.BAD),
        (replace(READY, report=None, started_ns=READY.now_ns - 7_000_000_000), Health.SLOW),
        (replace(READY, report=msgspec.structs.replace(READY.report, camera_fault=BLIND)), Health.BAD),
        (changed(joints=SILENT), Health.BAD),
    ],
)
def test_health_is_a_shape_and_a_word(state: SessionState, health: Health) -> None:
    assert health_of(state) is health
    assert health_dot(state)[0] == f" {health.value} {tr(health)} "


def test_drives_that_have_never_answered_have_no_figures_and_no_figure() -> None:
    state = changed(joints=SILENT)
    assert state.snapshot is not None
    text = text_of(draw_joints(state.snapshot, Curves(), DEVICES, 60, 4))
    assert text.count(tr("joints.silent")) == 4
    assert "nan" not in text
    assert "nan" not in text_of(health_lines(state, DEVICES, 100))
    panel = FigurePanel()
    panel.follow(state, state.snapshot, load_wearer(state.setup.profile, state.setup.config.joints))
    assert panel.text == tr("joints.waiting")


def test_a_new_run_begins_a_new_curve_however_early_the_last_one_stopped() -> None:
    assert READY.snapshot is not None
    curves, walking = Curves(), msgspec.structs.replace(READY.snapshot, action=Action.WALK, progress=0.1)
    curves.take(walking)
    curves.take(READY.snapshot)
    assert [progress for progress, *_ in curves.points] == [0.1]
    curves.take(msgspec.structs.replace(walking, joints=SILENT))
    curves.take(msgspec.structs.replace(walking, progress=0.0))
    assert [progress for progress, *_ in curves.points] == [0.0]


async def test_the_page_behind_the_dot(console: Opener) -> None:
    async with console() as opened:
        await opened.shows("● good i")
        await opened.press("i")
        await opened.shows("30 FPS")
        await opened.shows("control: running")
        await opened.press("i")
        await opened.until(lambda: "30 FPS" not in opened.text())


def holding(cause: Event, effect: Effect) -> SessionState:
    """Legs that this event holds."""
    return changed(effect=effect, events=(event(cause, effect),))


def test_the_key_that_ends_the_guardians_damping_is_told_while_it_is_in_force() -> None:
    text = text_of(hold_lines(holding(Event.GUARDIAN_ACTED, Effect.DAMP), KEYS, 76, 20, watching=False))
    assert tr("hold.damped_key", **KEYS) in text


@pytest.mark.parametrize("cause", [Event.GUARDIAN_ACTED, Event.STOP_AGAIN])
def test_joints_without_power_are_not_to_be_switched_off(cause: Event) -> None:
    state = changed(effect=Effect.DAMP, enabled=False, events=(event(cause, Effect.DAMP),))
    text = text_of(hold_lines(state, KEYS | {"torque_off": "SWITCH"}, 76, 20, watching=False))
    assert "SWITCH" not in text
    assert tr("hold.off") in text
    assert tr("hold.off_key", **KEYS) in text
    assert next_step(state)[0] == "off"


@pytest.mark.parametrize("state", [state for state in GaitState if state is not GaitState.UNPOWERED])
@pytest.mark.parametrize("language", ["en", "zh"])
def test_gesture_0_is_named_as_the_next_key_only_where_it_is_granted(state: GaitState, language: str) -> None:
    use_language(language)
    stopped = changed(effect=Effect.HOLD, state=state, events=(event(Event.STOP, Effect.HOLD),))
    granted = Action.INITIALISE in allowed(Gait(state=state))
    key = text_of(hold_lines(stopped, KEYS, 300, 20, watching=False)).partition("▶")[2]
    zero = tr(Action.INITIALISE), tr("bind.hand.zero").lower()
    assert KEYS["acknowledge"] in key
    assert any(text in key.lower() for text in zero) is granted
    assert any(text in tr(f"guide.{next_step(stopped)[0]}", **KEYS).lower() for text in zero) is granted


def test_legs_that_never_had_power_are_not_said_to_stand() -> None:
    events = (event(Event.STOP, Effect.HOLD),)
    state = changed(effect=Effect.HOLD, enabled=False, state=GaitState.UNPOWERED, events=events)
    text = text_of(hold_lines(state, KEYS, 76, 20, watching=False))
    assert tr("hold.off") in text
    assert tr("hold.held") not in text
    assert next_step(state)[0] == "off"


@pytest.mark.parametrize("language", ["en", "zh"])
@pytest.mark.parametrize("present", [True, False])
@pytest.mark.parametrize(("enabled", "ordered"), [(True, "damped"), (False, "off")])
def test_joints_that_do_not_answer_are_not_said_to_do_what_was_ordered(
    enabled: bool, ordered: str, present: bool, language: str
) -> None:
    use_language(language)
    silent = msgspec.structs.replace(event(Event.JOINT_TIMEOUT, Effect.HOLD), present=present)
    state = changed(effect=Effect.DAMP, enabled=enabled, state=GaitState.BETWEEN, events=(silent,))
    text = " ".join(text_of(hold_lines(state, KEYS, 200, 20, watching=False)).split())
    assert (tr(f"hold.{ordered}") in text) is not present
    assert (tr("hold.unconfirmed") in text) is present
    status = text_of(status_line(state, 120, "i"))
    assert (tr(f"legs.{ordered}").upper() in status) is not present
    assert (tr("legs.unconfirmed").upper() in status) is present
    assert next_step(state)[0] == ("unconfirmed" if present else ordered)


@pytest.mark.parametrize("answering", [0, 1])
def test_legs_are_not_said_to_be_held_where_no_drive_answers(answering: int) -> None:
    """Where one of four is silent the others hold the wearer."""
    assert READY.snapshot is not None
    joints = (*READY.snapshot.joints[:answering], *SILENT[answering:])
    silent = event(Event.JOINT_TIMEOUT, Effect.HOLD)
    state = changed(effect=Effect.HOLD, enabled=True, state=GaitState.BETWEEN, joints=joints, events=(silent,))
    text = " ".join(text_of(hold_lines(state, KEYS, 200, 20, watching=False)).split())
    assert (tr("hold.held") in text) is bool(answering)
    assert (tr("hold.unconfirmed") in text) is (not answering)
    assert next_step(state)[0] == ("held" if answering else "drive_held")


def test_joints_that_got_power_and_do_not_answer_are_damped_by_stop_twice() -> None:
    """Torque off is refused before that."""
    silent = event(Event.JOINT_TIMEOUT, Effect.HOLD)
    state = changed(effect=Effect.HOLD, enabled=True, state=GaitState.UNPOWERED, events=(silent,))
    assert next_step(state)[0] == "drive_held"


async def test_a_torque_off_without_an_answer_is_offered_again_and_not_said_to_be_done(console: Opener) -> None:
    async with console() as opened:
        silent = event(Event.JOINT_TIMEOUT, Effect.HOLD)
        opened.host.walked = {"effect": Effect.DAMP, "enabled": False, "events": (silent,)}
        await opened.shows("NO ANSWER FROM DRIVES ■  emergency stop")
        await opened.press("o")
        await opened.shows("Not all drives have confirmed")
        assert "bear no weight" not in opened.text()


async def test_the_screen_of_joints_without_power_says_that_they_are_off(console: Opener) -> None:
    async with console() as opened:
        opened.host.walked = {"effect": Effect.DAMP, "enabled": False}
        await opened.shows("JOINTS OFF")
        assert "DAMPED" not in opened.app.screen.query_one(StopBar).text
        await opened.press("o")
        await opened.shows("already")


@pytest.mark.parametrize(
    ("cause", "powered", "lasts"),
    [
        (Event.DRIVE_FAULT, True, True),
        (Event.JOINT_TIMEOUT, False, True),
        (Event.JOINT_TIMEOUT, True, False),
        (Event.BUS_FAULT, True, False),
        (Event.OVER_TEMPERATURE, True, False),
    ],
)
def test_a_fault_that_stays_until_the_joints_are_off_names_the_way_there(
    cause: Event, powered: bool, lasts: bool
) -> None:
    keys = KEYS | {"stop": "SPACE"}
    for effect, text in ((Effect.HOLD, "guide.drive_held"), (Effect.DAMP, "hold.torque_off_key")):
        raised = event(cause, Effect.HOLD, detail="", temperature_c=81.0)
        state = changed(effect=effect, enabled=powered, events=(raised,))
        shown = " ".join(text_of(hold_lines(state, keys, 76, 20, watching=False)).split())
        assert (tr(text, **keys) in shown) is lasts
        assert (tr("hold.wait", **keys) in shown) is not lasts
        damped = "unconfirmed" if cause is Event.JOINT_TIMEOUT else "damped"
        assert next_step(state)[0] == (damped if effect is Effect.DAMP else "drive_held" if lasts else "held_at_rest")


def test_joints_that_are_silent_with_their_bus_need_it_opened_anew() -> None:
    raised = [event(cause, Effect.HOLD, detail="") for cause in (Event.JOINT_TIMEOUT, Event.BUS_FAULT)]
    assert needs_torque_off(changed(effect=Effect.HOLD, enabled=True, events=tuple(raised)))
    passed = msgspec.structs.replace(raised[1], present=False)
    assert not needs_torque_off(changed(effect=Effect.HOLD, enabled=True, events=(raised[0], passed)))


@pytest.mark.parametrize("watching", [True, False])
def test_at_the_end_of_a_session_there_is_nothing_to_acknowledge(watching: bool) -> None:
    ending = holding(Event.SHUTDOWN_DAMPING, Effect.DAMP)
    text = text_of(hold_lines(ending, KEYS, 76, 20, watching=watching))
    assert f"▶ {tr('guide.ending')}" in text


def without(name: str, state: SessionState = READY) -> SessionState:
    """A session whose process of this name was killed."""
    ended = (msgspec.structs.replace(one, alive=False, exit_code=-9) for one in state.processes if one.name == name)
    return replace(state, processes=(*ended, *(one for one in state.processes if one.name != name)))


@pytest.mark.parametrize("cause", [Event.AUDIT_TIMEOUT, Event.GUARDIAN_TIMEOUT])
def test_a_frozen_process_without_which_nothing_begins_is_a_check_that_fails(cause: Event) -> None:
    state = changed(armed=False, events=(event(cause, Effect.REFUSE),))
    assert next_step(changed(armed=False, events=()))[0] == "arm"
    assert next_step(state)[0] == "checks"
    assert results(state)["processes"] is Light.RED
    assert health_of(state) is Health.BAD


def test_an_audit_process_that_says_nothing_more_is_no_trail_that_is_written() -> None:
    assert READY.audit is not None
    old = msgspec.structs.replace(READY.audit, at_ns=READY.now_ns - 500_000_000)
    assert results(READY)["audit"] is Light.GREEN
    assert results(replace(READY, audit=old))["audit"] is Light.RED


@pytest.mark.parametrize("name", ["audit", "guardian", "planner"])
def test_what_a_process_that_stays_down_leaves_to_do_is_told(name: str) -> None:
    assert next_step(without(name))[0] == "process_ended"
    assert next_step(without(name, MOVING))[0] == "moving"
    keys = KEYS | {"checks": "s", "end": "e"}
    held_without = without(name, holding(Event.PAUSE_TOO_LONG, Effect.HOLD))
    assert next_step(held_without)[0] == "process_ended"
    assert tr("guide.process_ended", **keys) in text_of(hold_lines(held_without, keys, 76, 20, watching=False))
    assert tr("health.ended", name=name, count=0) in text_of(check_lines(without(name), KEYS))


@pytest.mark.parametrize("name", ["recording", "bus-log"])
def test_the_next_step_stays_when_a_recorder_ends(name: str) -> None:
    recorded = replace(
        READY, processes=(*READY.processes, ProcessStatus(name=name, pid=9, alive=True, restarts=0, exit_code=None))
    )
    assert results(recorded)["recorders"] is Light.GREEN
    ended = without(name, recorded)
    assert next_step(ended) == next_step(READY)
    assert health_of(ended) is Health.SLOW
    assert next_step(replace(ended, snapshot=None))[0] == "starting"
    assert (results(ended)["recorders"], results(ended)["processes"]) == (Light.AMBER, Light.GREEN)
    assert tr("health.ended", name=name, count=0) in text_of(check_lines(ended, KEYS))
    assert "recorders" not in results(READY)


def test_perception_is_restarted_and_the_session_goes_on() -> None:
    assert next_step(without("perception")) == next_step(READY)


BLIND_REPORT = msgspec.structs.replace(READY.report, gesture=None, camera_fault=BLIND)
LATE_REPORT = msgspec.structs.replace(READY.report, gesture=None, sent_ns=READY.now_ns - 300_000_000)


@pytest.mark.parametrize("report", [BLIND_REPORT, LATE_REPORT, None])
@pytest.mark.parametrize("armed", [True, False])
def test_without_images_the_next_step_is_a_key_as_long_as_control_refuses_gestures(
    report: TriggerReport | None, armed: bool
) -> None:
    clear = replace(changed(armed=armed, events=()), report=report)
    assert next_step(clear)[0] == ("sign" if armed else "arm")
    assert results(clear)["camera"] is Light.RED
    for cause in (Event.CAMERA_STALE, Event.PERCEPTION_TIMEOUT, Event.PERCEPTION_STARTING, Event.LINK_POOR):
        raised = event(cause, Effect.REFUSE, detail="")
        for present in (True, False):  # a passing event stays a second: so does the line
            stays = msgspec.structs.replace(raised, present=present)
            assert next_step(replace(changed(armed=armed, events=(stays,)), report=report))[0] == "keys_only"
    use_language("en")
    assert "Press t for therapist actions" in tr("guide.keys_only", act="t")


def test_a_control_that_has_ended_is_told_from_one_that_does_not_answer() -> None:
    assert READY.snapshot is not None
    silent = replace(READY, now_ns=READY.snapshot.at_ns + 1_000_000_000)
    assert next_step(silent)[0] == "control_silent"
    assert next_step(without("control", silent))[0] == "ended"  # and with it its simulated joints


def test_a_push_is_asked_for_only_where_it_begins_something() -> None:
    assert READY.report is not None
    shown = {
        gesture: replace(READY, report=msgspec.structs.replace(READY.report, gesture=gesture)) for gesture in Gesture
    }
    pushes = {gesture for gesture, state in shown.items() if next_step(state)[0] == "push"}
    assert READY.snapshot is not None
    assert pushes == {GESTURE_OF[action] for action in READY.snapshot.allowed}
    by_key = msgspec.structs.replace(READY.snapshot, by_key_only=READY.snapshot.allowed)
    assert all(next_step(replace(state, snapshot=by_key))[0] != "push" for state in shown.values())


@pytest.mark.parametrize("kind", ["can", "simulated"])
def test_real_joints_show_before_the_first_push_that_no_preflight_has_passed(kind: Literal["can", "simulated"]) -> None:
    config = msgspec.structs.replace(READY.setup.config, joints=JointsConfig(kind=kind))
    real = replace(READY, setup=msgspec.structs.replace(READY.setup, config=config))
    snapshot = READY.snapshot
    assert snapshot is not None
    first, *others = snapshot.allowed

    def lacking(*uncleared: Action) -> SessionState:
        return replace(real, snapshot=msgspec.structs.replace(snapshot, uncleared=uncleared))

    lights = [results(lacking(*some)).get("preflight") for some in ((), others, (first, *others))]
    assert lights == ([Light.GREEN, Light.AMBER, Light.AMBER] if kind == "can" else [None, None, None])
    steps = [next_step(lacking(*some))[0] for some in ((), others, (first, *others))]
    assert steps == [next_step(real)[0], next_step(real)[0], "preflight"]


def test_a_movement_cut_short_with_power_is_followed_by_a_slow_return() -> None:
    between = changed(state=GaitState.BETWEEN, enabled=True)
    assert next_step(between)[0] == "return"
    assert next_step(changed(state=GaitState.UNPOWERED, enabled=False))[0] == "initialise"
