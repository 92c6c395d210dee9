"""What a drive's replies say: one for each command, what comes beyond is another drive's; motor values at the joint."""

from __future__ import annotations

import pytest

from hal.joints.can.drive import Drive, drives_of
from hal.joints.codecs.wire import NEUTRAL, Reply
from tests.support.can_rig import with_motor


@pytest.fixture
def drive() -> Drive:
    return drives_of(with_motor("AK80-64/V2"))[0]


def ask(drive: Drive, times: int) -> None:
    for _ in range(times):
        drive.command(NEUTRAL)


def taken(drive: Drive, times: int) -> list[bool]:
    """Whether each of so many replies was one that had been asked for."""
    return [drive.take(Reply(drive.device.can_id, 0.0, 0.0, 0.0), 1) for _ in range(times)]


def test_replies_held_up_for_tenths_of_a_second_come_from_no_second_drive(drive: Drive) -> None:
    """An adapter that keeps them for 0.3 s, and then delivers them all."""
    ask(drive, 150)
    assert taken(drive, 152) == [True] * 150 + [False] * 2


def test_a_drive_that_never_answered_hides_a_second_one_for_a_second_at_most(drive: Drive) -> None:
    ask(drive, 10_000)
    assert taken(drive, 501) == [True] * 500 + [False]


def test_a_reply_is_converted_to_the_joint_behind_its_transmission() -> None:
    drive = drives_of(with_motor("AK80-64/V2", transmission=2.0))[0]
    drive.take(Reply(drive.device.can_id, position_rad=1.0, velocity_rad_s=0.5, torque_nm=3.0), 1)
    at_joint = (drive.position_rad, drive.velocity_rad_s, drive.torque_nm)
    assert [abs(value) for value in at_joint] == [0.5, 0.25, 6.0]
    assert drive.velocity_rad_s * drive.torque_nm == 0.5 * 3.0, "the power is the motor's"
