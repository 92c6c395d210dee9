"""The guard, densely at every boundary: just inside passes, just outside is refused by name."""

from __future__ import annotations

from dataclasses import replace
from math import inf, nan, nextafter, radians

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hal.errors import DeviceFault
from hal.joints.device import JointDevice, load_exoskeleton
from hal.joints.guard import ENGAGE_RAD, Guard, Quantity, Refusal, limits_of
from hal.joints.protocol import Joint, JointArray, JointCommand
from tests.support.errors import refused

DEVICE = load_exoskeleton()
LIMITS = limits_of(DEVICE)
GUARD = Guard(LIMITS)
ZERO = np.zeros(4)
NOWHERE = np.full(4, nan)
NEUTRAL = JointCommand(
    position_rad=ZERO, velocity_rad_s=ZERO, stiffness_nm_rad=ZERO, damping_nm_s_rad=ZERO, torque_nm=ZERO
)
STIFF = replace(NEUTRAL, stiffness_nm_rad=np.full(4, 200.0), damping_nm_s_rad=np.full(4, 3.0))
BENT = replace(STIFF, position_rad=np.full(4, 0.4), torque_nm=np.full(4, 10.0))
FIELDS = ("position_rad", "velocity_rad_s", "stiffness_nm_rad", "damping_nm_s_rad", "torque_nm")
EPSILON = 1e-6
BELOW_ZERO = -EPSILON


def put(command: JointCommand, field: str, joint: int, value: float) -> JointCommand:
    """The command with one number changed."""
    values: JointArray = getattr(command, field).copy()
    values[joint] = value
    changes = {field: values}
    return replace(command, **changes)


def check(command: JointCommand, previous: JointCommand | None = STIFF, measured: JointArray = ZERO) -> Refusal | None:
    """Against the guard of the built-in device."""
    return GUARD.check(command, previous, measured)


@pytest.mark.parametrize("joint", Joint)
@pytest.mark.parametrize("field", FIELDS)
@pytest.mark.parametrize("value", [nan, inf, -inf])
@pytest.mark.parametrize("previous", [None, NEUTRAL, STIFF])
def test_what_is_no_number_is_refused_wherever_it_stands(
    joint: Joint, field: str, value: float, previous: JointCommand | None
) -> None:
    refusal = check(put(STIFF, field, joint, value), previous)
    assert refusal is not None
    assert (refusal.joint, refusal.quantity) == (joint, Quantity.NOT_FINITE)
    assert repr(refusal.value) == repr(value)


@pytest.mark.parametrize("field", FIELDS)
@pytest.mark.parametrize("shape", [(), (3,), (5,), (4, 1), (0,)])
def test_anything_but_four_numbers_is_refused(field: str, shape: tuple[int, ...]) -> None:
    changes = {field: np.zeros(shape)}
    refusal = check(replace(NEUTRAL, **changes))
    assert refusal is not None
    assert refusal.quantity is Quantity.SHAPE
    assert (refusal.value, refusal.limit) == (float(np.zeros(shape).size), 4.0)


# field, quantity, limit, the sign of what lies outside; each with a previous command that makes no step of it
ABSOLUTE = [
    ("position_rad", Quantity.POSITION, LIMITS.high_rad, +1),
    ("position_rad", Quantity.POSITION, LIMITS.low_rad, -1),
    ("velocity_rad_s", Quantity.SPEED, LIMITS.speed_rad_s, +1),
    ("velocity_rad_s", Quantity.SPEED, -LIMITS.speed_rad_s, -1),
    ("torque_nm", Quantity.TORQUE, LIMITS.torque_nm, +1),
    ("torque_nm", Quantity.TORQUE, -LIMITS.torque_nm, -1),
    ("stiffness_nm_rad", Quantity.STIFFNESS, LIMITS.stiffness_nm_rad, +1),
    ("stiffness_nm_rad", Quantity.STIFFNESS, ZERO, -1),
    ("damping_nm_s_rad", Quantity.DAMPING, LIMITS.damping_nm_s_rad, +1),
    ("damping_nm_s_rad", Quantity.DAMPING, ZERO, -1),
]
MAGNITUDES = {Quantity.SPEED, Quantity.TORQUE}  # reported without their sign


@pytest.mark.parametrize("joint", Joint)
@pytest.mark.parametrize(("field", "quantity", "limit", "sign"), ABSOLUTE)
def test_every_absolute_limit_at_its_boundary(
    joint: Joint, field: str, quantity: Quantity, limit: JointArray, sign: int
) -> None:
    at_limit = put(STIFF, field, joint, float(limit[joint]))
    assert check(at_limit, at_limit) is None
    assert check(put(STIFF, field, joint, float(limit[joint]) - sign * EPSILON), at_limit) is None
    outside = put(STIFF, field, joint, float(limit[joint]) + sign * EPSILON)
    refusal = check(outside, outside)
    assert refusal is not None
    assert (refusal.joint, refusal.quantity) == (joint, quantity)
    assert refusal.limit == pytest.approx(abs(limit[joint]) if quantity is not Quantity.POSITION else limit[joint])
    assert repr(refusal.limit) != "-0.0", "nobody reads a minus zero"
    value = float(limit[joint]) + sign * EPSILON
    assert refusal.value == pytest.approx(abs(value) if quantity in MAGNITUDES else value)


def test_of_several_reasons_the_first_is_reported() -> None:
    beyond = replace(STIFF, position_rad=LIMITS.high_rad + 1.0, torque_nm=LIMITS.torque_nm + 1.0)
    refusal = check(beyond, beyond)
    assert refusal is not None
    assert (refusal.joint, refusal.quantity) == (Joint.LEFT_HIP, Quantity.POSITION)


STEPS = [
    ("position_rad", Quantity.POSITION_STEP, LIMITS.speed_rad_s * 0.002),
    ("torque_nm", Quantity.TORQUE_STEP, LIMITS.torque_nm * 0.04),
    ("stiffness_nm_rad", Quantity.STIFFNESS_STEP, LIMITS.stiffness_nm_rad * 0.04),
]


@pytest.mark.parametrize("joint", Joint)
@pytest.mark.parametrize("sign", [+1, -1])
@pytest.mark.parametrize(("field", "quantity", "limit"), STEPS)
def test_every_change_in_a_tick_at_its_boundary(
    joint: Joint, sign: int, field: str, quantity: Quantity, limit: JointArray
) -> None:
    base = float(getattr(BENT, field)[joint])
    step = float(limit[joint])
    assert check(put(BENT, field, joint, base + sign * (step - EPSILON)), BENT) is None
    refusal = check(put(BENT, field, joint, base + sign * (step + EPSILON)), BENT)
    assert refusal is not None
    assert (refusal.joint, refusal.quantity) == (joint, quantity)
    assert refusal.value == pytest.approx(step + EPSILON)
    assert refusal.limit == pytest.approx(step)


@pytest.mark.parametrize("joint", Joint)
def test_a_slack_joint_is_given_no_position_so_it_may_change(joint: Joint) -> None:
    far = put(NEUTRAL, "position_rad", joint, 0.5)
    assert check(far, NEUTRAL) is None


@pytest.mark.parametrize("joint", Joint)
@pytest.mark.parametrize("sign", [+1, -1])
def test_a_slack_joint_is_gripped_only_where_it_is(joint: Joint, sign: int) -> None:
    grip = put(put(NEUTRAL, "stiffness_nm_rad", joint, 0.01), "position_rad", joint, 0.4)
    measured = ZERO.copy()
    measured[joint] = 0.4 + sign * (ENGAGE_RAD - EPSILON)
    assert check(grip, NEUTRAL, measured) is None
    measured[joint] = 0.4 + sign * (ENGAGE_RAD + EPSILON)
    refusal = check(grip, NEUTRAL, measured)
    assert refusal is not None
    assert (refusal.joint, refusal.quantity) == (joint, Quantity.ENGAGEMENT)
    assert refusal.limit == pytest.approx(ENGAGE_RAD)
    assert check(grip, NEUTRAL, NOWHERE) is not None, "where nobody knows the angle nothing is gripped"


@pytest.mark.parametrize("joint", Joint)
def test_a_joint_held_ever_so_softly_may_not_leap(joint: Joint) -> None:
    soft = put(NEUTRAL, "stiffness_nm_rad", joint, 0.01)
    refusal = check(put(soft, "position_rad", joint, 0.1), soft)
    assert refusal is not None
    assert (refusal.joint, refusal.quantity) == (joint, Quantity.POSITION_STEP)


@pytest.mark.parametrize("joint", Joint)
def test_a_joint_that_is_held_already_may_be_anywhere_and_its_neighbours_too(joint: Joint) -> None:
    measured = ZERO.copy()
    measured[joint] = 0.4
    assert check(STIFF, STIFF, measured) is None
    assert check(NEUTRAL, NEUTRAL, measured) is None


@pytest.mark.parametrize("joint", Joint)
@pytest.mark.parametrize(
    ("field", "quantity"),
    [("stiffness_nm_rad", Quantity.STIFFNESS_STEP), ("torque_nm", Quantity.TORQUE_STEP)],
)
def test_the_first_command_carries_nothing(joint: Joint, field: str, quantity: Quantity) -> None:
    assert check(NEUTRAL, None, NOWHERE) is None
    assert check(put(NEUTRAL, "damping_nm_s_rad", joint, 4.0), None, NOWHERE) is None
    for value in (0.01, 20.0):
        refusal = check(put(NEUTRAL, field, joint, value), None)
        assert refusal is not None
        assert (refusal.joint, refusal.quantity) == (joint, quantity)
    if field == "torque_nm":
        assert check(put(NEUTRAL, field, joint, -0.01), None) is not None


def test_rounding_is_no_reason_to_refuse() -> None:
    limit = float(LIMITS.torque_nm[0])
    over = put(STIFF, "torque_nm", 0, nextafter(limit, inf))
    assert check(over, over) is None


@given(
    position=st.floats(-0.5, 2.0),
    speed=st.floats(-4, 4),
    stiffness=st.floats(0, 500),
    damping=st.floats(0, 5),
    torque=st.floats(-110, 110),
)
def test_what_passed_once_passes_again_at_rest(
    position: float, speed: float, stiffness: float, damping: float, torque: float
) -> None:
    """The loop writes the last good command without its speed after a refusal: that must always pass."""
    command = JointCommand(
        position_rad=np.full(4, position).clip(LIMITS.low_rad, LIMITS.high_rad),
        velocity_rad_s=np.full(4, speed),
        stiffness_nm_rad=np.full(4, stiffness),
        damping_nm_s_rad=np.full(4, damping),
        torque_nm=np.full(4, torque),
    )
    at_rest = replace(command, velocity_rad_s=ZERO)
    assert check(at_rest, command, NOWHERE) is None


def test_a_refusal_carries_its_numbers_and_only_finite_ones() -> None:
    refusal = Refusal(joint=Joint.RIGHT_KNEE, quantity=Quantity.SPEED, value=6.0, limit=5.2)
    assert (refusal.code, refusal.values) == (
        Quantity.SPEED,
        {"joint": Joint.RIGHT_KNEE, "value": 6.0, "limit": 5.2},
    )
    unknown = Refusal(joint=Joint.RIGHT_KNEE, quantity=Quantity.NOT_FINITE, value=nan, limit=inf)
    assert unknown.values == {"joint": Joint.RIGHT_KNEE}


def test_limits_are_the_devices() -> None:
    assert LIMITS.low_rad == pytest.approx(np.radians([-30, -5, -30, -5]))
    assert LIMITS.high_rad == pytest.approx(np.radians([120, 120, 120, 120]))
    assert LIMITS.speed_rad_s == pytest.approx(np.radians([240, 300, 240, 300]))
    assert LIMITS.torque_nm.tolist() == [110.0] * 4
    assert LIMITS.stiffness_nm_rad.tolist() == [500.0] * 4
    assert LIMITS.damping_nm_s_rad.tolist() == [5.0] * 4


def test_the_patients_narrower_range_holds() -> None:
    limits = limits_of(DEVICE, hip_max_rad=1.0, knee_max_rad=1.5)
    assert limits.high_rad.tolist() == [1.0, 1.5, 1.0, 1.5]
    assert limits_of(DEVICE, knee_max_rad=1.5).high_rad == pytest.approx([radians(120), 1.5, radians(120), 1.5])
    at_most = put(STIFF, "position_rad", Joint.LEFT_HIP, 1.0 + EPSILON)
    refusal = Guard(limits).check(at_most, at_most, ZERO)
    assert refusal is not None
    assert refusal.quantity is Quantity.POSITION


@pytest.mark.parametrize(
    ("hip", "knee", "named"),
    [
        (2.2, None, Joint.LEFT_HIP),
        (None, 2.2, Joint.LEFT_KNEE),
        (2.1, 2.3, Joint.LEFT_KNEE),
        (1.0, 2.2, Joint.LEFT_KNEE),
    ],
)
def test_a_limit_that_loosens_the_devices_is_refused(hip: float | None, knee: float | None, named: Joint) -> None:
    with refused(DeviceFault.LIMIT_LOOSENED, joint=named, limit_rad=radians(120)):
        limits_of(DEVICE, hip_max_rad=hip, knee_max_rad=knee)


def test_the_patients_limit_may_equal_the_devices() -> None:
    assert (
        limits_of(DEVICE, hip_max_rad=radians(120), knee_max_rad=radians(120)).high_rad.tolist() == [radians(120)] * 4
    )


def test_limits_differ_joint_by_joint() -> None:
    """A guard that took one joint's limit for all would not be noticed with four equal drives."""
    weak = msgspec.structs.replace(
        DEVICE,
        left_knee=msgspec.structs.replace(DEVICE.left_knee, max_torque_nm=50.0, max_deg=100.0),
        right_hip=msgspec.structs.replace(DEVICE.right_hip, max_speed_deg_s=60.0, min_deg=-10.0),
    )
    guard = Guard(limits_of(weak))
    for joint, field, inside, outside in (
        (Joint.LEFT_KNEE, "torque_nm", 50.0, 50.1),
        (Joint.LEFT_KNEE, "position_rad", radians(100), radians(100.1)),
        (Joint.RIGHT_HIP, "velocity_rad_s", radians(60), radians(60.1)),
        (Joint.RIGHT_HIP, "position_rad", radians(-10), radians(-10.1)),
    ):
        good, bad = put(STIFF, field, joint, inside), put(STIFF, field, joint, outside)
        assert guard.check(good, good, ZERO) is None
        refusal = guard.check(bad, bad, ZERO)
        assert refusal is not None
        assert refusal.joint is joint


def test_the_joint_that_goes_farthest_beyond_is_named() -> None:
    stiff_hip = msgspec.structs.replace(
        DEVICE,
        left_hip=msgspec.structs.replace(DEVICE.left_hip, max_deg=60.0),
        right_hip=msgspec.structs.replace(DEVICE.right_hip, max_deg=60.0),
    )
    with refused(DeviceFault.LIMIT_LOOSENED, joint=Joint.LEFT_HIP, limit_rad=radians(60)):
        limits_of(stiff_hip, hip_max_rad=1.5, knee_max_rad=2.2)
    with refused(DeviceFault.LIMIT_LOOSENED, joint=Joint.LEFT_KNEE):  # by more, though by a smaller part
        limits_of(stiff_hip, hip_max_rad=1.2, knee_max_rad=2.29)


def test_the_numbers_that_the_document_states() -> None:
    assert radians(3.0) == ENGAGE_RAD
    assert LIMITS.position_step_rad == pytest.approx(LIMITS.speed_rad_s / 500)
    assert LIMITS.stiffness_step_nm_rad == pytest.approx(LIMITS.stiffness_nm_rad / 25)
    assert LIMITS.torque_step_nm == pytest.approx(LIMITS.torque_nm / 25)


@pytest.mark.parametrize("changes", [{"damp_nm_s_rad": 5.1}, {"min_deg": 0.1}, {"min_deg": -30.0, "max_deg": -0.1}])
def test_a_joint_whose_damping_or_neutral_command_the_guard_would_refuse_is_not_read(changes: dict[str, float]) -> None:
    described = msgspec.to_builtins(DEVICE.left_hip)
    edge = {name: round(value, 0) for name, value in changes.items()}
    msgspec.convert(described | edge, JointDevice)
    with pytest.raises(msgspec.ValidationError):
        msgspec.convert(described | changes, JointDevice)
