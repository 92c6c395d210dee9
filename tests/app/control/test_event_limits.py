"""Where each condition of the table begins, and what latches: the rows alone, on facts at and just beyond the limit."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from app.control.diagnostics import Diagnostics
from app.control.events.row import Above, Compared
from app.control.events.table import TABLE, advance, effect_of
from app.ipc.states import Effect, Event
from app.text.catalogue import render
from hal.errors import DrivesFault, HardwareError
from hal.joints.guard import RANGE_MARGIN_RAD
from hal.joints.protocol import Joint
from logs.reason import reason, reason_of
from tests.app.control.ideal_joints import IdealJoints
from tests.app.control.rig import SETTINGS

CALM = Diagnostics(now_ns=1_000, powered=True)
E = Event
# Written down a second time: docs/safety.md and the bounds rest on these numbers.
LIMITS = (
    (E.STOP_AGAIN, "session.stop_presses", 1),
    (E.FAR_FROM_POSE, "joints.pose_error_rad", 0.21),
    (E.CAMERA_STALE, "programs.frame_age_ms", 200.0),
    (E.PERCEPTION_TIMEOUT, "programs.perception_age_ms", 200.0),
    (E.CONSOLE_TIMEOUT, "programs.console_age_ms", 230.0),
    (E.AUDIT_BACKLOG, "programs.audit_waiting", 2_000),
    (E.AUDIT_TIMEOUT, "programs.audit_age_ms", 400.0),
    (E.TICK_LATE, "clocks.late_ms", 2.0),
    (E.TICK_LATE, "clocks.missed_ticks", 0),
    (E.CONTROL_LATE, "clocks.late_ms", 20.0),
    (E.CONTROL_STALLED, "clocks.late_ms", 50.0),
    (E.STOP_INPUTS_LATE, "clocks.reader_age_ms", 20.0),
    (E.HOST_SUSPENDED, "clocks.slept_s", 0.1),
    (E.CLOCK_JUMP, "clocks.step_s", 0.5),
    (E.JOINT_TIMEOUT, "joints.age_ms", 15.0),
    (E.JOINT_SANK, "joints.sunk_rad", 0.14),
    (E.FOLLOWING_WARNING, "joints.following_rad", 0.14),
    (E.FOLLOWING_LIMIT, "joints.following_rad", 0.26),
    (E.UNEXPECTED_MOTION, "joints.drift_rad_s", 0.6),
    (E.GUARDIAN_TIMEOUT, "programs.guardian_age_ms", 250.0),
    (E.MESSAGE_REJECTED, "programs.rejected_messages", 0),
    (E.FOREIGN_PEER, "programs.foreign_peers", 0),
)
REPORTED = (
    (E.CAMERA_STALE, "programs.camera_fault"),
    (E.AUDIT_WRITE_FAILED, "programs.audit_fault"),
    (E.GUARDIAN_TIMEOUT, "programs.guardian_fault"),
    (E.DRIVE_ORDER_FAILED, "joints.drive_error"),
)


def events_of(diagnostics: Diagnostics) -> set[Event]:
    return {one.event for one in advance((), diagnostics)}


def with_one(quantity: str, value: object) -> Diagnostics:
    """A calm tick but for one quantity, named with its group."""
    group, _, name = quantity.rpartition(".")
    changed: dict[str, Any] = {name: value}
    within: dict[str, Any] = {group: replace(getattr(CALM, group), **changed)}
    return replace(CALM, **within)


def beyond(limit: float) -> float:
    return limit + 1 if isinstance(limit, int) else math.nextafter(limit, math.inf)


def test_every_row_that_is_a_limit_has_its_own_here() -> None:
    missing = {row.event for row in TABLE if isinstance(row.present, Above)} - {event for event, *_ in LIMITS}
    assert not missing, f"add the limit of {missing} to LIMITS in {__file__}"


@pytest.mark.parametrize(("event", "quantity", "limit"), LIMITS)
def test_a_limit_may_be_reached_and_not_passed(event: Event, quantity: str, limit: float) -> None:
    assert event not in events_of(with_one(quantity, limit))
    assert event in events_of(with_one(quantity, beyond(limit)))


@pytest.mark.parametrize(("event", "quantity"), REPORTED)
def test_a_fault_that_somebody_reports_is_an_event_and_is_passed_on(event: Event, quantity: str) -> None:
    (raised,) = advance((), with_one(quantity, reason_of(OSError("it broke"))))
    assert raised.event is event
    assert raised.detail == {"detail": reason_of(OSError("it broke"))}
    assert "it broke" in render(raised.reason)


def test_the_clock_may_jump_in_either_direction() -> None:
    assert E.CLOCK_JUMP in events_of(with_one("clocks.step_s", -0.6))
    assert E.CLOCK_JUMP not in events_of(with_one("clocks.step_s", -0.5))


def test_a_second_press_of_stop_is_an_event_of_its_own() -> None:
    assert events_of(with_one("session.stop_presses", 1)) == {E.STOP}
    assert events_of(with_one("session.stop_presses", 2)) == {E.STOP_AGAIN}


def test_the_operator_reads_the_numbers_where_there_are_some() -> None:
    (with_numbers,) = advance((), with_one("programs.audit_waiting", 2_001))
    assert (with_numbers.event, with_numbers.detail) == (E.AUDIT_BACKLOG, {"count": 2_001})
    (without,) = advance((), with_one("programs.audit_full", True))
    assert without.reason == reason(E.AUDIT_QUEUE_FULL)


def test_an_acknowledgement_sent_as_an_event_was_raised_may_not_have_seen_it() -> None:
    slept = advance((), with_one("clocks.slept_s", 9.0))
    at_once, after = (advance(slept, CALM, CALM.now_ns + later_ns) for later_ns in (0, 1))
    assert [one.event for one in at_once] == [E.HOST_SUSPENDED]
    assert not after


def test_what_waits_for_its_acknowledgement_reports_that_its_condition_has_gone() -> None:
    slept = advance((), with_one("clocks.slept_s", 9.0))
    assert [one.present for one in slept] == [True]
    assert [one.present for one in advance(slept, CALM)] == [False]


def test_legs_count_as_moving_only_before_they_carry_power() -> None:
    at_limit, beyond_limit = (with_one("joints.fastest_rad_s", speed) for speed in (0.5, beyond(0.5)))
    assert E.LEGS_MOVING not in events_of(replace(at_limit, powered=False))
    assert E.LEGS_MOVING in events_of(replace(beyond_limit, powered=False))
    assert E.LEGS_MOVING not in events_of(with_one("joints.fastest_rad_s", 1.0))


def test_what_was_there_before_power_waits_for_an_acknowledgement_once_there_is_power() -> None:
    late = with_one("clocks.late_ms", 65.0)
    before = advance((), replace(late, powered=False))
    assert not next(one for one in before if one.event is E.CONTROL_STALLED).latched
    after = advance(before, late)
    assert next(one for one in after if one.event is E.CONTROL_STALLED).latched


def test_what_has_latched_stays_so_when_the_power_goes() -> None:
    late = with_one("clocks.late_ms", 65.0)
    unpowered = advance(advance((), late), replace(late, powered=False))
    assert next(one for one in unpowered if one.event is E.CONTROL_STALLED).latched


@pytest.mark.parametrize(("later_ns", "shown"), [(999_999_999, True), (1_000_000_000, False), (1_500_000_000, False)])
@pytest.mark.parametrize("since_ns", [1_000, 7_000_000_000])
def test_what_has_passed_is_read_for_a_second_and_does_nothing_any_more(
    since_ns: int, later_ns: int, *, shown: bool
) -> None:
    gone = replace(CALM, now_ns=since_ns + later_ns)
    faulty = replace(with_one("programs.audit_fault", reason_of(OSError("disk full"))), now_ns=since_ns)
    after = advance(advance((), faulty), gone)
    assert [one.event for one in after] == [E.AUDIT_WRITE_FAILED] * shown
    assert effect_of(after) is Effect.NOTE


@pytest.mark.parametrize(
    ("event", "quantity"),
    [
        (E.OUT_OF_RANGE, "joints.beyond_range"),
        (E.OVER_SPEED, "joints.beyond_speed"),
        (E.OVER_TORQUE, "joints.beyond_torque"),
    ],
)
def test_legs_that_somebody_moves_by_hand_are_within_no_limits_of_the_drives(event: Event, quantity: str) -> None:
    beyond_limit = with_one(quantity, True)
    assert event in events_of(beyond_limit)
    assert event not in events_of(replace(beyond_limit, powered=False))


@pytest.mark.parametrize("event", [E.OVER_TEMPERATURE_WARNING, E.OVER_TEMPERATURE, E.OUT_OF_RANGE])
def test_before_the_joints_have_answered_nothing_is_compared(event: Event) -> None:
    (row,) = (row for row in TABLE if row.event is event)
    assert row.compared(CALM) is None


def compared_in(event: Event, **fields: Any) -> Compared | None:
    """What an event's row compares where the joints report this."""
    (row,) = (row for row in TABLE if row.event is event)
    feedback = dataclasses.replace(IdealJoints().feedback(0), **fields)
    return row.compared(replace(CALM, joints=replace(CALM.joints, feedback=feedback, settings=SETTINGS)))


def test_drives_that_report_no_temperature_are_compared_with_no_limit() -> None:
    assert compared_in(E.OVER_TEMPERATURE, temperature_c=np.full(4, math.nan)) is None
    hot = np.array([math.nan, 20.0, 95.0, 30.0])
    assert compared_in(E.OVER_TEMPERATURE, temperature_c=hot) == Compared("temperature_c", 95.0, 80.0, Joint.RIGHT_HIP)


@pytest.mark.parametrize("end", ["low", "high"])
@pytest.mark.parametrize("joint", Joint)
def test_a_joint_beyond_its_range_is_named_with_the_end_that_it_has_passed(joint: Joint, end: str) -> None:
    low_rad, high_rad = SETTINGS.limits.low_rad - RANGE_MARGIN_RAD, SETTINGS.limits.high_rad + RANGE_MARGIN_RAD
    position_rad = (low_rad + high_rad) / 2
    end_rad = float(low_rad[joint] if end == "low" else high_rad[joint])
    position_rad[joint] = end_rad + (-0.1 if end == "low" else 0.1)
    compared = compared_in(E.OUT_OF_RANGE, position_rad=position_rad)
    assert compared == Compared("angle_rad", float(position_rad[joint]), end_rad, joint)


def test_lost_power_is_raised_with_what_the_driver_reports() -> None:
    fault = HardwareError(DrivesFault.STAYS_DISABLED)
    lost = replace(CALM, joints=replace(CALM.joints, drives_lost=True, drive_detail=fault))
    (raised,) = (one for one in advance((), lost) if one.event is E.DRIVES_POWER_LOST)
    assert raised.detail == {"detail": reason_of(fault)}
