"""Writes the generated parts of docs/safety.md: the gait diagram and the table of events, from the code itself.

`python tools/safety_tables.py` rewrites them; with --check it only says whether they are current, which a test asks.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

from app.control.events.row import Latch, Row
from app.control.events.table import TABLE
from app.control.gait import table as gait_table
from app.ipc.states import GESTURE_OF, Action, Event, Source
from app.text.catalogue import key_of, load
from app.text.compile import compile_catalogues

DOCUMENT = Path(__file__).parent.parent / "docs" / "safety.md"
_LATCH = {
    Latch.NEVER: "while it lasts",
    Latch.POWERED: "until acknowledged",
    Latch.ALWAYS: "until acknowledged, always",
}
_PART = "<!-- {0} -->\n{1}<!-- end of {0} -->"


def parts() -> dict[str, str]:
    """The generated parts by name."""
    return {"gait diagram": f"```mermaid\n{gait_diagram()}```\n", "events": events_table()}


def gait_diagram() -> str:
    """The gait machine's table as a Mermaid state diagram."""
    lines = ["stateDiagram-v2", "    [*] --> UNPOWERED"]
    for row in gait_table.TABLE:
        gesture = f"gesture {GESTURE_OF[row.action].value}" if not row.chained else _chain_label(row)
        if row.through is None:
            lines.append(f"    {row.source.name} --> {row.to.name}: {gesture}")
        else:
            lines.append(f"    {row.source.name} --> {row.through.name}: {gesture}")
            lines.append(f"    {row.through.name} --> {row.to.name}: completed")
    lines.append("    note right of BETWEEN: entered from every state by a stop in mid-movement")
    lines.append("    note right of UNPOWERED: entered from every state when the drives lose power")
    return "\n".join(lines) + "\n"


def _chain_label(row: gait_table.Row) -> str:
    return "gesture 6, latched" if row.action is Action.WALK_END else "next step of the walk"


def events_table() -> str:
    """Every row of the table of events, strongest effect first."""
    rows = sorted(TABLE, key=lambda row: -row.effect)
    lines = ["| event | effect | stays | refuses | what the operator reads |", "|---|---|---|---|---|"]
    return "\n".join([*lines, *(_line(row) for row in rows)]) + "\n"


def current(text: str) -> str:
    """The document with its generated parts as the code has them now."""
    for name, content in parts().items():
        pattern = re.compile(rf"<!-- {name} -->\n.*?<!-- end of {name} -->", re.DOTALL)
        text = pattern.sub(lambda _, n=name, c=content: _PART.format(n, c), text)  # type: ignore[misc]
    return text


def _line(row: Row) -> str:
    whose = "everybody" if row.blocks == frozenset(Source) else " and ".join(one.value + "s" for one in row.blocks)
    refuses = whose if row.effect > 0 else "–"
    return f"| {row.event.value} | {row.effect.name.lower()} | {_LATCH[row.latch]} | {refuses} | {_text(row.event)} |"


def _text(event: Event) -> str:
    """The wording without its values."""
    text = load("en").gettext(key_of(event))
    if text == key_of(event):
        sys.exit(f"{text} has no wording: add it to app/text/locales/en/LC_MESSAGES/control.po")
    text = re.sub(r"\{\w+:in_brackets\}", "", text)
    return re.sub(r"\{\w+(:[^}]*)?\}", "…", text)


if __name__ == "__main__":
    compile_catalogues()
    written = DOCUMENT.read_text(encoding="utf-8")
    if "--check" in sys.argv:
        sys.exit(current(written) != written and "docs/safety.md is not current: run python tools/safety_tables.py")
    DOCUMENT.write_text(current(written), encoding="utf-8")
