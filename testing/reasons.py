"""Reasons for tests that need one and do not care which."""

from __future__ import annotations

from logs.reason import Reason


def plain(text: str) -> Reason | None:
    """A reason that renders as its text; None for an empty one."""
    return Reason("Text.PLAIN", {"text": text}) if text else None
