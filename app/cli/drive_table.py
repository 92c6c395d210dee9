"""Drives as a table on the terminal."""

from __future__ import annotations

import time

import numpy as np
from rich.table import Table

from hal.joints.can.candump import Decoded, LogSummary
from hal.joints.can.scan import BusMonitor
from hal.joints.codecs.wire import Reply, SetPoint
from hal.joints.emulator.emulator import DriveEmulator
from hal.joints.protocol import DriveFault, Joint


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


def monitor_table(watched: BusMonitor) -> Table:
    """What each drive said last, and what it was told last; fits 80 columns."""
    table = _table("joint", "ID", "angle °", "°/s", "Nm", "°C", "replies", "told °", "kp", "kd", "told", "fault")
    for station in watched.stations:
        name = station.short_name
        commands = watched.counts[name, "command"] + watched.counts[name, "order"]
        said, told = watched.newest.get((name, "reply")), watched.newest.get((name, "command"))
        fault = fault_name(said.faults) if said else "?"
        reported, replies = _reported(said), str(watched.counts[name, "reply"])
        table.add_row(name, str(station.device.can_id), *reported, replies, *_commanded(told), str(commands), fault)
    strangers, errors = watched.counts["", "stranger"], watched.counts["", "error"]
    newest = watched.newest.get(("", "stranger"))
    odd = f" (newest {newest.text})" if newest else ""
    bus = f"{(watched.bus.name or str(watched.bus)).lower()}: {watched.detail}" if watched.bus else "well"
    table.caption = f"bus {bus}; {strangers} frames of strangers{odd}, {errors} error frames"
    return table


def _reported(said: Decoded | None) -> tuple[str, str, str, str]:
    if said is None or not isinstance(said.at_joint, Reply):
        return ("?",) * 4
    reply = said.at_joint
    warmth = "–" if np.isnan(reply.temperature_c) else f"{reply.temperature_c:.0f}"
    return (
        f"{np.degrees(reply.position_rad):.1f}",
        f"{np.degrees(reply.velocity_rad_s):.0f}",
        f"{reply.torque_nm:.1f}",
        warmth,
    )


def _commanded(told: Decoded | None) -> tuple[str, str, str]:
    if told is None or not isinstance(told.at_joint, SetPoint):
        return ("–",) * 3
    target = told.at_joint
    angle = f"{np.degrees(target.position_rad):.1f}"
    return angle, f"{target.stiffness_nm_rad:.0f}", f"{target.damping_nm_s_rad:.1f}"


def summary_table(gathered: LogSummary) -> Table:
    """What a log held."""
    table = _table("drive", "commands", "orders", "replies", "longest silence ms", "faults")
    for name in sorted({drive for drive, _ in gathered.counts if drive}):
        gap_s = gathered.longest_gap_s.get(name)
        table.add_row(
            name,
            str(gathered.counts[name, "command"]),
            str(gathered.counts[name, "order"]),
            str(gathered.counts[name, "reply"]),
            "–" if gap_s is None else f"{gap_s * 1000:.1f}",
            fault_name(gathered.faults.get(name, DriveFault.NONE)),
        )
    table.caption = (
        f"{gathered.last_s - gathered.first_s:.1f} s, {sum(gathered.counts.values())} frames, "
        f"{gathered.counts['', 'stranger']} of strangers, {gathered.counts['', 'error']} error frames, "
        f"{gathered.broken_lines} broken lines left out"
    )
    return table
