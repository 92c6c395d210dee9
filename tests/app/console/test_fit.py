"""A profile whose steps this leg can't make is refused where it is saved, with the numbers."""

from __future__ import annotations

import msgspec
import pytest

from app.console.patient_fields import fits
from app.system.config import JointsConfig
from profiles.errors import ProfileError
from profiles.schema import DEMO_PATIENT


def test_the_demo_patient_fits() -> None:
    fits(JointsConfig())(DEMO_PATIENT)


def test_a_knee_that_hardly_bends_is_named() -> None:
    stiff = msgspec.structs.replace(DEMO_PATIENT, knee_max_rad=0.4)
    with pytest.raises(ProfileError, match="KNEE"):
        fits(JointsConfig())(stiff)


def test_an_archived_patient_may_stay_as_it_was() -> None:
    fits(JointsConfig())(msgspec.structs.replace(DEMO_PATIENT, knee_max_rad=0.4, archived=True))
