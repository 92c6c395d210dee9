"""Which actions have passed their pre-flight, asked again and again while a session runs."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from app.control.loop import Control
from app.control.telemetry import LoopStatus, snapshot
from app.ipc.links import new_link_directory
from app.ipc.messages import OperatorKind
from app.ipc.snapshot import Lateness, RealTime
from app.ipc.states import Action, Event
from app.motion.plan import patient_of
from app.motion.preflight import keep_verdict
from app.motion.rehearsal_checks import RehearsalVerdict
from app.system.config import Config, JointsConfig, SessionSetup
from app.system.paths import Home
from hal.joints.device import DEFAULT_DEVICE, load_exoskeleton
from profiles.schema import DEMO_PATIENT
from tests.app.control.moments import now, standing

DESCRIBED = DEFAULT_DEVICE.read_text(encoding="utf-8")


class Unpowered:
    """Control before its drives carry power, on a device file of its own."""

    def __init__(self, folder: Path) -> None:
        self.file = folder / "exoskeleton.toml"
        self.file.write_text(DESCRIBED, encoding="utf-8")
        self.home = Home(folder / "home")
        (folder / "links").mkdir(mode=0o700)
        setup = SessionSetup(
            session="s",
            home=self.home.root,
            links=new_link_directory(folder / "links"),
            config=Config(joints=JointsConfig(kind="can", device=str(self.file))),
            profile=DEMO_PATIENT,
            operator="",
        )
        self.control = Control(setup, RealTime())

    def rehearse(self, action: Action, *, passed: bool = True) -> None:
        """Keep the verdict of a rehearsal in the device as the file describes it now."""
        device = load_exoskeleton(self.file)
        verdict = RehearsalVerdict(action=action, passed=passed, reasons=())
        keep_verdict(self.home, patient_of(DEMO_PATIENT, device), device, action, verdict)

    def cleared(self) -> frozenset[Action] | None:
        """What a tick is told."""
        return self.control._read(time.monotonic_ns(), 0, 0).cleared


@pytest.fixture
def unpowered(tmp_path: Path) -> Iterator[Unpowered]:
    made = Unpowered(tmp_path)
    with closing(made.control):
        yield made


def test_a_preflight_that_passes_meanwhile_clears_its_action(unpowered: Unpowered) -> None:
    assert unpowered.cleared() == frozenset()
    unpowered.rehearse(Action.WALK)
    unpowered.rehearse(Action.STAIR_UP, passed=False)
    assert unpowered.cleared() == frozenset({Action.WALK})


def test_a_device_file_edited_meanwhile_neither_ends_control_nor_clears_for_other_limits(unpowered: Unpowered) -> None:
    unpowered.rehearse(Action.WALK)
    unpowered.file.write_text(DESCRIBED.replace("max_torque_nm = 110.0", "max_torque_nm = 150.0"), encoding="utf-8")
    unpowered.rehearse(Action.STAIR_UP)
    assert unpowered.cleared() == frozenset({Action.WALK})
    unpowered.file.write_text("max_torque_nm = 110,0", encoding="utf-8")
    assert unpowered.cleared() == frozenset({Action.WALK})
    unpowered.file.unlink()
    assert unpowered.cleared() == frozenset({Action.WALK})


def test_verdicts_that_can_not_be_read_clear_nothing(unpowered: Unpowered) -> None:
    unpowered.rehearse(Action.WALK)
    (record,) = (unpowered.home.root / "preflight").iterdir()
    for damage in (b"", b"\xff\xfe", b"[" * 100_000, record.read_bytes()[:-2]):
        record.write_bytes(damage)
        assert unpowered.cleared() == frozenset()
    record.unlink()
    record.mkdir()
    assert unpowered.cleared() == frozenset()


@pytest.mark.parametrize("cleared", [None, frozenset[Action](), frozenset({Action.INITIALISE, Action.WALK})])
def test_what_a_snapshot_calls_uncleared_is_what_is_refused(cleared: frozenset[Action] | None) -> None:
    refused = set[Action]()
    for action in Action:
        rig = standing()
        rig.cleared = cleared
        rig.send(OperatorKind.ACT, action)
        rig.tick()
        refused |= {action} if any(one.event is Event.NO_PREFLIGHT for one in now(rig).events) else set()
    status = LoopStatus(incarnation=1, sequence=1, lateness=Lateness(), real_time=RealTime())
    assert set(snapshot(now(rig), rig._inputs(), status).uncleared) == refused
    assert len(refused) == (0 if cleared is None else len(Action) - 1 - len(cleared))
