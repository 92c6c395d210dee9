"""The demo's result as a table for people."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console
from rich.table import Table

from app.demo.course import Leg
from app.demo.session import SessionResult
from app.demo.trial import Trial, spread
from app.ipc.states import ACTION_OF


def print_result(console: Console, result: SessionResult, course: Sequence[Leg]) -> None:
    """The table, one line a gesture, and what it comes to."""
    table = Table("gesture", "action", "recognised", "presses", "from → to", title="rleex demo")
    for heading in ("recognition → command", "release → command", "release → visible", "tracking RMS"):
        table.add_column(heading, justify="right")
    table.add_column("")
    for trial in result.trials:
        table.add_row(*_cells(trial))
    console.print(table)
    release = spread(trial.response_from_release_ms for trial in result.trials)
    late = result.lateness
    done = sum(trial.ok for trial in result.last_of(course))
    if result.interruptions:
        console.print(
            f"{len(result.interruptions)} interrupted by an interlock, acknowledged, brought back, made again"
        )
    console.print(f"{done} of {len(course)} actions, {result.unintended} unintended; audit trail {_proof(result)}")
    if release is not None:
        console.print(f"release → command: median {release.p50:.0f} ms, worst hundredth {release.p99:.0f} ms")
    console.print(f"perception {result.perception_fps:.1f} frames/s beside everything else")
    console.print(
        f"tick lateness p50 {late.p50_ms:.3f}, p99 {late.p99_ms:.3f}, max {late.max_ms:.2f} ms; "
        f"{late.missed} of {late.ticks} ticks missed"
    )


def _proof(result: SessionResult) -> str:
    return "verified" if result.audit_verified else f"NOT VERIFIED: {result.audit_detail}"


def _cells(trial: Trial) -> list[str]:
    return [
        trial.gesture.value,
        ACTION_OF[trial.gesture].value,
        _yes(trial.recognised),
        str(trial.presses) if trial.pressed else "no",
        f"{trial.start.value} → {trial.end.value}",
        _ms(trial.response_from_recognition_ms),
        _ms(trial.response_from_release_ms),
        _ms(trial.visible_motion_ms),
        "–" if trial.tracking_rms_deg is None else f"{trial.tracking_rms_deg:.2f}°",
        "ok" if trial.ok else f"[bold]failed[/]: {trial.reason}",
    ]


def _yes(value: bool) -> str:
    return "yes" if value else "no"


def _ms(value: float | None) -> str:
    return "–" if value is None else f"{value:.0f} ms"
