"""What missing joint commands do to a moving leg, in figures: table, JSON, plot."""

from __future__ import annotations

from collections.abc import Sequence
from math import degrees
from pathlib import Path

from rich.table import Table

from app.control.events.drives import FOLLOWING_LIMIT_RAD
from app.control.events.programs import CONTROL_LATE_MS, CONTROL_STALLED_MS
from app.evaluate.harness import Step, figure, table
from app.ipc.states import Action
from app.ipc.streams import HEARTBEAT
from app.motion.dropout import MISSING_MS, Dropout, dropouts
from app.motion.plan import Patient
from app.text.catalogue import render, tr
from hal.joints.device import Exoskeleton
from hal.joints.guard import SPEED_MARGIN


def all_dropouts(patient: Patient, device: Exoskeleton, step: Step) -> list[Dropout]:
    """Every action with every length of silence. Raises AppError when one can't be carried out."""
    found: list[Dropout] = []
    for action in Action:
        found.extend(dropouts(patient, device, action, MISSING_MS, pause_from_ms=CONTROL_LATE_MS, watch=step))
    return found


def dropout_table(found: Sequence[Dropout]) -> Table:
    """A row an action and length."""
    cells = [
        (
            tr(one.action),
            f"{one.missing_ms:.0f}",
            f"{degrees(one.error_rad):.1f}",
            f"{one.speed_share:.0%}",
            f"{one.torque_share:.0%}",
            "–" if one.guard_refusal is None else render(one.guard_refusal),
        )
        for one in found
    ]
    return table("dropout", "action missing_ms error_deg speed_share torque_share guard", cells)


def plot_dropouts(found: Sequence[Dropout], file: Path) -> None:
    """Error, speed and torque over the length, a line an action, with the limits in use. Raises AppError."""
    with figure(file, 3, size=(9, 10)) as (_, (errors, speeds, torques)):
        for action in Action:
            mine = [one for one in found if one.action is action]
            missing = [one.missing_ms for one in mine]
            errors.plot(missing, [degrees(one.error_rad) for one in mine], marker=".", label=tr(action))
            speeds.plot(missing, [100 * one.speed_share for one in mine], marker=".")
            torques.plot(missing, [100 * one.torque_share for one in mine], marker=".")
        errors.axhline(degrees(FOLLOWING_LIMIT_RAD), color="red", lw=0.8)
        speeds.axhline(100 * SPEED_MARGIN, color="red", lw=0.8)
        torques.axhline(100, color="red", lw=0.8)
        for axes, title in ((errors, "error"), (speeds, "speed"), (torques, "torque")):
            for limit_ms in (CONTROL_LATE_MS, CONTROL_STALLED_MS, HEARTBEAT.stale_ms):
                axes.axvline(limit_ms, color="grey", lw=0.8, ls=":")
            axes.set_ylabel(tr(f"evaluate.dropout.{title}"))
            axes.set_xlabel(tr("evaluate.dropout.missing"))
            axes.grid(alpha=0.3)
        errors.legend(loc="center right", fontsize=7)
