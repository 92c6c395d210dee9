from __future__ import annotations

from datetime import UTC, datetime

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.text.catalogue import render
from profiles.anthropometry import (
    GB_HAND_BREADTH_MM,
    GB_STATURE_MM,
    estimate_palm,
)
from profiles.errors import ProfileError, ProfileFault
from profiles.palm import (
    Calibrated,
    PalmFinding,
    ReferenceSource,
    calibrate,
    explain_estimate,
    palm_estimate,
    reference_segment,
    with_calibration,
)
from profiles.schema import Palm, Population, Profile, Sex

AT = datetime(2026, 3, 1, tzinfo=UTC)


def calibrated(
    patient: Profile, *, measured_m: list[float], true_m: float = 0.30, focal_px: float = 950.0
) -> Calibrated:
    return calibrate(
        patient,
        camera="cam",
        focal_px=focal_px,
        width_px=1280,
        height_px=720,
        distance_m=true_m,
        measured_m=measured_m,
        provisional_reference_m=reference_segment(patient).length_m,
        offset_m=0.0,
        at=AT,
    )


@pytest.mark.parametrize("sex", Sex)
@pytest.mark.parametrize("index", range(7))
def test_the_table_stands_at_its_percentiles(sex: Sex, index: int) -> None:
    stature_m = GB_STATURE_MM[sex][index] / 1000
    estimate = estimate_palm(sex, stature_m, Population.GB10000_88)
    assert estimate.width_m * 1000 == pytest.approx(GB_HAND_BREADTH_MM[sex][index])


@given(
    sex=st.sampled_from(Sex), population=st.sampled_from(Population), low=st.floats(1.2, 2.2), high=st.floats(1.2, 2.2)
)
def test_a_taller_person_never_has_the_narrower_estimate(
    sex: Sex, population: Population, low: float, high: float
) -> None:
    low, high = sorted((low, high))
    small, large = (estimate_palm(sex, stature, population) for stature in (low, high))
    assert small.width_m <= large.width_m
    assert 0.06 < small.width_m < 0.11
    assert 0.03 < small.distance_error < 0.06


def test_ansur2_is_the_published_regression() -> None:
    assert estimate_palm(Sex.MALE, 1.756, Population.ANSUR2).width_m == pytest.approx(0.08826, abs=5e-5)
    assert estimate_palm(Sex.FEMALE, 1.628, Population.ANSUR2).width_m == pytest.approx(0.07814, abs=5e-5)


def test_measured_wins_over_estimate_and_calibration_over_both(patient: Profile) -> None:
    assert reference_segment(patient).source is ReferenceSource.ESTIMATED
    measured = msgspec.structs.replace(patient, palm=Palm(measured_width_m=0.084))
    assert reference_segment(measured).length_m == pytest.approx(0.75 * 0.084)
    assert reference_segment(measured).source is ReferenceSource.MEASURED
    made = calibrated(measured, measured_m=[0.31] * 30).calibration
    both = with_calibration(measured, made)
    assert reference_segment(both, camera="cam").source is ReferenceSource.CALIBRATED
    assert reference_segment(both, camera="another").source is ReferenceSource.MEASURED
    assert (
        reference_segment(both, camera="cam").sd_m < reference_segment(measured).sd_m < reference_segment(patient).sd_m
    )


def test_calibration_makes_the_distance_right(patient: Profile) -> None:
    made = calibrated(patient, measured_m=[0.33, 0.34, 0.32] * 10, true_m=0.30)
    assert made.reference_m == pytest.approx(reference_segment(patient).length_m * 0.30 / 0.33)
    assert made.calibration.focal_anchor_px_m == pytest.approx(950 * made.reference_m)
    assert made.calibration.residual > 0.01


def test_a_new_calibration_takes_the_place_of_the_old_one(patient: Profile) -> None:
    first = with_calibration(patient, calibrated(patient, measured_m=[0.31] * 30).calibration)
    second = with_calibration(first, calibrated(patient, measured_m=[0.29] * 30).calibration)
    assert len(second.calibrations) == 1


def test_a_calibration_holds_for_another_resolution_and_another_focal_length(patient: Profile) -> None:
    known = with_calibration(patient, calibrated(patient, measured_m=[0.30] * 30).calibration)
    length_m = reference_segment(known, camera="cam").length_m
    half = reference_segment(known, camera="cam", focal_px=475.0, width_px=640, height_px=360)
    assert half.length_m == pytest.approx(length_m)
    corrected = reference_segment(known, camera="cam", focal_px=1000.0, width_px=1280, height_px=720)
    assert corrected.length_m * 1000 == pytest.approx(length_m * 950)


@pytest.mark.parametrize(
    ("width_px", "height_px", "source", "source_of_old"),  # old: its entry has no height
    [
        (1280, 720, ReferenceSource.CALIBRATED, ReferenceSource.CALIBRATED),
        (1920, 1080, ReferenceSource.CALIBRATED, ReferenceSource.ESTIMATED),
        (848, 480, ReferenceSource.CALIBRATED, ReferenceSource.ESTIMATED),
        (720, 1280, ReferenceSource.CALIBRATED, ReferenceSource.ESTIMATED),  # on its side
        (640, 480, ReferenceSource.ESTIMATED, ReferenceSource.ESTIMATED),
        (480, 640, ReferenceSource.ESTIMATED, ReferenceSource.ESTIMATED),
    ],
)
def test_a_calibration_holds_for_images_of_its_shape_however_the_camera_is_turned(
    patient: Profile, width_px: int, height_px: int, source: ReferenceSource, source_of_old: ReferenceSource
) -> None:
    made = calibrated(patient, measured_m=[0.31] * 30)
    old = msgspec.structs.replace(made.calibration, height_px=0)
    focal_px = 950 * max(width_px, height_px) / 1280
    for kept, wanted in ((made.calibration, source), (old, source_of_old)):
        known = with_calibration(patient, kept)
        segment = reference_segment(known, camera="cam", focal_px=focal_px, width_px=width_px, height_px=height_px)
        assert segment.source is wanted
        expected = made.reference_m if wanted is ReferenceSource.CALIBRATED else made.expected.length_m
        assert segment.length_m == pytest.approx(expected)


@pytest.mark.parametrize(
    ("measured_m", "true_m", "fault"),
    [
        ([0.3] * 19, 0.3, ProfileFault.TOO_FEW_SAMPLES),
        ([], 0.3, ProfileFault.TOO_FEW_SAMPLES),
        ([0.25, 0.30, 0.35] * 10, 0.3, ProfileFault.SCATTER),
        ([0.3] * 30, 0.05, ProfileFault.DISTANCE),
        ([0.3] * 30, float("nan"), ProfileFault.DISTANCE),
        ([0.78] * 30, 0.3, ProfileFault.NO_PALM),
        ([0.15] * 30, 0.3, ProfileFault.NO_PALM),
    ],
)
def test_a_calibration_that_would_mislead_is_refused(
    patient: Profile, measured_m: list[float], true_m: float, fault: ProfileFault
) -> None:
    with pytest.raises(ProfileError) as raised:
        calibrated(patient, measured_m=measured_m, true_m=true_m)
    assert raised.value.code is fault


def test_an_implausible_palm_is_doubted_and_a_plausible_one_is_not(patient: Profile) -> None:
    assert not calibrated(patient, measured_m=[0.31] * 30).doubt
    doubt = calibrated(patient, measured_m=[0.20] * 30).doubt
    assert doubt is not None
    assert doubt.code is PalmFinding.NOT_AS_ESTIMATED
    assert doubt.values["estimate_m"] == palm_estimate(patient).width_m


def test_estimates_report_their_error(patient: Profile) -> None:
    found = explain_estimate(palm_estimate(patient))
    assert "palm width 8.7 cm ± 4 mm by gb10000-88, distance ± 5 %" in render(found)
