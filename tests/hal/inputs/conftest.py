"""Fixtures of the stop inputs' tests."""

from __future__ import annotations

import sys

import pytest


@pytest.fixture(autouse=True)
def libraries(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a test puts in the libraries' place goes with it."""
    for name in ("evdev", "gpiod", "gpiod.line"):
        monkeypatch.setitem(sys.modules, name, None)
