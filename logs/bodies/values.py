"""Values that several kinds of record have."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

Measured = float | None  # null: not measured
Quad = tuple[Measured, Measured, Measured, Measured]  # left hip, left knee, right hip, right knee
Hex = Annotated[str, Meta(pattern="^[0-9a-f]*$")]
