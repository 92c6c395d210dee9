from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import pytest

from profiles.schema import Profile, Sex
from profiles.store import ProfileStore

AT = datetime(2026, 3, 1, 9, 30, tzinfo=UTC)


@pytest.fixture
def store(tmp_path: Path) -> ProfileStore:
    return ProfileStore(tmp_path / "profiles")


@pytest.fixture
def patient() -> Profile:
    return Profile(identifier="P-0042", sex=Sex.MALE, stature_m=1.756, mass_kg=81.5, note="left side weak")


@pytest.fixture
def at() -> datetime:
    return AT
