"""The trajectory follower: from a plan and an effect to one tick's joint command, never with a jump.

Every ramp starts from the last *command*: feedback lags and is noisy, and a stop that starts from it drops the limb.
The one exception is stiffening a damped joint, which starts from its measured angle.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from enum import Enum

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from app.motion.plan import Plan
from hal.joints.device import Exoskeleton, Joint
from hal.joints.guard import limits_of
from hal.joints.protocol import TICK_HZ, JointArray, JointCommand
from hal.minimum_jerk import minimum_jerk, minimum_jerk_rate

HOLD_S = 0.150  # slow down along the path within this; a pause comes back as slowly
STIFFNESS_RAMP_S = 0.3  # from damped to full stiffness
DAMPING_RAMP_S = 0.3  # from the last command to pure damping
FADE_S = 0.5  # a plan starts from the measured pose, the command from the last one: the difference fades
TORQUE_SLEW_NM = 1.0  # per tick, at most; the feed-forward never steps


STIFFNESS_SHARE = 0.8  # of the device's greatest; the rest is the guard's margin
DAMPING_SHARE = 0.9


@dataclass(frozen=True, slots=True, kw_only=True)
class Gains:
    """The impedance of held and of damped joints, each (4,), SI at the joint."""

    stiffness_nm_rad: JointArray
    damping_nm_s_rad: JointArray
    damped_nm_s_rad: JointArray  # in DAMPED, where damping acts alone
    assist: JointArray  # share of the feed-forward torque, the weak side's scale
    torque_slew_nm: JointArray  # how much the feed-forward torque may change in a tick


def gains_of(device: Exoskeleton, assist_left: float, assist_right: float) -> Gains:
    """Gains from the device's limits; the weak side's assist scales its stiffness and feed-forward torque."""
    assist = np.array([assist_left, assist_left, assist_right, assist_right])
    stiffest = np.array([joint.max_stiffness_nm_rad for joint in device.joints])
    most_damped = np.array([joint.max_damping_nm_s_rad for joint in device.joints])
    return Gains(
        stiffness_nm_rad=STIFFNESS_SHARE * stiffest * assist,
        damping_nm_s_rad=DAMPING_SHARE * most_damped,
        damped_nm_s_rad=np.array([joint.damp_nm_s_rad for joint in device.joints]),
        assist=assist,
        torque_slew_nm=np.minimum(TORQUE_SLEW_NM, limits_of(device).torque_step_nm),
    )


class Mode(Enum):
    """What the joint commands do."""

    DISABLED = "disabled"  # neutral commands; drives off or just enabled
    STIFFENING = "stiffening"  # the stiffness ramps up about the measured angles
    HOLDING = "holding"  # stiff at the last command
    MOVING = "moving"  # along a plan
    DAMPED = "damped"  # ramping to pure damping, then pure damping


_ZERO = np.zeros(4)
NEUTRAL = JointCommand(
    position_rad=_ZERO, velocity_rad_s=_ZERO, stiffness_nm_rad=_ZERO, damping_nm_s_rad=_ZERO, torque_nm=_ZERO
)


class Motion(Struct, frozen=True, kw_only=True):
    """The follower's state: the last command, and what the next one is computed from."""

    mode: Mode = Mode.DISABLED
    command: JointCommand = NEUTRAL
    plan: Plan | None = None
    onward: Plan | None = None  # of a walk that was stopped: the step that it slows down along when its plan ends
    row: float = 0.0  # position in the plan
    path_rate: float = 1.0  # rows a tick; a hold or a pause ramps it to 0, the end of a pause back to 1
    offset_rad: JointArray = _ZERO  # of the command from the plan at its start
    ramp: float = 0.0  # of stiffening or damping, 0 to 1
    origin: JointCommand = NEUTRAL  # the command at which the damping ramp started

    @property
    def progress(self) -> float:
        """Of the running plan, 0 to 1."""
        return 0.0 if self.plan is None else min(1.0, self.row / (len(self.plan.position_rad) - 1))

    @property
    def rows_left(self) -> float:
        """Of the running plan."""
        return 0.0 if self.plan is None else len(self.plan.position_rad) - 1 - self.row

    @property
    def arrived(self) -> bool:
        """The plan's last row is the command."""
        return self.mode is Mode.MOVING and self.rows_left <= 0

    @property
    def settled(self) -> bool:
        """The command does not change any more."""
        return self.mode in {Mode.DISABLED, Mode.HOLDING} or self.fully_damped

    @property
    def fully_damped(self) -> bool:
        """The damping ramp has ended."""
        return self.mode is Mode.DAMPED and self.ramp >= 1

    @property
    def halted(self) -> bool:
        """A hold has stopped the movement on its path."""
        return self.mode is Mode.MOVING and self.path_rate <= 0


def disable(motion: Motion) -> Motion:
    """Neutral commands."""
    return motion if motion.mode is Mode.DISABLED else Motion()


def start_stiffening(measured_rad: JointArray, gains: Gains) -> Motion:
    """Start to hold damped or disabled joints at their measured angles, (4,) radians."""
    command = dataclasses.replace(NEUTRAL, position_rad=measured_rad, damping_nm_s_rad=gains.damped_nm_s_rad)
    return Motion(mode=Mode.STIFFENING, command=command)


def start_plan(motion: Motion, plan: Plan) -> Motion:
    """Start to follow a plan, from holding or, at the pace that there is, from the end of the plan before."""
    return replace(
        motion,
        mode=Mode.MOVING,
        plan=plan,
        onward=None,
        row=0.0,
        path_rate=motion.path_rate if motion.mode is Mode.MOVING else 1.0,
        offset_rad=motion.command.position_rad - plan.position_rad[0],
    )


def hold(motion: Motion) -> Motion:
    """Hold at the last command."""
    command = dataclasses.replace(motion.command, velocity_rad_s=_ZERO)
    return replace(motion, mode=Mode.HOLDING, plan=None, onward=None, command=command)


def resume_from(motion: Motion, written: JointCommand) -> Motion:
    """After the guard refused a command: hold, or damp anew, from the command that was written.

    Joints that were being stiffened are damped again: without stiffness there is nothing to hold them by.
    """
    if motion.mode is Mode.DISABLED:
        return motion
    if motion.mode in {Mode.DAMPED, Mode.STIFFENING}:
        return replace(motion, mode=Mode.DAMPED, command=written, origin=written, ramp=0.0)
    return hold(replace(motion, command=written))


def ramp_to_damping(motion: Motion, unheld: frozenset[Joint] = frozenset()) -> Motion:
    """Start the damping ramp; no change while it runs, and for disabled joints.

    unheld: joints that are not held any more, whatever was commanded: a ramp of their stiffness would pull them.
    """
    if motion.mode is Mode.DISABLED:
        return motion
    if motion.mode is not Mode.DAMPED:
        motion = Motion(mode=Mode.DAMPED, command=motion.command, origin=motion.command)
    if not unheld:
        return motion
    return replace(
        motion, command=without_stiffness(motion.command, unheld), origin=without_stiffness(motion.origin, unheld)
    )


def start_damped(gains: Gains) -> Motion:
    """Pure damping of joints under neutral commands: there is nothing to ramp down."""
    command = dataclasses.replace(NEUTRAL, damping_nm_s_rad=gains.damped_nm_s_rad)
    return Motion(mode=Mode.DAMPED, command=command, origin=command, ramp=1.0)


def without_stiffness(command: JointCommand, unheld: frozenset[Joint]) -> JointCommand:
    """The command with nothing but damping for these joints."""
    held = np.array([joint not in unheld for joint in Joint])
    return dataclasses.replace(
        command,
        velocity_rad_s=held * command.velocity_rad_s,
        stiffness_nm_rad=held * command.stiffness_nm_rad,
        torque_nm=held * command.torque_nm,
    )


def advance(motion: Motion, gains: Gains, *, hold: bool, missed: int = 0) -> Motion:
    """The next tick's motion and command; with `hold` a movement slows down along its path, else it regains its pace.

    missed: ticks left out before this one, in which the legs slowed down by themselves; with `hold` they count.
    """
    if motion.mode is Mode.MOVING:
        return _moving(motion, gains, -(1 + missed) if hold else 1)
    if motion.mode is Mode.STIFFENING:
        return _ramping_to_stiffness(motion, gains)
    return _ramping_to_damping(motion, gains) if motion.mode is Mode.DAMPED else motion


def _ramping_to_stiffness(motion: Motion, gains: Gains) -> Motion:
    ramp = min(1.0, motion.ramp + 1 / (STIFFNESS_RAMP_S * TICK_HZ))
    start_nm_s_rad = gains.damped_nm_s_rad
    command = dataclasses.replace(
        motion.command,
        stiffness_nm_rad=ramp * gains.stiffness_nm_rad,
        damping_nm_s_rad=start_nm_s_rad + ramp * (gains.damping_nm_s_rad - start_nm_s_rad),
    )
    mode = Mode.HOLDING if ramp >= 1 else Mode.STIFFENING
    return replace(motion, mode=mode, ramp=ramp, command=command)


def _moving(motion: Motion, gains: Gains, slope: int) -> Motion:
    """slope: ticks by which the path's rate goes up, or down where it is negative."""
    rate = min(1.0, max(0.0, motion.path_rate + slope / (HOLD_S * TICK_HZ)))
    row = motion.row + rate
    if motion.onward is not None and rate > motion.rows_left:
        row = rate - motion.rows_left
        motion = _at_end(motion, motion.onward)
    plan = motion.plan
    assert plan is not None
    row = min(row, float(len(plan.position_rad) - 1))
    fade, fade_speed = _fade(row, len(plan.position_rad) - 1)
    command = JointCommand(
        position_rad=_at(plan.position_rad, row) + fade * motion.offset_rad,
        velocity_rad_s=rate * (_at(plan.velocity_rad_s, row) + fade_speed * motion.offset_rad),
        stiffness_nm_rad=gains.stiffness_nm_rad,
        damping_nm_s_rad=gains.damping_nm_s_rad,
        torque_nm=_slewed(motion.command.torque_nm, gains.assist * _at(plan.torque_nm, row), gains.torque_slew_nm),
    )
    return replace(motion, row=row, path_rate=rate, command=command)


def _at_end(motion: Motion, onward: Plan) -> Motion:
    """Where the running plan ends, with the one that goes on from there."""
    assert motion.plan is not None
    end = dataclasses.replace(motion.command, position_rad=motion.plan.position_rad[-1])
    return start_plan(replace(motion, command=end), onward)


def _ramping_to_damping(motion: Motion, gains: Gains) -> Motion:
    if motion.ramp >= 1:
        return motion
    ramp = min(1.0, motion.ramp + 1 / (DAMPING_RAMP_S * TICK_HZ))
    origin = motion.origin
    command = JointCommand(
        position_rad=origin.position_rad,
        velocity_rad_s=(1 - ramp) * origin.velocity_rad_s,
        stiffness_nm_rad=(1 - ramp) * origin.stiffness_nm_rad,
        damping_nm_s_rad=(1 - ramp) * origin.damping_nm_s_rad + ramp * gains.damped_nm_s_rad,
        torque_nm=(1 - ramp) * origin.torque_nm,
    )
    return replace(motion, ramp=ramp, command=command)


def _at(table: JointArray, row: float) -> JointArray:
    """The table at a place between two rows, linearly."""
    low = int(row)
    part = row - low
    if part == 0.0:
        values: JointArray = table[low]
        return values
    between: JointArray = table[low] + part * (table[low + 1] - table[low])
    return between


def _fade(row: float, last: int) -> tuple[float, float]:
    """How much of the offset is left, and its rate per second: 1 − minimum jerk, C² at both ends."""
    span = min(FADE_S * TICK_HZ, last)
    s = row / span
    if s >= 1:
        return 0.0, 0.0
    return 1 - minimum_jerk(s), -minimum_jerk_rate(s) * TICK_HZ / span


def _slewed(now_nm: JointArray, wanted_nm: JointArray, most_nm: JointArray) -> JointArray:
    return np.clip(wanted_nm, now_nm - most_nm, now_nm + most_nm)
