"""The gait table as a diagram, for the documents."""

from __future__ import annotations

from app.control.gait_table import TABLE, Row
from app.control.states import GESTURE_OF, Action


def mermaid() -> str:
    """The table as a Mermaid state diagram."""
    lines = ["stateDiagram-v2", "    [*] --> UNPOWERED"]
    for row in TABLE:
        gesture = f"gesture {GESTURE_OF[row.action].value}" if not row.chained else _chain_label(row)
        if row.through is None:
            lines.append(f"    {row.source.name} --> {row.to.name}: {gesture}")
        else:
            lines.append(f"    {row.source.name} --> {row.through.name}: {gesture}")
            lines.append(f"    {row.through.name} --> {row.to.name}: completed")
    lines.append("    note right of BETWEEN: entered from every state by a stop in mid-movement")
    lines.append("    note right of UNPOWERED: entered from every state when the drives lose power")
    return "\n".join(lines) + "\n"


def _chain_label(row: Row) -> str:
    return "gesture 6, latched" if row.action is Action.WALK_END else "next step of the walk"
