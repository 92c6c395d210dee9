"""The wearer as drawn from the joints: who carries, where the feet are, what stands around."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.console.widgets.canvas import Canvas
from app.console.widgets.figure import GHOST, LIVE, View, draw
from app.console.widgets.panel import cells
from app.ipc.states import Action
from app.motion.plan import Phase, patient_of, quad
from app.motion.trajectory import path_of, scene_of
from app.motion.wearer import LEFT, RIGHT, Pose, Stance, pose_of
from hal.joints.body import trunk_lean_of
from hal.joints.device import load_exoskeleton
from profiles.schema import DEMO_PATIENT

PATIENT = patient_of(DEMO_PATIENT, load_exoskeleton())
BODY, GAIT = PATIENT.body, PATIENT.gait
FRAMES = 60


def walked(action: Action) -> list[tuple[Pose, Stance]]:
    """The poses of an action, as its nominal path has the joints."""
    path, scene, stance = path_of(action, Phase.WHOLE, PATIENT), scene_of(action, PATIENT), Stance(side=LEFT)
    found = []
    for row in range(0, len(path.joints_rad), max(1, len(path.joints_rad) // FRAMES)):
        angles = quad(path.joints_rad[row])
        pose, stance = pose_of(BODY, angles, trunk_lean_of(angles[1], angles[3]), stance, scene)
        found.append((pose, stance))
    return found


def test_the_foot_that_carries_stays_where_it_stands() -> None:
    poses = walked(Action.STEP_RIGHT_FIRST)
    in_the_air = [pose for pose, stance in poses if pose.carries == (True, False)]
    assert len(in_the_air) > FRAMES / 4
    assert all(pose.ankles[LEFT][0] == pytest.approx(0.0, abs=0.01) for pose in in_the_air)
    last, _ = poses[-1]
    assert last.carries == (True, True)
    assert last.ankles[RIGHT][0] - last.ankles[LEFT][0] == pytest.approx(GAIT.step_length_m, abs=0.02)


def test_a_stair_is_climbed_on_the_screen_too() -> None:
    poses = walked(Action.STAIR_UP)
    last, first = poses[-1][0], poses[0][0]
    assert last.hip[1] - first.hip[1] == pytest.approx(GAIT.stair_rise_m, abs=0.01)
    assert [ankle[0] for ankle in last.ankles] == pytest.approx([GAIT.stair_tread_m] * 2, abs=0.03)
    hips = [pose.hip[1] for pose, _ in poses]
    assert max(abs(b - a) for a, b in pairwise(hips)) < 0.03, "the body never jumps"


def view(pose: Pose, ghost: Pose | None = None, torque: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)) -> View:
    return View(body=BODY, pose=pose, ghost=ghost, scene=scene_of(Action.STAIR_UP, PATIENT), torque=torque)


def test_a_leg_that_carries_and_one_that_does_not_differ_by_shape_and_name() -> None:
    pose = next(pose for pose, _ in walked(Action.STAIR_UP) if pose.carries == (True, False))
    lines = draw(view(pose), 60, 20)
    names = {text.strip(): style for text, style in lines[-1] if text.strip() in {"L", "R"}}
    assert "reverse" in names["L"]
    assert "reverse" not in names["R"]
    full = [text.count("⣿") for line in lines for text, style in line if style == LIVE]
    assert sum(full) > 3, "three dots thick"


def test_the_ghost_shows_where_the_legs_are_going() -> None:
    poses = walked(Action.STAIR_UP)
    lines = draw(view(poses[0][0], ghost=poses[len(poses) // 2][0]), 60, 20)
    assert any(style == GHOST and text.strip() for line in lines for text, style in line)


def test_torque_is_a_shape_before_it_is_a_colour() -> None:
    pose = next(pose for pose, _ in walked(Action.STAIR_UP) if not pose.carries[RIGHT])
    text = "".join(text for line in draw(view(pose, torque=(0.1, 0.5, 0.1, 0.9)), 60, 24) for text, _ in line)
    assert [text.count(mark) for mark in "○◐●"] == [1, 1, 1]


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 120), st.integers(0, 60), st.integers(0, FRAMES - 1))
def test_it_fits_into_any_panel(columns: int, rows: int, frame: int) -> None:
    poses = climbed()
    lines = draw(view(poses[frame % len(poses)][0]), columns, rows)
    assert len(lines) in {0, rows}
    assert all(sum(cells(text) for text, _ in line) <= columns for line in lines)


@cache
def climbed() -> list[tuple[Pose, Stance]]:
    """A stair, once."""
    return walked(Action.STAIR_UP)


def test_a_wide_letter_never_reaches_over_the_edge() -> None:
    canvas = Canvas(5, 1)
    canvas.text(0, 0, "左腿前")
    assert "".join(text for text, _ in canvas.lines()[0]) == "左腿 "
