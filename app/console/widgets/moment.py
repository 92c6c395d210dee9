"""Everything about one moment of a reviewed session, in words."""

from __future__ import annotations

import math

from rich.text import Text

from app.console.review_data import Instant
from app.text.catalogue import tr
from app.text.recorded import render_recorded
from logs.records import Comment, Record
from logs.sanitize import sanitize_terminal
from logs.show import line_of

JOINTS = ("L hip", "L knee", "R hip", "R knee")


def about(instant: Instant, comments: list[Comment]) -> Text:
    """Everything about one moment."""
    minutes, seconds = divmod(instant.at_s, 60)
    text = Text(f"{tr('reviewing.moment')}  {int(minutes)}:{seconds:06.3f}\n", "bold")
    rows = (
        ("state", instant.state),
        ("gesture", instant.gesture),
        ("press", "●" if instant.pressed else ""),
        ("effect", instant.effect),
        ("events", ", ".join(instant.events)),
    )
    for name, value in rows:
        text.append(f"{tr(f'reviewing.{name}')}: ", "dim")
        text.append(f"{sanitize_terminal(value) or '–'}\n")
    if instant.joints is not None:
        _add_joints(text, instant)
    text.append("\n")
    text.append(_fields(instant))
    for comment in comments:
        text.append(f"\n✎ {sanitize_terminal(comment.text)}", "italic")
    return text


def _add_joints(text: Text, instant: Instant) -> None:
    assert instant.joints is not None
    titles = (tr(f"reviewing.{name}") for name in ("angle", "target", "torque", "temperature"))
    text.append(f"{'':<8}" + "".join(f"{title:>9}" for title in titles) + "\n", "dim")
    for joint, name in enumerate(JOINTS):
        values = (
            _number(instant.joints.angle_mean_rad[joint], math.degrees(1), "°"),
            _number(instant.joints.target_mean_rad[joint], math.degrees(1), "°"),
            _number(instant.joints.torque_mean_nm[joint], 1, " Nm"),
            _number(instant.joints.temperature_c[joint], 1, " °C"),
        )
        text.append(f"{name:<8}" + "".join(f"{value:>9}" for value in values) + "\n")


def _number(value: float | None, scale: float, unit: str) -> str:
    return "–" if value is None else f"{value * scale:.1f}{unit}"


def _fields(instant: Instant) -> Text:
    """The record at the cursor, field by field."""
    record = instant.record
    if not isinstance(record, Record):
        return line_of(record, render_recorded)
    text = Text(f"#{record.sequence} {record.process} {sanitize_terminal(record.operator)}\n", "bold")
    for name in record.body.__struct_fields__:
        text.append(f"{name}: ", "dim")
        text.append(f"{sanitize_terminal(str(getattr(record.body, name)))}\n")
    text.append(f"hash {record.hash[:16]}…\n", "dim")
    return text
