"""From a plan and an effect to one tick's joint command: move, hold, grip and give way, never with a jump.

Everything starts from the last *command*: feedback lags and is noisy, and a stop that takes its start from there
drops the limb. The one exception is gripping a slack joint, which takes it where it is.
"""

from __future__ import annotations

import dataclasses
from enum import Enum

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from app.motion.plan import Plan
from app.motion.settings import Gains
from hal.joints.protocol import TICK_HZ, JointArray, JointCommand
from hal.minimum_jerk import minimum_jerk, minimum_jerk_rate

HOLD_S = 0.150  # architecture: slow down along the path within this
STIFFNESS_RAMP_S = 0.3  # from slack to full stiffness
DAMPING_RAMP_S = 0.3  # from the last command to pure damping
FADE_S = 0.5  # a plan starts where the joint is, the command where it was told to be: the difference fades
TORQUE_SLEW_NM = 1.0  # per tick; the feed-forward never steps


class Mode(Enum):
    """What the joints are being told."""

    DISABLED = "limp"  # nothing: neutral commands, drives off or just enabled
    GRIP = "grip"  # stiffness is growing about where the joints were
    STIFF = "stiff"  # held
    MOVE = "move"  # along a plan
    DAMPED = "slack"  # giving way, at last pure damping


_ZERO = np.zeros(4)
NEUTRAL = JointCommand(
    position_rad=_ZERO, velocity_rad_s=_ZERO, stiffness_nm_rad=_ZERO, damping_nm_s_rad=_ZERO, torque_nm=_ZERO
)


class Motion(Struct, frozen=True, kw_only=True):
    """What the joints were told last, and what is needed to tell them the next."""

    mode: Mode = Mode.DISABLED
    command: JointCommand = NEUTRAL
    plan: Plan | None = None
    row: float = 0.0  # place on the plan
    pace: float = 1.0  # rows a tick; a hold brings it to 0
    offset_rad: JointArray | None = None  # of the command from the plan at its start
    share: float = 0.0  # how far gripping or giving way has come
    origin: JointCommand = NEUTRAL  # the command that giving way started from

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
        return self.mode is Mode.MOVE and self.rows_left <= 0

    @property
    def resting(self) -> bool:
        """The command does not change any more."""
        return self.mode in {Mode.DISABLED, Mode.STIFF} or self.slack

    @property
    def slack(self) -> bool:
        """The joints have given way."""
        return self.mode is Mode.DAMPED and self.share >= 1

    @property
    def halted(self) -> bool:
        """A hold has brought the movement to rest on its way."""
        return self.mode is Mode.MOVE and self.pace <= 0


def disabled_motion(motion: Motion) -> Motion:
    """Neutral commands."""
    return motion if motion.mode is Mode.DISABLED else Motion()


def grip(measured_rad: JointArray, gains: Gains) -> Motion:
    """Start to hold slack joints where they are."""
    command = dataclasses.replace(NEUTRAL, position_rad=measured_rad, damping_nm_s_rad=gains.slack_damping_nm_s_rad)
    return Motion(mode=Mode.GRIP, command=command)


def start(motion: Motion, plan: Plan) -> Motion:
    """Put the joints, held or arriving, on a plan."""
    return replace(
        motion,
        mode=Mode.MOVE,
        plan=plan,
        row=0.0,
        pace=1.0,
        offset_rad=motion.command.position_rad - plan.position_rad[0],
    )


def stay(motion: Motion) -> Motion:
    """Hold where the last command was."""
    return replace(
        motion, mode=Mode.STIFF, plan=None, command=dataclasses.replace(motion.command, velocity_rad_s=_ZERO)
    )


def resume(motion: Motion, written: JointCommand) -> Motion:
    """After a command was refused: go on from the one that really left, held there or giving way from there."""
    if motion.mode is Mode.DISABLED:
        return motion
    if motion.mode is Mode.DAMPED:
        return replace(motion, command=written, origin=written, share=0.0)
    return stay(replace(motion, command=written))


def ramp_to_damping(motion: Motion) -> Motion:
    """Start to let go; harmless while it runs, and for limp joints."""
    if motion.mode in {Mode.DAMPED, Mode.DISABLED}:
        return motion
    return Motion(mode=Mode.DAMPED, command=motion.command, origin=motion.command)


def advance(motion: Motion, gains: Gains, *, hold: bool) -> Motion:
    """The next tick's motion and command; with `hold` a movement slows down along its path."""
    if motion.mode is Mode.MOVE:
        return _moving(motion, gains, hold=hold)
    if motion.mode is Mode.GRIP:
        return _ramping_to_stiffness(motion, gains)
    return _ramping_to_damping(motion, gains) if motion.mode is Mode.DAMPED else motion


def _ramping_to_stiffness(motion: Motion, gains: Gains) -> Motion:
    share = min(1.0, motion.share + 1 / (STIFFNESS_RAMP_S * TICK_HZ))
    start_kd = gains.slack_damping_nm_s_rad
    command = dataclasses.replace(
        motion.command,
        stiffness_nm_rad=share * gains.stiffness_nm_rad,
        damping_nm_s_rad=start_kd + share * (gains.damping_nm_s_rad - start_kd),
    )
    mode = Mode.STIFF if share >= 1 else Mode.GRIP
    return replace(motion, mode=mode, share=share, command=command)


def _moving(motion: Motion, gains: Gains, *, hold: bool) -> Motion:
    plan = motion.plan
    assert plan is not None
    pace = max(0.0, motion.pace - 1 / (HOLD_S * TICK_HZ)) if hold else motion.pace
    row = min(motion.row + pace, float(len(plan.position_rad) - 1))
    fade, fade_speed = _fade(row, len(plan.position_rad) - 1)
    offset = _ZERO if motion.offset_rad is None else motion.offset_rad
    command = JointCommand(
        position_rad=_at(plan.position_rad, row) + fade * offset,
        velocity_rad_s=pace * (_at(plan.velocity_rad_s, row) + fade_speed * offset),
        stiffness_nm_rad=gains.stiffness_nm_rad,
        damping_nm_s_rad=gains.damping_nm_s_rad,
        torque_nm=_slewed(motion.command.torque_nm, gains.assist * _at(plan.torque_nm, row)),
    )
    return replace(motion, row=row, pace=pace, command=command)


def _ramping_to_damping(motion: Motion, gains: Gains) -> Motion:
    if motion.share >= 1:
        return motion
    share = min(1.0, motion.share + 1 / (DAMPING_RAMP_S * TICK_HZ))
    origin = motion.origin
    command = JointCommand(
        position_rad=origin.position_rad,
        velocity_rad_s=(1 - share) * origin.velocity_rad_s,
        stiffness_nm_rad=(1 - share) * origin.stiffness_nm_rad,
        damping_nm_s_rad=(1 - share) * origin.damping_nm_s_rad + share * gains.slack_damping_nm_s_rad,
        torque_nm=(1 - share) * origin.torque_nm,
    )
    return replace(motion, share=share, command=command)


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


def _slewed(now_nm: JointArray, wanted_nm: JointArray) -> JointArray:
    return np.clip(wanted_nm, now_nm - TORQUE_SLEW_NM, now_nm + TORQUE_SLEW_NM)
