"""Plans: every action at every corner of stature and mass, smooth, within limits, from the measured pose on."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import pairwise, product

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.control.gait.table import TABLE
from app.control.running_action import VISIBLE_RAD
from app.ipc.states import Action, GaitState
from app.motion.plan import Patient, Phase, Plan, PlanFault, PlanRequest, decode_table, encode_array, patient_of
from app.motion.plan_check import check_path
from app.motion.rehearsal import STARTS, WALK_PHASES
from app.motion.trajectory import FAR_RAD, RECIPES, nominal_pose, plan
from app.motion.transfer import recovery_path
from app.text.catalogue import render
from hal.joints.device import load_exoskeleton
from hal.joints.guard import ENGAGE_RAD
from hal.joints.protocol import TICK_HZ, Joint
from logs.reason import Reason, key_of, reason
from profiles.schema import GaitParameters, Profile, Sex

DEVICE = load_exoskeleton()
CORNERS = tuple(product((1.45, 1.95), (45.0, 110.0)))


@cache
def patient(stature_m: float = 1.7, mass_kg: float = 65.0) -> Patient:
    return patient_of(Profile(identifier="p", sex=Sex.FEMALE, stature_m=stature_m, mass_kg=mass_kg), DEVICE)


def with_gait(**changes: float) -> Patient:
    gait = msgspec.structs.replace(GaitParameters(), **changes)
    return patient_of(Profile(identifier="p", sex=Sex.FEMALE, stature_m=1.7, mass_kg=65.0, gait=gait), DEVICE)


def ask(
    who: Patient,
    action: Action,
    phase: Phase = Phase.WHOLE,
    start: np.ndarray | None = None,
    state: GaitState | None = None,
) -> Plan:
    state = state or STARTS.get(action, GaitState.STANDING)
    pose = nominal_pose(state, who) if start is None else start
    quad = (float(pose[0]), float(pose[1]), float(pose[2]), float(pose[3]))
    return plan(PlanRequest(number=7, action=action, phase=phase, from_state=state, start_rad=quad), who)


def test_each_transition_of_the_gait_has_its_movement_there_and_its_start() -> None:
    transitions = [row for row in TABLE if row.action is not Action.INITIALISE]  # which has a plan of its own
    movements = {key: recipe.to_state for key, recipe in RECIPES.items()}
    assert movements == {(row.action, row.phase): row.to for row in transitions}, (
        "RECIPES in app/motion/trajectory.py, TABLE in app/control/gait/table.py"
    )
    begun = [row for row in transitions if row.phase is Phase.WHOLE]
    assert [STARTS.get(row.action, GaitState.STANDING) for row in begun] == [row.source for row in begun], (
        "STARTS in app/motion/rehearsal.py"
    )


@pytest.mark.parametrize(("stature", "mass"), CORNERS)
@pytest.mark.parametrize(("action", "phase"), list(RECIPES))
def test_every_movement_can_be_planned_at_every_corner(
    stature: float, mass: float, action: Action, phase: Phase
) -> None:
    who = patient(stature, mass)
    made = ask(who, action, phase)
    assert made.check.ok, made.check.reason
    assert (made.position_rad <= who.high_rad).all()
    assert (made.position_rad >= who.low_rad).all()
    assert (np.abs(made.velocity_rad_s) <= who.speed_rad_s).all()
    assert (np.abs(made.torque_nm) <= who.torque_nm).all()
    assert made.check.min_clearance_m >= 0.02


@pytest.mark.parametrize(("action", "phase"), list(RECIPES))
def test_position_velocity_and_acceleration_are_continuous(action: Action, phase: Phase) -> None:
    made = ask(patient(), action, phase)
    acceleration = np.diff(made.position_rad, 2, axis=0) * TICK_HZ**2
    assert (
        np.abs(made.velocity_rad_s[1:-1] - (made.position_rad[2:] - made.position_rad[:-2]) * TICK_HZ / 2).max() < 1e-9
    )
    change = np.abs(np.diff(acceleration, axis=0)).max()
    assert change < 0.15 * np.abs(acceleration).max()  # from tick to tick; a corner in the speed would change it by all


def test_the_steps_of_a_walk_join_without_a_jump() -> None:
    plans = [ask(patient(), action, phase) for action, phase in WALK_PHASES]
    for before, after in pairwise(plans):
        assert np.abs(before.position_rad[-1] - after.position_rad[0]).max() < np.radians(0.05)
        assert np.abs(before.velocity_rad_s[-1] - after.velocity_rad_s[0]).max() < np.radians(3)
        assert before.to_state is not after.to_state


def test_a_walking_leg_swings_as_peoples_do() -> None:
    """Over the right leg's cycle from landing to landing, as normative curves show it at any speed."""
    halves = [ask(patient(), Action.WALK, phase) for phase in (Phase.WALK_LEFT, Phase.WALK_RIGHT)]
    hip, knee = np.concatenate([half.position_rad[:-1, 2:] for half in halves]).T
    percent = np.linspace(0, 100, len(hip))
    assert 45 < percent[hip.argmin()] < 62, "the hip is stretched most as the other foot has landed"
    assert 70 < percent[knee.argmax()] < percent[hip.argmax()] < 95, "the knee bends first, then the hip"
    assert hip[0] > 0.6 * hip.max(), "the hip is still flexed as the foot lands"


@pytest.mark.parametrize(("stature", "mass"), CORNERS)
@pytest.mark.parametrize("action", [a for a, phase in RECIPES if phase is Phase.WHOLE] + [Action.WALK])
def test_a_joint_is_seen_to_turn_within_a_fifth_of_a_second(stature: float, mass: float, action: Action) -> None:
    phase = Phase.WALK_START if action is Action.WALK else Phase.WHOLE
    path = ask(patient(stature, mass), action, phase).position_rad
    turned = np.abs(path[: round(0.2 * TICK_HZ)] - path[0]).max()
    assert turned >= VISIBLE_RAD


@pytest.mark.parametrize("action", [action for action, phase in RECIPES if phase is Phase.WHOLE])
def test_a_movement_begins_at_rest_and_ends_at_rest_in_its_states_pose(action: Action) -> None:
    made = ask(patient(), action)
    assert np.abs(made.velocity_rad_s[[0, -1]]).max() < np.radians(1)
    assert np.abs(made.position_rad[-1] - nominal_pose(made.to_state, patient())).max() < np.radians(1)


offsets = st.lists(st.floats(-np.degrees(FAR_RAD) + 1, np.degrees(FAR_RAD) - 1), min_size=4, max_size=4)


@settings(max_examples=25, deadline=None)
@given(offsets)
def test_a_movement_starts_at_the_measured_pose(degrees: list[float]) -> None:
    start = np.maximum(nominal_pose(GaitState.STANDING, patient()) + np.radians(degrees), np.radians(-3))
    made = ask(patient(), Action.STEP_RIGHT_FIRST, start=start)
    assert np.allclose(made.position_rad[0], start)


def test_too_far_from_the_states_pose_is_refused_with_the_angle() -> None:
    start = nominal_pose(GaitState.STANDING, patient()) + np.array([0.0, 0.5, 0.0, 0.0])
    made = ask(patient(), Action.STEP_RIGHT_FIRST, start=start)
    assert made.check.reason is not None
    assert made.check.reason.code == key_of(PlanFault.TOO_FAR_FROM_STATE)
    assert made.check.reason.values["angle_rad"] == pytest.approx(0.5)


@settings(max_examples=25, deadline=None)
@given(st.floats(-10, 90), st.floats(3, 95), st.floats(-10, 90), st.floats(3, 95))
def test_initialise_goes_slowly_from_any_pose_to_standing_or_reports_why_not(
    left_hip: float, left_knee: float, right_hip: float, right_knee: float
) -> None:
    start = np.radians([left_hip, left_knee, right_hip, right_knee])
    made = ask(patient(), Action.INITIALISE, start=start, state=GaitState.BETWEEN)
    if not made.check.ok:
        return
    assert np.allclose(made.position_rad[0], start)
    assert np.abs(made.position_rad[-1] - nominal_pose(GaitState.STANDING, patient())).max() < np.radians(1)
    assert made.duration_s >= 3.0


@pytest.mark.parametrize("beyond_deg", [0.0, 0.05])
def test_a_knee_that_leans_on_its_end_stop_is_led_from_there(beyond_deg: float) -> None:
    low_rad = np.radians([joint.min_deg for joint in DEVICE.joints])[1]
    start = np.array([0.0, low_rad - np.radians(beyond_deg), 0.1, 0.2])
    made = ask(patient(), Action.INITIALISE, start=start, state=GaitState.UNPOWERED)
    assert made.check.ok, made.check.reason
    assert np.abs(made.position_rad[0] - start).max() <= ENGAGE_RAD
    assert made.position_rad[:, 1].min() >= low_rad


def test_a_knee_far_beyond_its_range_is_refused() -> None:
    made = ask(patient(), Action.INITIALISE, start=np.radians([0.0, -9.0, 0.0, 10.0]), state=GaitState.UNPOWERED)
    assert made.check.reason is not None
    assert made.check.reason.code == key_of(PlanFault.BEYOND_EXTENSION)


def test_initialise_rises_from_the_chair() -> None:
    made = ask(
        patient(), Action.INITIALISE, start=nominal_pose(GaitState.SITTING, patient()), state=GaitState.UNPOWERED
    )
    assert made.check.ok, made.check.reason


@pytest.mark.parametrize(
    ("changes", "action", "fault"),
    [
        ({"stair_rise_m": 0.25, "body_weight_support": 0.0}, Action.STAIR_UP, PlanFault.TOO_MUCH_TORQUE),
        ({"obstacle_depth_m": 0.4, "body_weight_support": 0.0}, Action.OBSTACLE, PlanFault.TOO_MUCH_TORQUE),
        ({"step_length_m": 0.8, "body_weight_support": 0.0}, Action.STEP_LEFT, None),
    ],
)
def test_what_the_leg_cannot_do_is_refused_with_a_code(
    changes: dict[str, float], action: Action, fault: PlanFault | None
) -> None:
    made = ask(with_gait(**changes), action)
    assert made.check.reason is not None
    assert fault is None or made.check.reason.code == key_of(fault)
    assert render(made.check.reason)
    assert len(made.position_rad) == 1


def test_a_faster_gait_than_the_joints_is_slowed_down() -> None:
    hasty = with_gait(step_time_s=0.8)
    made = ask(hasty, Action.OBSTACLE)
    assert made.check.ok, made.check.reason
    assert (np.abs(made.velocity_rad_s) <= hasty.speed_rad_s).all()


def test_a_patients_narrower_knee_refuses_the_chair() -> None:
    narrow = replace(patient(), high_rad=np.radians([100.0, 60.0, 100.0, 60.0]))
    made = ask(narrow, Action.SIT_DOWN)
    assert made.check.reason is not None
    assert made.check.reason.code == key_of(PlanFault.BEYOND_FLEXION)
    assert made.check.reason.values["joint"] == Reason("Joint.LEFT_KNEE")
    assert made.check.reason.values["limit_rad"] == pytest.approx(np.radians(60))


@pytest.mark.parametrize("joint", Joint)
@pytest.mark.parametrize(
    "fault",
    [PlanFault.TOO_FAST, PlanFault.TOO_MUCH_TORQUE, PlanFault.BEYOND_FLEXION, PlanFault.BEYOND_EXTENSION],
)
def test_each_limit_of_each_joint_refuses_a_path_that_passes_it(joint: Joint, fault: PlanFault) -> None:
    """Whatever the plan was slowed down by before."""
    who, still = patient(), np.zeros((1, 4))
    path = recovery_path(who, nominal_pose(GaitState.STANDING, who) + 0.1, 1.0)
    lowest, highest = path.joints_rad.min(axis=0), path.joints_rad.max(axis=0)
    at_limits = replace(who, low_rad=lowest, high_rad=highest)
    assert check_path(at_limits, path, still + who.speed_rad_s, still - who.torque_nm).ok
    beyond = 1e-3 * (np.arange(4) == joint)
    speed_rad_s = who.speed_rad_s + beyond * (fault is PlanFault.TOO_FAST)
    torque_nm = who.torque_nm + beyond * (fault is PlanFault.TOO_MUCH_TORQUE)
    narrow = replace(
        who,
        low_rad=lowest + beyond * (fault is PlanFault.BEYOND_EXTENSION),
        high_rad=highest - beyond * (fault is PlanFault.BEYOND_FLEXION),
    )
    why = check_path(narrow, path, still - speed_rad_s, still + torque_nm).reason
    assert why is not None
    assert (why.code, why.values["joint"]) == (key_of(fault), reason(joint))


def test_a_patient_moves_inside_the_narrower_of_both_ranges() -> None:
    own = Profile(identifier="p", sex=Sex.FEMALE, stature_m=1.7, mass_kg=65.0, hip_max_rad=0.9, shank_length_m=0.41)
    who = patient_of(own, DEVICE)
    low_deg, high_deg = (np.array([getattr(one, end) for one in DEVICE.joints]) for end in ("min_deg", "max_deg"))
    assert np.degrees(who.low_rad) == pytest.approx(low_deg + 1.0)
    assert np.degrees(who.high_rad[1::2]) == pytest.approx(high_deg[1::2] - 1.0)
    assert who.high_rad[::2] == pytest.approx(0.9 - np.radians(1.0))
    assert (who.body.shank_m, who.body.thigh_m) == (0.41, patient().body.thigh_m)


def encoded(message: object) -> bytes:
    return msgspec.msgpack.encode(message, enc_hook=encode_array)


def test_plans_and_requests_survive_the_link() -> None:
    made = ask(patient(), Action.SIT_DOWN)
    back = msgspec.msgpack.decode(encoded(made), type=Plan, dec_hook=decode_table)
    assert np.array_equal(back.position_rad, made.position_rad)
    assert np.array_equal(back.torque_nm, made.torque_nm)
    assert back.check == made.check
    request = PlanRequest(
        number=3,
        action=Action.WALK,
        phase=Phase.WALK_START,
        from_state=GaitState.STANDING,
        start_rad=(0.0, 0.1, 0.2, 0.3),
    )
    assert msgspec.msgpack.decode(encoded(request), type=PlanRequest) == request


def test_a_plan_whose_tables_do_not_fit_is_refused_on_arrival() -> None:
    made = msgspec.msgpack.decode(encoded(ask(patient(), Action.SIT_DOWN)))
    for torque in (made["torque_nm"][:-32], b"1234"):
        with pytest.raises(msgspec.ValidationError):
            msgspec.msgpack.decode(encoded({**made, "torque_nm": torque}), type=Plan, dec_hook=decode_table)
