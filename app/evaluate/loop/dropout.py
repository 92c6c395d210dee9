"""What missing joint commands do to a moving leg: actions with the commands withheld at their fastest moment.

While commands are missing the drives go on under their own law with the last one, and nobody eases anything. Then
the path goes on as control lets it: at the pace that the missing ticks have left (`follower.advance`), with a pause's
slope.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import deepcopy
from math import degrees, inf
from pathlib import Path

import numpy as np
from msgspec import Struct
from rich.table import Table

from app.control.events.drives import FOLLOWING_LIMIT_RAD
from app.control.events.programs import CONTROL_LATE_MS, CONTROL_STALLED_MS
from app.evaluate.harness import Step, figure, table
from app.ipc.states import Action, GaitState
from app.ipc.streams import HEARTBEAT
from app.motion import follower
from app.motion.plan import Patient, Phase, Plan, PlanRequest, quad
from app.motion.rehearsal import SEQUENCES, STARTS, RehearsalRun
from app.motion.rehearsal_checks import RehearsalFault
from app.motion.trajectory import plan
from app.system.errors import AppError
from app.text.catalogue import render, tr
from hal.joints.device import Exoskeleton
from hal.joints.guard import SPEED_MARGIN
from hal.joints.protocol import TICK_HZ
from logs.reason import Reason

MISSING_MS = (0, 10, 20, 30, 40, 50, 60, 80, 100, 150, 200)
OBSERVED_TICKS = TICK_HZ // 2  # after the return: the path has its pace again after 150 ms, the errors have died down


class Dropout(Struct, frozen=True, kw_only=True):
    """One action with its commands missing for so long: the worst joint from the first missing command on."""

    action: Action
    missing_ms: float
    error_rad: float  # of the joint from where its path was to be; while commands are missing the path stands still
    speed_share: float  # of the device's limit
    torque_share: float
    guard_refusal: Reason | None


def all_dropouts(patient: Patient, device: Exoskeleton, step: Step) -> list[Dropout]:
    """Every action with every length of silence. Raises AppError when one can't be carried out."""
    found: list[Dropout] = []
    for action in Action:
        found.extend(dropouts(patient, device, action, MISSING_MS, pause_from_ms=CONTROL_LATE_MS, watch=step))
    return found


def dropouts(
    patient: Patient,
    device: Exoskeleton,
    action: Action,
    missing_ms: Sequence[float],
    times: int = 1,
    *,
    pause_from_ms: float,
    hold_from_ms: float = inf,
    watch: Step = lambda: None,
) -> Iterator[Dropout]:
    """Each length of silence at so many ticks in a row about the action's fastest moment.

    pause_from_ms: a longer one is a pause, a shorter one is ignored; hold_from_ms: a longer one ends in a hold.
    Raises AppError when the action can't be carried out by this patient.
    """
    run = _at_its_fastest(patient, device, action, before_ticks=times // 2)
    for _ in range(times):
        for length_ms in missing_ms:
            missing = round(length_ms * TICK_HZ / 1000)
            pauses, holds = length_ms > pause_from_ms, length_ms > hold_from_ms
            yield _interrupted(deepcopy(run), action, missing, pauses=pauses, holds=holds)
            watch()
        run.tick()


def _interrupted(run: RehearsalRun, action: Action, missing: int, *, pauses: bool, holds: bool) -> Dropout:
    run.rows.clear()
    for _ in range(missing):
        run.miss_tick()
    refusal = run.tick(hold=pauses, missed=missing)
    for _ in range(OBSERVED_TICKS):
        if refusal is not None:
            break
        if run.motion.arrived or (holds and run.motion.halted):
            run.motion = follower.hold(run.motion)
        refusal = run.tick(hold=holds)
    target, angle, speed, torque = (np.array(column) for column in zip(*run.rows, strict=True))
    limits = run.guard.limits
    return Dropout(
        action=action,
        missing_ms=missing * 1000 / TICK_HZ,
        error_rad=float(np.abs(angle - target).max()),
        speed_share=float((np.abs(speed) / limits.speed_rad_s).max()),
        torque_share=float((np.abs(torque) / limits.torque_nm).max()),
        guard_refusal=refusal,
    )


def _at_its_fastest(patient: Patient, device: Exoskeleton, action: Action, before_ticks: int) -> RehearsalRun:
    """The action under way, at or before the moment at which a joint is nearest to its speed limit."""
    run = RehearsalRun(patient, device, action)
    parts = SEQUENCES.get(action, ((action, Phase.WHOLE),))
    last, row, _ = fastest_moment(patient, run, action)
    refused = run.prepare()
    for number, (part, phase) in enumerate(parts[: last + 1]):
        made = run.plan_next(number, part, phase)
        if refused or made.check.reason:
            raise AppError(RehearsalFault.NOT_CARRIED_OUT, action=action, why=refused or made.check.reason)
        if number < last:
            run.follow(made)
            continue
        run.motion = follower.start_plan(run.motion, made)
        while run.motion.row < row - before_ticks:
            run.tick()
    return run


def fastest_moment(patient: Patient, run: RehearsalRun, action: Action) -> tuple[int, int, int]:
    """Which movement of the action, and at which row of its plan of how many, by plans from the nominal poses."""
    parts = SEQUENCES.get(action, ((action, Phase.WHOLE),))
    state, start_rad = STARTS.get(action, GaitState.STANDING), None
    best, found = -1.0, (0, 0, 1)
    for number, (part, phase) in enumerate(parts):
        pose = run.start_pose() if start_rad is None else start_rad
        made: Plan = plan(
            PlanRequest(number=number, action=part, phase=phase, from_state=state, start_rad=quad(pose)), patient
        )
        shares = (np.abs(made.velocity_rad_s) / run.guard.limits.speed_rad_s).max(axis=1)
        if part is action and shares.max() > best:
            best, found = float(shares.max()), (number, int(shares.argmax()), len(shares) - 1)
        state, start_rad = made.to_state, made.position_rad[-1]
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
