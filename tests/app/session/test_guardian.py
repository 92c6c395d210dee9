"""What the guardian does with drives and adapters, and what it reports of them."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import can
import pytest

from app.ipc.links import new_link_directory
from app.ipc.messages import GuardianHealth, Heartbeat
from app.ipc.streams import ABSENT_NS, HEARTBEAT
from app.session.guardian import NAMING_NS, RETRY_NS, Guardian, GuardianNotice
from app.session.heartbeat_check import OFF_NS, GuardianAction
from app.system.config import Config, JointsConfig, SessionSetup
from hal.errors import CanFault, HardwareError
from hal.joints.can.port import frame_of, message_of
from hal.joints.codecs.wire import Frame, Order, SetPoint
from hal.joints.device import Exoskeleton, load_exoskeleton
from hal.joints.emulator.emulator import DriveEmulator
from hal.joints.emulator.firmware import EmulatedDrive
from hal.joints.protocol import Joint
from logs.reason import reason
from logs.records import HeartbeatLost, Note
from profiles.schema import DEMO_PATIENT
from tests.support.can_rig import assert_damping, listening, with_motor

MS = 1_000_000
CHECK = 4 * MS


class Adapter(can.BusABC):
    """A bus whose adapter may be pulled out; what is plugged in again is another one. Its drives answer at once."""

    def __init__(self, drives: Sequence[EmulatedDrive]) -> None:
        super().__init__(channel=0)
        self.plugged = True
        self.sent = 0
        self._drives = drives
        self._replies: list[Frame] = []

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        self._touch()
        self.sent += 1
        for drive in self._drives:
            if drive.accepts(frame_of(msg)):
                self._replies += drive.receive(frame_of(msg), self.sent)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        self._touch()
        return (message_of(self._replies.pop(0)), False) if self._replies else (None, False)

    def shutdown(self) -> None:
        super().shutdown()
        self._touch()

    def _touch(self) -> None:
        if not self.plugged:
            raise can.CanOperationError("no such device", 19)


@dataclass
class Watch:
    """A guardian whose checks, heartbeats and adapters are the test's."""

    adapters: list[Adapter] = field(default_factory=list)
    there: bool = True  # an adapter is plugged in
    drives: tuple[EmulatedDrive, ...] = ()
    health: list[GuardianHealth] = field(default_factory=list)
    records: list[Any] = field(default_factory=list)
    beat: Heartbeat | None = None
    now_ns: int = 1_000 * MS
    step_ns: int = CHECK

    def open_bus(self, _: object) -> Adapter:
        if not self.there:
            raise HardwareError(CanFault.NO_INTERFACE, bus="can0", command="")
        self.adapters.append(Adapter(self.drives))
        return self.adapters[-1]

    def pull_out(self) -> None:
        self.there = self.adapters[-1].plugged = False

    def receive(self) -> Heartbeat | None:
        beat, self.beat = self.beat, None
        return beat

    def check(self, guardian: Guardian, for_ns: int, *, enabled: bool | None = True) -> None:
        """Checks for so long, each with a heartbeat; None: without."""
        for _ in range(for_ns // self.step_ns):
            self.now_ns += self.step_ns
            if enabled is not None:
                self.beat = Heartbeat(at_ns=self.now_ns, enabled=enabled)
            guardian.check(self.now_ns)

    def end_unconfirmed(self, guardian: Guardian, *, killed: bool = False) -> tuple[list[GuardianAction], float]:
        """Control and session end with a drive that has not confirmed: what is done then, and for how long (ms).

        killed: control ends without another heartbeat.
        """
        self.check(guardian, RETRY_NS)
        self.check(guardian, 300 * MS, enabled=False)
        guardian.end()
        ended_ns = self.now_ns
        self.beat = Heartbeat(at_ns=ended_ns, enabled=False, last=not killed, unconfirmed=True)
        actions = []
        while self.now_ns == ended_ns or not guardian.done(self.now_ns):
            assert self.now_ns - ended_ns < 10_000 * MS, "it does not end"
            self.check(guardian, self.step_ns, enabled=None)
            actions.append(guardian._state.action)
        return actions, (self.now_ns - ended_ns) / MS

    def notes(self) -> list[Note]:
        """What the guardian wrote to the trail."""
        return [one for one in self.records if isinstance(one, Note)]


@pytest.fixture
def watch() -> Watch:
    return Watch()


@pytest.fixture
def make_guardian(watch: Watch, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[Exoskeleton], Guardian]:
    """Makes the guardian of such a device."""

    def nothing(*_: Any, **__: Any) -> None:
        pass

    link = SimpleNamespace(
        receive=watch.receive, send=watch.health.append, foreign_peers=lambda: 0, emit=watch.records.append
    )
    for name in ("AuditSink", "LatestReceiver", "Publisher"):
        monkeypatch.setattr(f"app.session.guardian.{name}", lambda *_: link)
    for name in ("set_scheduling", "place_guardian"):
        monkeypatch.setattr(f"app.session.guardian.{name}", nothing)
    monkeypatch.setattr("hal.joints.can.safe_stop.open_bus", watch.open_bus)
    config = Config(joints=JointsConfig(kind="can"))
    links = new_link_directory(tmp_path)

    def make(device: Exoskeleton) -> Guardian:
        monkeypatch.setattr("app.session.guardian.load_device", lambda _: device)
        return Guardian(
            SessionSetup(
                session="s",
                home=tmp_path,
                links=links,
                config=config,
                profile=DEMO_PATIENT,
                operator="",
                host_pid=os.getppid(),
            )
        )

    return make


@pytest.fixture
def guardian(make_guardian: Callable[[Exoskeleton], Guardian]) -> Guardian:
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
    make_guardian: Callable[[Exoskeleton], Guardian],
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
