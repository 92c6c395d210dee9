"""Rows of the table of events: where the legs are, and what joints, drives and their bus report."""

from __future__ import annotations

from enum import Flag
from math import degrees

from app.control.events.row import Event, Latch, Row
from app.ipc.states import Effect
from hal.joints.protocol import BusFault, DriveFault

JOINT_SILENT_MS = 15.0  # with a tick and its margin the effect comes within 20 ms
FOLLOWING_WARN_RAD = 0.14  # 8°, four times the tracking that the plans are checked for
FOLLOWING_LIMIT_RAD = 0.26  # 15°
POSE_LIMIT_RAD = 0.21  # 12°
DRIFT_RAD_S = 0.6
STILL_RAD_S = 0.5

# The drive still does what it is told, or is simply off; the others go on holding the wearer.
HELD_FAULTS = (
    DriveFault.OVER_TEMPERATURE
    | DriveFault.OVER_CURRENT
    | DriveFault.OVER_VOLTAGE
    | DriveFault.UNDER_VOLTAGE
    | DriveFault.OVERLOAD
    | DriveFault.LOST_COMMUNICATION
    | DriveFault.UNEXPECTEDLY_DISABLED
)
# The drive's own law can't be trusted any more: stiffness about a wrong angle pushes the leg.
DAMPED_FAULTS = DriveFault.ENCODER | DriveFault.PHASE | DriveFault.WRONG_RANGE | DriveFault.OTHER
HELD_BUS_FAULTS = BusFault.SEND_FAILED | BusFault.BUS_OFF | BusFault.INTERFACE_GONE | BusFault.DUPLICATE_ID
NOTED_BUS_FAULTS = BusFault.ERROR_FRAME | BusFault.ARBITRATION_LOST | BusFault.UNKNOWN_ID | BusFault.MALFORMED


def _any_of(flags: Flag, wanted: Flag) -> bool:
    return flags.value & wanted.value != 0


E, F = Event, Effect
POSE = (
    Row(
        event=E.NOT_HOMED,
        effect=F.REFUSE,
        present=lambda f: not f.powered and f.legs.answering and f.legs.beyond_range,
        text="A joint reads an angle that it can't have: check its zero before power is switched on.",
    ),
    Row(
        event=E.LEGS_MOVING,
        effect=F.REFUSE,
        settles=True,  # a swinging leg is slow for a moment at each turning point
        present=lambda f: not f.powered and f.legs.fastest_rad_s > STILL_RAD_S,
        text="The legs still sink or swing: power comes once they have been still for a second. Wait, or hold them.",
    ),
    Row(
        event=E.FAR_FROM_POSE,
        effect=F.REFUSE,
        latch=Latch.POWERED,
        displaces=True,
        present=lambda f: f.legs.pose_error_rad > POSE_LIMIT_RAD,
        text="The legs are not where their state says: acknowledge, then gesture 0 brings them back slowly.",
        detail=lambda f: f"{degrees(f.legs.pose_error_rad):.0f}°",
    ),
)
DRIVES = (
    Row(
        event=E.JOINT_SILENT,
        effect=F.HOLD,
        latch=Latch.POWERED,
        present=lambda f: f.legs.age_ms > JOINT_SILENT_MS if f.powered else not f.legs.answering,
        text="A joint does not answer: the legs are held. Check its cable and supply.",
        detail=lambda f: f.legs.drive_detail,
    ),
    Row(
        event=E.DRIVE_FAULT,
        effect=F.HOLD,
        latch=Latch.POWERED,
        present=lambda f: _any_of(f.legs.drive_faults, HELD_FAULTS),
        text="A drive reports a fault: the other joints hold. Support the wearer.",
        detail=lambda f: f.legs.drive_detail,
    ),
    Row(
        event=E.DRIVE_ASTRAY,
        effect=F.DAMP,
        latch=Latch.POWERED,
        present=lambda f: _any_of(f.legs.drive_faults, DAMPED_FAULTS),
        text="A drive can't be trusted: the joints give way slowly. Support the wearer.",
        detail=lambda f: f.legs.drive_detail,
    ),
    Row(
        event=E.DRIVES_LOST,
        effect=F.HOLD,
        latch=Latch.ALWAYS,
        present=lambda f: f.legs.drives_lost,
        text="The drives lost power: support the wearer. Acknowledge, then gesture 0 powers them again.",
        detail=lambda f: f.legs.drive_detail,
    ),
    Row(
        event=E.DRIVE_ORDER_FAILED,
        effect=F.REFUSE,
        latch=Latch.ALWAYS,
        present=lambda f: f.legs.drive_error != "",
        text="The drives did not do what they were told.",
        detail=lambda f: f.legs.drive_error,
    ),
    Row(
        event=E.OVER_TEMPERATURE_WARNING,
        effect=F.NOTE,
        present=lambda f: f.legs.warm,
        text="A joint is getting warm: plan a pause.",
        detail=lambda f: f"{f.legs.hottest_c:.0f} °C",
    ),
    Row(
        event=E.OVER_TEMPERATURE,
        effect=F.HOLD,
        latch=Latch.POWERED,
        present=lambda f: f.legs.hot,
        text="A joint is too hot: the legs are held. Support the wearer, STOP twice and let it cool.",
        detail=lambda f: f"{f.legs.hottest_c:.0f} °C",
    ),
    Row(
        event=E.FOLLOWING_WARNING,
        effect=F.NOTE,
        present=lambda f: f.legs.following_rad > FOLLOWING_WARN_RAD,
        text="A joint lags behind its target: is something in the way, or the wearer tense?",
        detail=lambda f: f"{degrees(f.legs.following_rad):.0f}°",
    ),
    Row(
        event=E.FOLLOWING_LIMIT,
        effect=F.HOLD,
        latch=Latch.POWERED,
        present=lambda f: f.legs.following_rad > FOLLOWING_LIMIT_RAD,
        text="A joint can't follow: the legs are held. Something is in the way.",
        detail=lambda f: f"{degrees(f.legs.following_rad):.0f}°",
    ),
    Row(
        event=E.OUT_OF_RANGE,
        effect=F.HOLD,
        latch=Latch.POWERED,
        present=lambda f: f.powered and f.legs.beyond_range,
        text="A joint went beyond its range: the legs are held.",
    ),
    Row(
        event=E.OVER_SPEED,
        effect=F.DAMP,
        latch=Latch.POWERED,
        present=lambda f: f.powered and f.legs.beyond_speed,
        text="A joint moved faster than it may: the joints give way slowly. Support the wearer.",
    ),
    Row(
        event=E.OVER_TORQUE,
        effect=F.DAMP,
        latch=Latch.POWERED,
        present=lambda f: f.powered and f.legs.beyond_torque,
        text="A joint pushed harder than it may: the joints give way slowly. Support the wearer.",
    ),
    Row(
        event=E.GUARD_REFUSAL,
        effect=F.HOLD,
        latch=Latch.POWERED,
        present=lambda f: f.legs.guard_refusal != "",
        text="The guard refused a joint command: the legs are held. Tell the engineer.",
        detail=lambda f: f.legs.guard_refusal,
    ),
    Row(
        event=E.BUS_FAULT,
        effect=F.HOLD,
        latch=Latch.POWERED,
        present=lambda f: _any_of(f.legs.bus, HELD_BUS_FAULTS),
        text="The bus to the drives fails: the legs are held as far as commands arrive.",
        detail=lambda f: f.legs.drive_detail,
    ),
    Row(
        event=E.BUS_DISTURBED,
        effect=F.NOTE,
        present=lambda f: _any_of(f.legs.bus, NOTED_BUS_FAULTS),
        text="The bus to the drives is disturbed: check termination and plugs.",
        detail=lambda f: f.legs.drive_detail,
    ),
    Row(
        event=E.UNEXPECTED_MOTION,
        effect=F.DAMP,
        latch=Latch.POWERED,
        present=lambda f: f.legs.drift_rad_s > DRIFT_RAD_S,
        text="A joint moved while it was held: the joints give way slowly. Support the wearer.",
    ),
)
