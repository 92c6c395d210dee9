"""Torque off: what it ends, what stands in the trail, when the console takes it; and the guardian's own."""

from __future__ import annotations

import os
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace

import pytest

from app.console.app import ConsoleApp
from app.console.screens.dialogs import Question
from app.control.inputs import DriveNotice
from app.control.running_action import Stage
from app.control.telemetry import LoopStatus, snapshot
from app.ipc.links import new_link_directory
from app.ipc.messages import GuardianHealth, Heartbeat, OperatorKind
from app.ipc.snapshot import ControlSnapshot, Lateness, RealTime
from app.ipc.states import Effect, Event, Outcome, RequestRefusal
from app.ipc.streams import DAMP_NS, NS_PER_MS
from app.motion.follower import Mode
from app.session.guardian import CHECK_S, Guardian
from app.system.config import Config, SessionSetup
from app.system.paths import Home
from hal.joints.protocol import DriveState
from logs import records
from logs.reason import reason
from profiles.schema import DEMO_PATIENT
from testing.fake_host import FakeHost
from tests.app.console.conftest import wait_until
from tests.app.control.moments import DAMPING_TICKS, A, K, S, damped, drives, now, records_of, resting, standing
from tests.app.control.rig import TICK_NS, Rig


def shown(rig: Rig) -> ControlSnapshot:
    status = LoopStatus(incarnation=1, sequence=1, lateness=Lateness(), real_time=RealTime())
    return snapshot(now(rig), rig._inputs(), status)


async def test_joints_that_stay_damped_after_the_acknowledgement_can_be_switched_off(tmp_path: Path) -> None:
    rig = damped()
    assert (shown(rig).effect, shown(rig).damped, shown(standing()).damped) == (Effect.NOTE, True, False)
    hosts: list[FakeHost] = []

    def make_host(setup: SessionSetup) -> FakeHost:
        hosts.append(FakeHost(setup))
        return hosts[-1]

    app = ConsoleApp(Home(tmp_path / "home"), Config(), profile=DEMO_PATIENT, make_host=make_host)
    async with app.run_test() as pilot:
        await wait_until(pilot, lambda: (state := app.live_state()) and state.snapshot)
        hosts[-1].walked = {"damped": True}
        await wait_until(pilot, lambda: (state := app.live_state()) and state.snapshot and state.snapshot.damped)
        await pilot.press("o")
        await wait_until(pilot, lambda: isinstance(app.screen, Question) or app._notifications)
        await pilot.press("y")
        await wait_until(pilot, lambda: hosts[-1].kinds() or app._notifications)
        app.close_live()
    assert hosts[-1].kinds() == [K.TORQUE_OFF]


@pytest.mark.parametrize("ticks", [1, 5, 6])  # its plan is awaited, its plan comes, power has come
def test_it_ends_an_action_that_waits_for_its_plan_or_for_power(ticks: int) -> None:
    rig = resting(S.UNPOWERED)
    rig.answer_ticks = 5
    rig.send(K.ACT, A.INITIALISE)
    rig.tick(ticks)
    rig.send(K.TORQUE_OFF)
    rig.tick()
    ended = now(rig).reports[-1]
    assert (now(rig).running, ended.outcome, ended.reason) == (
        None,
        Outcome.STOPPED,
        reason(RequestRefusal.TORQUE_OFF),
    )
    rig.tick(50)
    assert (drives(rig), now(rig).gait.state, rig.events()) == (DriveState.DISABLED, S.UNPOWERED, set())
    assert rig.act(A.INITIALISE).gait.state is S.STANDING


def test_it_ends_a_stand_that_is_requested_in_the_same_tick() -> None:
    for rig in (resting(S.UNPOWERED), damped()):
        rig.send(K.ACT, A.INITIALISE)
        rig.send(K.TORQUE_OFF)
        rig.tick(400)
        assert (drives(rig), now(rig).gait.state, now(rig).running) == (DriveState.DISABLED, S.UNPOWERED, None)
        assert now(rig).reports[-1].reason == reason(RequestRefusal.TORQUE_OFF)


@pytest.mark.parametrize("missed", [0, 2])
def test_it_takes_the_torque_in_the_tick_in_which_the_plan_comes_that_would_stiffen_the_joints(missed: int) -> None:
    rig = damped()
    rig.answer_ticks = 5
    rig.send(K.ACT, A.INITIALISE)
    rig.tick(5)
    assert now(rig).running is not None
    rig.send(K.TORQUE_OFF)
    rig.spoil = {"missed_ticks": missed, "late_ns": missed * TICK_NS}
    rig.tick()
    assert (drives(rig), now(rig).gait.state, now(rig).torque_off) == (DriveState.DISABLED, S.UNPOWERED, False)
    assert now(rig).reports[-1].reason == reason(RequestRefusal.TORQUE_OFF)
    rig.answer_ticks = 1
    rig.tick(5)
    assert rig.act(A.INITIALISE).gait.state is S.STANDING
    for _ in range(2):
        rig.send(K.STOP)
    rig.tick(2 * DAMPING_TICKS)
    assert drives(rig) is DriveState.ENABLED, "nothing of it is left for the next damping"


@pytest.mark.parametrize("kinds", [(K.STOP, K.TORQUE_OFF), (K.TORQUE_OFF, K.STOP)])
def test_in_the_tick_in_which_damping_begins_it_is_no_loss_of_power(kinds: tuple[OperatorKind, OperatorKind]) -> None:
    rig = resting(S.UNPOWERED)
    rig.send(K.ACT, A.INITIALISE)
    rig.run_until(lambda m: m.running is not None and m.running.stage is Stage.ENABLING)
    rig.send(K.STOP)
    rig.tick()
    assert (drives(rig), now(rig).motion.mode) == (DriveState.ENABLED, Mode.DISABLED), "powered, commanded nothing"
    for kind in kinds:
        rig.send(kind)
    rig.tick(3)
    assert drives(rig) is DriveState.DISABLED
    assert rig.events() == {Event.STOP.value, Event.STOP_AGAIN.value}


def test_it_is_recorded_as_taken_and_as_refused() -> None:
    rig = standing()
    rig.send(K.TORQUE_OFF)
    rig.tick()
    (refused,) = records_of(rig, records.Note)
    assert refused.text == now(rig).refusal == reason(RequestRefusal.TORQUE_OFF_NEEDS_DAMPING)
    for rig in (damped(), resting(S.UNPOWERED)):
        rig.send(K.TORQUE_OFF)
        rig.tick(2)
        assert [one.text for one in records_of(rig, records.Note)] == [reason(RequestRefusal.TORQUE_OFF)]
        assert drives(rig) is DriveState.DISABLED


def test_drives_that_the_guardian_switches_off_are_not_commanded_any_more() -> None:
    """A V3 drive is powered by any command: its damping would undo the guardian's work."""
    rig = standing()
    rig.guardian_health = {"acted": True}
    rig.tick(400)
    assert (now(rig).motion.fully_damped, drives(rig)) == (True, DriveState.ENABLED)
    rig.guardian_health = {"acted": True, "off": True}
    rig.tick(30)
    assert drives(rig) is DriveState.DISABLED
    assert [one.text for one in records_of(rig, records.Note)] == [reason(DriveNotice.FOLLOWED_GUARDIAN)]
    assert rig.events() == {Event.GUARDIAN_ACTED.value}
    rig.guardian_health = {}
    rig.tick(30)
    rig.send(K.ACKNOWLEDGE)
    rig.tick(2)
    assert rig.act(A.INITIALISE).gait.state is S.STANDING
    assert Event.DRIVES_POWER_LOST.value not in {body.event for body in records_of(rig, records.EventRaised)}


def test_stiff_joints_are_damped_before_they_follow_a_guardian_that_is_off_already() -> None:
    rig = standing()
    rig.guardian_health = {"acted": True, "off": True}
    rig.run_until(lambda m: m.effect is Effect.DAMP)
    rig.tick(DAMPING_TICKS - 5)
    assert drives(rig) is DriveState.ENABLED
    rig.tick(10)
    assert drives(rig) is DriveState.DISABLED
    assert not records_of(rig, records.GuardRefusal)


def test_the_guardian_says_that_it_switches_off_as_soon_as_it_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    health: list[GuardianHealth] = []
    beats = [Heartbeat(at_ns=0, enabled=True)]
    link = SimpleNamespace(
        receive=lambda: beats.pop() if beats else None,
        send=health.append,
        emit=lambda _: True,
        foreign_peers=lambda: 0,
        close=lambda: None,
    )
    for name in ("AuditSink", "LatestReceiver", "Publisher"):
        monkeypatch.setattr(f"app.session.guardian.{name}", lambda *_: link)
    for name in ("set_scheduling", "place_guardian"):
        monkeypatch.setattr(f"app.session.guardian.{name}", lambda *_, **__: None)
    setup = SessionSetup(
        session="s",
        home=tmp_path,
        links=new_link_directory(tmp_path),
        config=Config(),
        profile=DEMO_PATIENT,
        operator="",
        host_pid=os.getppid(),
    )
    with closing(Guardian(setup)) as guardian:
        for now_ns in range(0, DAMP_NS + 200 * NS_PER_MS, int(CHECK_S * 1e9)):
            guardian.check(now_ns)
    acted_ns = next(one.at_ns for one in health if one.acted)
    off_ns = next(one.at_ns for one in health if one.off)
    assert 0 < off_ns - acted_ns - DAMP_NS <= int(CHECK_S * 1e9)
    assert all(one.off is (one.at_ns >= off_ns) for one in health)
