"""Types of the records' fields: plain types with units in the fields' names."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from logs.reason import Reason

Measured = float | None  # null: not measured
Quad = tuple[Measured, Measured, Measured, Measured]  # left hip, left knee, right hip, right knee
Cause = Reason | str | None  # a code with values; text as schema 1 recorded it; null: none
Hex = Annotated[str, Meta(pattern="^[0-9a-f]*$")]
