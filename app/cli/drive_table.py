"""Drives as a table on the terminal."""

from __future__ import annotations

import time

import numpy as np
from rich.table import Table

from hal.joints.emulator import DriveEmulator
from hal.joints.joints import DriveFault, Joint, JointFeedback
from hal.joints.socketcan import SocketCanJoints


def joint_name(joint: Joint) -> str:
    """For people."""
    return joint.name.lower().replace("_", " ")


def fault_name(fault: DriveFault) -> str:
    """For people; a dash for none."""
    return (fault.name or str(fault)).lower().replace("_", " ") if fault else "–"


def _table(*columns: str) -> Table:
    table = Table(box=None, pad_edge=False)
    for number, column in enumerate(columns):
        table.add_column(column, justify="left" if number == 0 else "right")
    return table


def emulated_drives_table(emulator: DriveEmulator) -> Table:
    """What the emulated firmware does."""
    table = _table("joint", "ID", "motor", "mode", "angle °", "speed °/s", "torque Nm", "°C", "kp", "kd")
    now_ns = time.monotonic_ns()
    for joint, drive in zip(Joint, emulator.drives, strict=True):
        follows = drive.effective(now_ns)
        state = drive.state
        mode = f"error {drive.error_code}" if drive.error_code else "motor" if drive.motor_mode else "rest"
        table.add_row(
            joint_name(joint),
            str(drive.device.can_id),
            drive.model.label,
            "silent" if drive.silent else mode,
            f"{np.degrees(state.position_rad):.1f}",
            f"{np.degrees(state.velocity_rad_s):.0f}",
            f"{state.torque_nm:.1f}",
            f"{state.temperature_c:.0f}",
            f"{follows.stiffness_nm_rad:.0f}",
            f"{follows.damping_nm_s_rad:.1f}",
        )
    table.caption = f"{emulator.received} frames heard, {emulator.lost_ticks} ticks of the body lost"
    return table


def feedback_table(joints: SocketCanJoints, feedback: JointFeedback) -> Table:
    """What the drives report, decoded."""
    table = _table("joint", "ID", "motor", "angle °", "speed °/s", "torque Nm", "°C", "age ms", "replies", "fault")
    now_ns = time.monotonic_ns()
    for joint, station in zip(Joint, joints.stations, strict=True):
        heard = station.measured_ns > 0
        warmth = feedback.temperature_c[joint]
        table.add_row(
            joint_name(joint),
            str(station.device.can_id),
            station.model.label,
            f"{np.degrees(feedback.position_rad[joint]):.1f}" if heard else "?",
            f"{np.degrees(feedback.velocity_rad_s[joint]):.0f}" if heard else "?",
            f"{feedback.torque_nm[joint]:.1f}" if heard else "?",
            "–" if np.isnan(warmth) else f"{warmth:.0f}",
            f"{(now_ns - station.measured_ns) / 1e6:.0f}" if heard else "never",
            str(station.answered),
            fault_name(feedback.faults[joint]),
        )
    bus = feedback.bus.name if feedback.bus else "well"
    table.caption = f"bus: {bus or feedback.bus}{f' – {feedback.detail}' if feedback.detail else ''}"
    return table
