"""What the guardian does with drives and adapters, and what it reports of them."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

import pytest

from app.ipc.links import new_link_directory
from app.ipc.streams import ABSENT_NS, DAMP_NS, HEARTBEAT
from app.session.guardian import ANSWER_CHECKS, ANSWER_NS, NAMING_NS, RETRY_NS, Guardian, GuardianNotice
from app.session.heartbeat_check import ENDING_DAMP_NS, OFF_NS, GuardianAction
from app.system.config import Config, JointsConfig, SessionSetup
from hal.joints.codecs.wire import Order, SetPoint
from hal.joints.device import Exoskeleton, load_exoskeleton
from hal.joints.emulator.emulator import DriveEmulator
from hal.joints.protocol import Joint
from logs.reason import reason
from logs.records import HeartbeatLost, Note
from profiles.schema import DEMO_PATIENT
from tests.app.session.guardian_watch import CHECK, MS, Watch
from tests.support.can_rig import assert_damping, listening, with_motor


@pytest.fixture
def watch() -> Watch:
    return Watch()


@pytest.fixture
def make_guardian(watch: Watch, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Guardian]:
    """Makes the guardian of such a device."""

    def nothing(*_: Any, **__: Any) -> None:
        pass

    link = SimpleNamespace(
        receive=watch.receive,
        send=watch.health.append,
        foreign_peers=watch.foreign_peers,
        emit=watch.records.append,
        close=nothing,
    )
    for name in ("AuditSink", "LatestReceiver", "Publisher"):
        monkeypatch.setattr(f"app.session.guardian.{name}", lambda *_: link)
    for name in ("set_scheduling", "place_guardian"):
        monkeypatch.setattr(f"app.session.guardian.{name}", nothing)
    monkeypatch.setattr("hal.joints.can.safe_stop.open_bus", watch.open_bus)
    links = new_link_directory(tmp_path)

    def make(device: Exoskeleton, kind: Literal["can", "simulated"] = "can") -> Guardian:
        monkeypatch.setattr("app.session.guardian.load_device", lambda _: device)
        return Guardian(
            SessionSetup(
                session="s",
                home=tmp_path,
                links=links,
                config=Config(joints=JointsConfig(kind=kind)),
                profile=DEMO_PATIENT,
                operator="",
                host_pid=os.getppid(),
            )
        )

    return make


@pytest.fixture
def guardian(make_guardian: Callable[..., Guardian]) -> Guardian:
    return make_guardian(load_exoskeleton())


def test_after_torque_off_the_guardian_opens_its_bus_anew(guardian: Guardian, watch: Watch) -> None:
    watch.check(guardian, RETRY_NS)
    assert len(watch.adapters) == 1
    watch.check(guardian, 2 * CHECK, enabled=False)
    assert len(watch.adapters) == 2
    assert not any(one.fault for one in watch.health)
    watch.check(guardian, RETRY_NS, enabled=False)
    watch.check(guardian, RETRY_NS)
    assert len(watch.adapters) == 2


@pytest.mark.parametrize("plug_in_again", [True, False])
def test_a_bus_that_is_gone_is_reported_until_it_is_there_again(
    guardian: Guardian, watch: Watch, plug_in_again: bool
) -> None:
    watch.check(guardian, RETRY_NS)
    watch.pull_out()
    watch.check(guardian, 2 * RETRY_NS)
    assert watch.health[-1].fault is not None
    watch.there = plug_in_again
    watch.check(guardian, 2 * RETRY_NS)
    assert (watch.health[-1].fault is None) is plug_in_again
    watch.check(guardian, 200 * MS, enabled=None)
    assert watch.health[-1].acted
    assert (watch.adapters[-1].sent > 0) is plug_in_again


def test_a_bus_that_fails_while_the_guardian_damps_is_opened_again(guardian: Guardian, watch: Watch) -> None:
    watch.check(guardian, RETRY_NS)
    watch.check(guardian, 200 * MS, enabled=None)
    watch.adapters[0].plugged = False
    watch.check(guardian, 2 * RETRY_NS, enabled=None)
    assert watch.adapters[-1].sent > 0
    assert len(watch.adapters) == 2


def test_that_it_acts_is_said_at_once(guardian: Guardian, watch: Watch) -> None:
    watch.check(guardian, RETRY_NS)
    while not watch.health[-1].acted:
        assert watch.now_ns < 10_000 * MS
        before = len(watch.health)
        watch.check(guardian, CHECK, enabled=None)
    assert watch.health[-1].at_ns == watch.now_ns
    assert watch.now_ns - 1_000 * MS - RETRY_NS < 80 * MS
    assert len(watch.health) == before + 1


def test_a_control_that_waits_for_an_answer_gets_one_though_nothing_was_done(guardian: Guardian, watch: Watch) -> None:
    watch.check(guardian, RETRY_NS)
    watch.check(guardian, int(ABSENT_NS), enabled=None)
    before = len(watch.health)
    watch.check(guardian, CHECK)
    assert [(one.at_ns, one.acted) for one in watch.health[before:]] == [(watch.now_ns, False)]


def test_a_control_that_comes_back_is_answered_at_once(guardian: Guardian, watch: Watch) -> None:
    watch.check(guardian, RETRY_NS)
    watch.check(guardian, 80 * MS, enabled=None)
    before = len(watch.health)
    watch.check(guardian, 2 * CHECK)
    assert [(one.at_ns, one.acted) for one in watch.health[before:]] == [(watch.now_ns - CHECK, True)]


@pytest.mark.parametrize(("motor", "damped_ms"), [("AK80-64/V2", 300), ("AK80-64/V3", 0)])
def test_drives_that_have_not_confirmed_that_they_are_off_are_damped_before_but_none_that_it_would_power(
    make_guardian: Callable[..., Guardian],
    watch: Watch,
    monkeypatch: pytest.MonkeyPatch,
    motor: str,
    damped_ms: float,
) -> None:
    """The connector of one is in again: it is stiff, the others are off."""
    device = with_motor(motor)
    watch.drives = DriveEmulator(device).drives
    knee = watch.drives[Joint.LEFT_KNEE]
    knee.motor_mode, knee._target = True, SetPoint(0.1, 0.0, 40.0, 2.0, 0.0)
    told = [listening(monkeypatch, drive) for drive in watch.drives]
    guardian = make_guardian(device)
    actions, took_ms = watch.end_unconfirmed(guardian)
    assert list(dict.fromkeys(actions)) == [GuardianAction.DAMP_LEFT_ON, GuardianAction.SWITCH_OFF]
    assert took_ms == pytest.approx(300 + OFF_NS / MS, abs=20)
    for drive, asked in zip(watch.drives, told, strict=True):
        off_from = asked.index(Order.DISABLE)
        assert off_from * CHECK / MS == pytest.approx(damped_ms, abs=10)
        assert_damping(drive, asked[:off_from])
        assert set(asked[off_from:]) == {Order.DISABLE}
        assert not drive.motor_mode
    assert watch.notes() == []


def test_where_control_is_killed_before_all_drives_have_confirmed_the_guardian_switches_them_off_before_it_ends(
    guardian: Guardian, watch: Watch
) -> None:
    watch.drives = DriveEmulator(load_exoskeleton()).drives
    knee = watch.drives[Joint.LEFT_KNEE]
    knee.motor_mode, knee._target = True, SetPoint(0.1, 0.0, 40.0, 2.0, 0.0)
    actions, took_ms = watch.end_unconfirmed(guardian, killed=True)
    assert list(dict.fromkeys(actions)) == [
        GuardianAction.MONITOR,
        GuardianAction.DAMP_LEFT_ON,
        GuardianAction.SWITCH_OFF,
    ]
    assert took_ms == pytest.approx(72 + 300 + OFF_NS / MS, abs=20)
    assert not knee.motor_mode
    assert [one.stream for one in watch.records if isinstance(one, HeartbeatLost)] == [HEARTBEAT.name]


@pytest.mark.parametrize("step_ms", [4, 6, 7, 10, 20])
def test_who_has_not_answered_is_named_before_the_guardian_ends_however_late_its_checks(
    guardian: Guardian, watch: Watch, step_ms: int
) -> None:
    """`END_PATIENCE_S` leaves it two seconds for that."""
    watch.step_ns = step_ms * MS
    _, took_ms = watch.end_unconfirmed(guardian)
    silent = reason(GuardianNotice.NOT_ANSWERED, action=GuardianAction.SWITCH_OFF, joints=tuple(Joint))
    assert watch.notes()[-1] == Note(text=silent)
    assert watch.health[-1].unanswered == ("left_hip", "left_knee", "right_hip", "right_knee")
    assert 300 + OFF_NS / MS < took_ms < 1_500


def test_a_guardian_whose_checks_are_too_few_to_name_anybody_ends_all_the_same(
    guardian: Guardian, watch: Watch
) -> None:
    watch.step_ns = 100 * MS
    _, took_ms = watch.end_unconfirmed(guardian)
    assert watch.notes() == []
    assert took_ms == pytest.approx(300 + NAMING_NS / MS, abs=300)


def test_it_keeps_the_bus_that_it_damps_over_though_control_reports_that_the_drives_are_off(
    guardian: Guardian, watch: Watch
) -> None:
    """What it opens anew it opens afterwards; the adapter of before is released."""
    watch.check(guardian, RETRY_NS)
    watch.check(guardian, 80 * MS, enabled=None)
    watch.check(guardian, DAMP_NS, enabled=False)
    assert (watch.health[-1].acted, len(watch.adapters)) == (True, 1)
    watch.check(guardian, 2 * OFF_NS, enabled=False)
    assert (watch.health[-1].acted, len(watch.adapters)) == (False, 2)
    assert [one.open for one in watch.adapters] == [False, True]


@pytest.mark.parametrize("ending", [False, True])
def test_where_the_session_goes_on_it_damps_for_as_long_as_a_wearer_takes_to_sink(
    guardian: Guardian, watch: Watch, ending: bool
) -> None:
    watch.check(guardian, RETRY_NS)
    if ending:
        guardian.end()
    while not watch.health[-1].acted:
        watch.check(guardian, CHECK, enabled=None)
    acted_ns = watch.now_ns
    while not watch.health[-1].off:
        assert watch.now_ns < acted_ns + 2 * DAMP_NS
        watch.check(guardian, CHECK, enabled=None)
    expected_ns = ENDING_DAMP_NS if ending else DAMP_NS
    assert watch.now_ns - acted_ns == pytest.approx(expected_ns, abs=2 * CHECK)


def test_a_heartbeat_that_is_stale_at_one_check_only_is_no_loss(guardian: Guardian, watch: Watch) -> None:
    watch.check(guardian, RETRY_NS)
    while not guardian._state.missed:
        watch.check(guardian, CHECK, enabled=None)
    watch.check(guardian, RETRY_NS)
    assert not any(isinstance(one, HeartbeatLost | Note) for one in watch.records)
    watch.check(guardian, 80 * MS, enabled=None)
    assert [one for one in watch.records if isinstance(one, HeartbeatLost | Note)] == [
        HeartbeatLost(stream=HEARTBEAT.name, age_ms=72.0),
        Note(text=reason(GuardianNotice.DAMPS)),
    ]


@pytest.mark.parametrize("step_ms", [4, 20])
def test_replies_that_waited_in_the_socket_are_no_answer_to_the_guardian(
    guardian: Guardian, watch: Watch, step_ms: int
) -> None:
    watch.step_ns = step_ms * MS
    drives = DriveEmulator(load_exoskeleton()).drives
    replies = [frame for drive in drives for frame in drive._reports()]
    watch.waiting = replies * (6_000 // len(replies))
    watch.check(guardian, RETRY_NS)
    watch.check(guardian, 80 * MS + ANSWER_CHECKS * watch.step_ns + ANSWER_NS, enabled=None)
    assert watch.health[-1].unanswered == ("left_hip", "left_knee", "right_hip", "right_knee")


def test_foreign_peers_are_counted_over_the_session(guardian: Guardian, watch: Watch) -> None:
    watch.check(guardian, RETRY_NS)
    for _ in range(2):
        watch.strangers = 2
        watch.check(guardian, RETRY_NS)
    assert watch.health[-1].foreign_peers == 4


def test_simulated_joints_are_gone_with_control_and_the_guardian_says_so(
    make_guardian: Callable[..., Guardian], watch: Watch
) -> None:
    guardian = make_guardian(load_exoskeleton(), kind="simulated")
    watch.check(guardian, RETRY_NS)
    watch.check(guardian, 80 * MS, enabled=None)
    assert watch.notes() == [Note(text=reason(GuardianNotice.CANNOT_REACH))]
    assert watch.health[-1].acted
    watch.check(guardian, DAMP_NS + OFF_NS + RETRY_NS, enabled=False)
    assert (watch.health[-1].acted, watch.health[-1].fault, watch.adapters) == (False, None, [])
    guardian.close()
    assert watch.records[-1].reason == reason(GuardianNotice.ENDED, action=GuardianAction.MONITOR)
