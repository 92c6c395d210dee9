"""The line of a guided test that runs: which, its time, distance and steps, and what remains. Pure."""

from __future__ import annotations

from app.console.widgets.panel import Lines, fitted
from app.outcomes.guided import GuidedRun
from app.text.catalogue import tr


def guided_line(run: GuidedRun, key: str, width: int) -> Lines:
    """One line, what matters most first; a part that does not fit is left out whole."""
    parts = [(f" {tr(run.test)} ", "bold reverse $accent")]
    if run.began_ns:
        parts.append((f" {clock(run.duration_s)} ", "bold"))
        parts += [(f" {left} ", "bold $primary") for left in _left(run)]
    else:
        parts.append((f" {tr('guided.waits')} ", "bold $primary"))
    parts.append((f" {run.distance_m:.1f} m ", ""))
    parts.append((f" {tr('guided.steps', steps=run.steps)} ", ""))
    parts.append((f" {tr('guided.key', key=key)} ", "$foreground-muted"))
    return (fitted(parts, width),)


def clock(seconds: float) -> str:
    """Minutes and whole seconds that have passed."""
    return f"{int(seconds) // 60}:{int(seconds) % 60:02d}"


def _left(run: GuidedRun) -> list[str]:
    if run.remaining_m:
        return [tr("guided.left_m", left_m=run.remaining_m)]
    if run.procedure.until_seated:
        return [tr("guided.sit")]
    return [] if run.remaining_s is None else [tr("guided.left_s", left=clock(run.remaining_s))]
