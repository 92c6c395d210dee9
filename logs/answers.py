"""Answers to queries for people and programs, harmless whatever their text."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from rich.table import Table
from rich.text import Text

from logs.plain import sanitize_terminal

MOST_ROWS = 500  # on a screen; JSON has them all


def as_table(answer: Any) -> Table:
    """The first rows of a pyarrow table, numbers to the right."""
    table = Table(box=None)
    rows = answer.slice(0, MOST_ROWS).to_pylist()
    for name in answer.column_names:
        numeric = any(isinstance(row[name], int | float) for row in rows)
        table.add_column(Text(sanitize_terminal(name)), justify="right" if numeric else "left")
    for row in rows:
        table.add_row(*(Text(_cell(value)) for value in row.values()))
    if answer.num_rows > MOST_ROWS:
        table.caption = f"{answer.num_rows} rows; --json gives them all"
    return table


def as_json(answer: Any) -> Iterator[str]:
    """Every row of a pyarrow table as an object in pure ASCII."""
    return (json.dumps(row, default=str) for row in answer.to_pylist())


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    return "–" if value is None else sanitize_terminal(str(value))
