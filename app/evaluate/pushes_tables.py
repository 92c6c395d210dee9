"""The pushes as tables for the terminal."""

from __future__ import annotations

from collections.abc import Sequence

from rich.table import Table

from app.evaluate.pushes import Push
from kgdfa.gesture import Gesture


def pushes_by_gesture(pushes: Sequence[Push]) -> Table:
    """How many pushes of each gesture command it."""
    table = Table("gesture", title="Quick pushes")
    for heading in ("pushes", "command it", "%"):
        table.add_column(heading, justify="right")
    for gesture in Gesture:
        of = [push for push in pushes if push.gesture is gesture]
        right = sum(push.ok for push in of)
        table.add_row(gesture.value, str(len(of)), str(right), f"{100 * right / len(of):.1f}" if of else "–")
    return table


def failed_pushes(pushes: Sequence[Push]) -> Table:
    """Each push that did not command just its own gesture, and why."""
    table = Table("hand", "gesture", title="Pushes that failed")
    for heading in ("frames lost", "refused", "nearest cm"):
        table.add_column(heading, justify="right")
    table.add_column("why")
    for push in pushes:
        if not push.ok:
            seen = (str(push.lost), str(push.refused), f"{100 * push.nearest_m:.1f}")
            table.add_row(str(push.seed), push.gesture.value, *seen, push.reason)
    return table


def told(pushes: Sequence[Push]) -> str:
    """All of them in a sentence."""
    right, unasked = sum(push.ok for push in pushes), sum(push.unasked for push in pushes)
    return f"{right} of {len(pushes)} pushes command ({100 * right / len(pushes):.2f} %), {unasked} commands unasked"
