from __future__ import annotations

import pytest

from profiles.errors import ProfileError
from profiles.files import edit, parse_assignments
from profiles.schema import HandUsed, Profile


def test_typed_changes_are_in_people_s_units(patient: Profile) -> None:
    changed = edit(patient, parse_assignments(["gait.step_length_cm=35", "hand=left", "palm.measured_width_cm = 8.2"]))
    assert changed.gait.step_length_m == pytest.approx(0.35)
    assert changed.hand is HandUsed.LEFT
    assert changed.palm.measured_width_m == pytest.approx(0.082)
    assert edit(changed, {"palm.measured_width_cm": "none"}).palm.measured_width_m is None


@pytest.mark.parametrize("note", ["1.80", "true", "a = b", 'quote " and # hash', "none of it"])
def test_a_note_stays_the_text_that_was_typed(patient: Profile, note: str) -> None:
    assert edit(patient, {"note": note}).note == note


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("step", "NO_ASSIGNMENT"),
        ("=3", "NO_ASSIGNMENT"),
        ("gait.step_lenght_cm=35", "MISSPELT_FIELD field=gait.step_lenght_cm close=gait.step_length_cm"),
        ("stature_cm=tall", "stature_cm"),
        ("sex=other", "'other' - at sex"),
        ("mass_kg=none", "missing required field mass_kg"),
        ("mass_kg=1e400", "OUT_OF_RANGE field=mass_kg value=inf"),
        ("stature_cm.x=3", "NO_GROUP"),
    ],
)
def test_a_change_that_means_nothing_is_refused_by_name(patient: Profile, word: str, message: str) -> None:
    with pytest.raises(ProfileError) as caught:
        edit(patient, parse_assignments([word]))
    assert message in str(caught.value)
