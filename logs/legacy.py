"""What trails of former versions recorded and this one names otherwise: for showing and filtering old trails."""

from __future__ import annotations

# Event as recorded with schema 1 → the value of `Event` that stands for it now.
EVENTS: dict[str, str] = {}
