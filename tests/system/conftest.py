"""What the tests with real processes need: a home of their own, and the hand model that `make test` has set up."""

from __future__ import annotations

from pathlib import Path

import pytest

from app.system.config import Config
from app.system.hand_model import find_model
from app.system.paths import Home, find_home


@pytest.fixture(scope="session")
def hand_model() -> Path:
    """The model of the user's own home; `make model` puts it there."""
    own = find_home()
    return find_model(own, Config())


@pytest.fixture
def home(tmp_path: Path) -> Home:
    """An empty home."""
    return Home(tmp_path / "home")
