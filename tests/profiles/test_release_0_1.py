"""Profiles written by release 0.1 (its own code made `data/release-0.1`) open, and their history reads as it did."""

from __future__ import annotations

import shutil
from datetime import UTC, datetime
from math import isclose
from pathlib import Path

import pytest
from msgspec.structs import replace

from profiles.store import ProfileStore
from testing.authors import Named

DATA = Path(__file__).with_name("data") / "release-0.1"


@pytest.fixture
def old_store(tmp_path: Path) -> ProfileStore:
    shutil.copytree(DATA, tmp_path / "profiles")
    return ProfileStore(tmp_path / "profiles")


def test_a_profile_of_release_0_1_opens(old_store: ProfileStore) -> None:
    profile = old_store.load("P-0042")
    assert (profile.identifier, profile.stature_m, profile.mass_kg, profile.note) == (
        "P-0042",
        1.756,
        81.5,
        "left side weak",
    )
    assert isclose(profile.press_threshold_m, 0.19)
    assert isclose(profile.gait.step_length_m, 0.35)
    assert profile.hip_max_rad is not None
    assert isclose(profile.hip_max_rad, 1.2, rel_tol=1e-9)
    (calibration,) = profile.calibrations
    assert (calibration.camera, calibration.focal_anchor_px_m, calibration.width_px) == ("webcam C920", 64.2, 1280)
    assert calibration.height_px == 0


def test_its_history_continues(old_store: ProfileStore) -> None:
    before = old_store.history("P-0042")
    assert [change.by for change in before] == ["engineer", "Dr Weber"]
    profile = old_store.load("P-0042")
    old_store.save(replace(profile, mass_kg=80.0), by=Named("engineer"), at=datetime(2026, 11, 22, tzinfo=UTC))
    assert [change.changes for change in old_store.history("P-0042")][2] == {"mass_kg": (81.5, 80.0)}
