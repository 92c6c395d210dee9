"""Joint commands missing for some time: the limits in use survive it, and the figures are shown."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest
from rich.console import Console

from app.control.events.drives import FOLLOWING_LIMIT_RAD
from app.control.events.programs import CONTROL_LATE_MS, CONTROL_STALLED_MS
from app.evaluate.loop.dropout import Dropout, dropout_table, dropouts, plot_dropouts
from app.ipc.states import Action
from app.motion.plan import patient_of
from hal.joints.device import load_exoskeleton
from hal.joints.guard import SPEED_MARGIN
from profiles.schema import DEMO_PATIENT

DEVICE = load_exoskeleton()


def found(action: Action, *missing_ms: float) -> list[Dropout]:
    patient = patient_of(DEMO_PATIENT, DEVICE)
    return list(dropouts(patient, DEVICE, action, missing_ms, pause_from_ms=CONTROL_LATE_MS))


@pytest.mark.parametrize("action", [Action.OBSTACLE, Action.STEP_RIGHT_FIRST])
def test_the_legs_survive_what_control_pauses_for(action: Action) -> None:
    without, short, longest = found(action, 0.0, CONTROL_LATE_MS, CONTROL_STALLED_MS)
    for one in (without, short, longest):
        assert one.guard_refusal is None
        assert one.error_rad < FOLLOWING_LIMIT_RAD / 2
        assert one.speed_share < SPEED_MARGIN - 0.1
        assert one.torque_share < 0.7
    assert without.error_rad < short.error_rad < longest.error_rad


@pytest.mark.parametrize("step_time_s", [0.8, 1.2])
@pytest.mark.parametrize("stature_m", [1.6, 1.85])
def test_fast_patients_survive_a_pause_over_an_obstacle_too(step_time_s: float, stature_m: float) -> None:
    gait = msgspec.structs.replace(DEMO_PATIENT.gait, step_time_s=step_time_s)
    patient = patient_of(msgspec.structs.replace(DEMO_PATIENT, stature_m=stature_m, gait=gait), DEVICE)
    lengths = (40.0, 46.0, CONTROL_STALLED_MS)
    for one in dropouts(patient, DEVICE, Action.OBSTACLE, lengths, pause_from_ms=CONTROL_LATE_MS):
        assert one.guard_refusal is None
        assert one.speed_share < SPEED_MARGIN


def test_beyond_its_limit_control_holds_at_every_phase_and_the_legs_come_to_rest_softly() -> None:
    patient = patient_of(DEMO_PATIENT, DEVICE)
    lengths = (10.0, 80.0)
    pause_ms, hold_ms = CONTROL_LATE_MS, CONTROL_STALLED_MS
    every = list(dropouts(patient, DEVICE, Action.STEP_END, lengths, 3, pause_from_ms=pause_ms, hold_from_ms=hold_ms))
    assert [one.missing_ms for one in every] == [*lengths] * 3
    for one in every:
        assert one.guard_refusal is None
        assert one.speed_share < 1
        assert one.torque_share < 1
    assert len({one.error_rad for one in every[::2]}) == 3, "at another tick each"


def test_the_figures_are_shown_and_drawn(tmp_path: Path) -> None:
    rows = [
        Dropout(
            action=action,
            missing_ms=missing,
            error_rad=0.1,
            speed_share=0.5,
            torque_share=0.25,
            guard_refusal=None,
        )
        for action in (Action.WALK, Action.SIT_DOWN)
        for missing in (0.0, 40.0)
    ]
    console = Console(width=120, record=True)
    console.print(dropout_table(rows))
    text = console.export_text()
    assert "5.7" in text
    assert "50%" in text
    plot_dropouts(rows, tmp_path / "dropout.svg")
    assert (tmp_path / "dropout.svg").read_text(encoding="utf-8").lstrip().startswith("<?xml")
