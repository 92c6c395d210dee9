"""The loop around the step: what it reads after it has waited for the drives."""

from __future__ import annotations

import os
import time
from contextlib import closing
from pathlib import Path
from typing import ClassVar

import pytest

from app.control import loop
from app.control.drives import Drives
from app.control.inputs import HOST_SUSPENDED_S
from app.control.links import ControlLinks, Received
from app.control.loop import Control
from app.ipc.links import new_link_directory
from app.ipc.messages import AuditHealth, GuardianHealth, Heartbeat, OperatorCommand, OperatorKind
from app.ipc.snapshot import RealTime
from app.ipc.streams import AUDIT_HEALTH, GUARDIAN
from app.system.config import Config, JointsConfig, SessionSetup
from hal.errors import DrivesFault, HardwareError
from hal.joints.protocol import DriveState, JointCommand, JointFeedback
from logs.records import Body, HeartbeatLost
from profiles.schema import DEMO_PATIENT
from tests.app.control.ideal_joints import IdealJoints
from tests.app.control.rig import SETTINGS, TICK_NS

WAIT_NS = 500_000_000  # longer than the silence that any stream is allowed


class Clock:
    """The loop's timer: time goes by the tick, and by what the drives take."""

    now_ns: ClassVar[int] = 0

    def __init__(self, **_: int) -> None:
        self.next_ns = 0

    def wait(self) -> tuple[int, int, int]:
        Clock.now_ns += TICK_NS
        return Clock.now_ns, 0, 0


class SlowDrives(IdealJoints):
    """Drives that are waited for when torque goes off."""

    def open(self, now_ns: int) -> None:
        self.state = DriveState.PROBED

    def enable(self, now_ns: int) -> None:
        """Nobody asks."""

    def write(self, command: JointCommand, now_ns: int) -> None:
        self.take(command)

    def read(self, now_ns: int) -> JointFeedback:
        return self.feedback(now_ns)

    def close(self, now_ns: int) -> None:
        Clock.now_ns += WAIT_NS
        self.state = DriveState.DISABLED


class SilentDrives(SlowDrives):
    """Drives that do not confirm that they are off."""

    def close(self, now_ns: int) -> None:
        raise HardwareError(DrivesFault.NOT_CONFIRMED_OFF, joints=())


class Links(ControlLinks):
    """Audit and guardian have always just sent; the operator switches off in one tick and ends in a later one."""

    def __init__(self, off_tick: int) -> None:
        self.heartbeats = list[Heartbeat]()
        self._kinds = {off_tick: OperatorKind.TORQUE_OFF, off_tick + 10: OperatorKind.SHUT_DOWN}
        self._tick = 0

    def receive(self, *, slow: bool, planning: bool) -> Received:
        self._tick += 1
        kind = self._kinds.get(self._tick - 1, OperatorKind.HEARTBEAT)
        return Received(
            report=None,
            commands=(OperatorCommand(sequence=self._tick, kind=kind, sent_ns=Clock.now_ns),),
            plans=(),
            audit=AuditHealth(at_ns=Clock.now_ns, written=1, waiting=0) if slow else None,
            guardian=GuardianHealth(at_ns=Clock.now_ns) if slow else None,
            link=None,
            rejected_messages=0,
            foreign_peers=0,
        )

    def send_plan_requests(self, plan_requests: object) -> None:
        """Nobody plans."""

    def send_heartbeat(self, heartbeat: Heartbeat) -> None:
        self.heartbeats.append(heartbeat)

    def send_snapshot(self, snapshot: object) -> None:
        """Nobody looks."""

    def close(self) -> None:
        """Nothing is open."""


@pytest.fixture
def setup(tmp_path: Path) -> SessionSetup:
    (tmp_path / "links").mkdir(mode=0o700)
    return SessionSetup(
        session="s",
        home=tmp_path,
        links=new_link_directory(tmp_path / "links"),
        config=Config(joints=JointsConfig(kind="can")),
        profile=DEMO_PATIENT,
        operator="",
        host_pid=os.getppid(),
    )


def test_a_tick_that_was_frozen_is_no_sleep_of_the_computer_and_no_step_of_its_clock(setup: SessionSetup) -> None:
    with closing(Control(setup, RealTime())) as control:
        control._links.close()
        control._links = Links(off_tick=9)
        now_ns = time.monotonic_ns()
        inputs = [control._read(began_ns, 0, 0) for began_ns in (now_ns, now_ns - WAIT_NS)]
    before, frozen = [(one.boot_ns - one.now_ns, one.wall_ns - one.now_ns) for one in inputs]
    assert frozen == pytest.approx(before, abs=HOST_SUSPENDED_S * 1e9)


@pytest.mark.parametrize("off_tick", range(20, 25))
def test_a_wait_for_the_drives_loses_no_heartbeat_of_audit_or_guardian(
    setup: SessionSetup, monkeypatch: pytest.MonkeyPatch, off_tick: int
) -> None:
    """Their messages came meanwhile, in whichever tick the slow streams are read."""
    monkeypatch.setattr(loop, "PeriodicTimer", Clock)
    monkeypatch.setattr(loop, "pin_to_control_core", lambda _: None)
    monkeypatch.setattr(loop, "disable_gc", lambda: None)
    began_ns = time.monotonic_ns()
    monkeypatch.setattr(Clock, "now_ns", began_ns)
    recorded = list[Body]()

    def record(body: Body) -> bool:
        recorded.append(body)
        return True

    with closing(Control(setup, RealTime())) as control:
        control._links.close()
        control._links = Links(off_tick)
        control._drives = Drives(SlowDrives(), SETTINGS.limits, SETTINGS.gains)
        monkeypatch.setattr(control._sink, "emit", record)
        control.run()
    assert Clock.now_ns > began_ns + WAIT_NS
    lost = {body.stream for body in recorded if isinstance(body, HeartbeatLost)}
    assert not lost & {AUDIT_HEALTH.name, GUARDIAN.name}


@pytest.mark.parametrize("joints", [SlowDrives(), SilentDrives()])
def test_the_last_heartbeat_says_where_a_drive_has_not_confirmed_that_it_is_off(
    setup: SessionSetup, joints: SlowDrives
) -> None:
    with closing(Control(setup, RealTime())) as control:
        control._links.close()
        control._links = links = Links(off_tick=9)
        control._drives = Drives(joints, SETTINGS.limits, SETTINGS.gains)
    confirmed = not isinstance(joints, SilentDrives)
    newest = links.heartbeats[-1]
    assert (newest.enabled, newest.last, newest.unconfirmed) == (False, True, not confirmed)
    assert not any(one.last for one in links.heartbeats[:-1])


def test_until_all_drives_have_confirmed_that_they_are_off_each_heartbeat_says_so(
    setup: SessionSetup, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And before each wait for their answers, one says that the next comes late."""
    monkeypatch.setattr(loop, "PeriodicTimer", Clock)
    monkeypatch.setattr(loop, "pin_to_control_core", lambda _: None)
    monkeypatch.setattr(loop, "disable_gc", lambda: None)
    monkeypatch.setattr(Clock, "now_ns", time.monotonic_ns())
    with closing(Control(setup, RealTime())) as control:
        control._links.close()
        control._links = links = Links(off_tick=9)
        control._drives = Drives(SilentDrives(), SETTINGS.limits, SETTINGS.gains)
        control.run()
    ordered = next(number for number, one in enumerate(links.heartbeats) if one.awaits_drives)
    assert not any(one.unconfirmed for one in links.heartbeats[:ordered])
    assert all(one.unconfirmed and not one.enabled for one in links.heartbeats[ordered:])
    waits = [one for one in links.heartbeats if one.awaits_drives]
    assert len(waits) == 3, "torque off, and two at the session's end"
