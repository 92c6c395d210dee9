"""The form: whatever is typed becomes a profile in range or a fault of its field."""

from __future__ import annotations

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.console.patient_fields import FIELDS, FieldFault, Kind, parse, to_texts
from app.console.widgets.patient_details import field_name
from app.text.catalogue import render, use_language
from logs.reason import Reason, reason
from profiles.errors import ProfileFault
from profiles.fields import violations
from profiles.schema import DEMO_PATIENT, GestureUsed, HandUsed, Palm

NUMBERS = [field for field in FIELDS if field.kind in (Kind.NUMBER, Kind.OPTIONAL, Kind.WHOLE)]
PATHS = [field.path for field in FIELDS]
CODES = [one.value for one in GestureUsed]
BAD = [
    "abc",
    "1e999",
    "nan",
    "inf",
    "-",
    "--5",
    "5 furlongs",
    "😀",
    "\x1b[31m",
    "9" * 10_000,
    "٣٤ kg?",
    "1,2,3",
    "－１２．５",
    "1²",
]


def test_what_is_shown_is_read_back_as_the_same_profile() -> None:
    profile = msgspec.structs.replace(
        DEMO_PATIENT, hand=HandUsed.EITHER, palm=Palm(measured_width_m=0.081), hip_max_rad=1.0, note="left side weak"
    )
    again = parse(to_texts(profile), profile).profile
    assert again is not None
    assert again.palm.measured_width_m == pytest.approx(0.081)
    assert again.hip_max_rad == pytest.approx(1.0, abs=1e-4)
    assert to_texts(again) == to_texts(profile)


def test_a_vocabulary_is_typed_as_its_gestures() -> None:
    for typed in ("0, 1 rock", "０，１、ｒｏｃｋ"):
        profile = parse(to_texts(DEMO_PATIENT) | {"vocabulary": typed}, DEMO_PATIENT).profile
        assert profile is not None
        assert profile.vocabulary == (GestureUsed.ZERO, GestureUsed.ONE, GestureUsed.ROCK)


@pytest.mark.parametrize(
    ("typed", "stature_m"),
    [
        ("170", 1.70),
        ("170 cm", 1.70),
        ("1.70 m", 1.70),
        ("1,70m", 1.70),
        ("1700 mm", 1.70),
        (" 165,5 ", 1.655),
        ("１６５．５ｃｍ", 1.655),
    ],
)
def test_units_are_understood(typed: str, stature_m: float) -> None:
    profile = parse(to_texts(DEMO_PATIENT) | {"stature_m": typed}, DEMO_PATIENT).profile
    assert profile is not None
    assert profile.stature_m == pytest.approx(stature_m)


@pytest.mark.parametrize("field", NUMBERS, ids=lambda field: field.path)
@pytest.mark.parametrize("typed", BAD, ids=lambda typed: ascii(typed[:12]))
def test_nonsense_is_reported_at_its_field(field: object, typed: str) -> None:
    path = field.path  # type: ignore[attr-defined]
    parsed = parse(to_texts(DEMO_PATIENT) | {path: typed}, DEMO_PATIENT)
    assert parsed.profile is None
    assert set(parsed.errors) == {path}
    text = render(parsed.errors[path])
    assert len(text) < 200
    assert text.isprintable()


@pytest.mark.parametrize(
    ("path", "typed", "expected"),
    [
        ("stature_m", "", reason(FieldFault.EMPTY)),
        ("identifier", "", reason(FieldFault.EMPTY)),
        ("identifier", " \t", reason(FieldFault.EMPTY)),
        ("vocabulary", "0 1 10", reason(FieldFault.UNKNOWN_CODE, text="10", known=" ".join(CODES))),
        ("vocabulary", "", reason(ProfileFault.VOCABULARY_EMPTY)),
        ("vocabulary", "0 5", reason(ProfileFault.WALK_WITHOUT_END, walk="5", end="6")),
        ("stature_m", "tall", reason(FieldFault.NOT_A_NUMBER, text="tall", unit="cm")),
        ("stature_m", "170 kg", reason(FieldFault.UNKNOWN_UNIT, unit="kg", known="cm, mm, m")),
        ("dose.steps", "10.5", reason(FieldFault.NOT_WHOLE, text="10.5")),
    ],
)
def test_a_fault_has_its_code_and_what_was_typed(path: str, typed: str, expected: Reason) -> None:
    assert parse(to_texts(DEMO_PATIENT) | {path: typed}, DEMO_PATIENT).errors == {path: expected}


@pytest.mark.parametrize("field", NUMBERS, ids=lambda field: field.path)
def test_empty_is_an_error_only_where_a_value_is_needed(field: object) -> None:
    parsed = parse(to_texts(DEMO_PATIENT) | {field.path: ""}, DEMO_PATIENT)  # type: ignore[attr-defined]
    assert (parsed.profile is None) == (field.kind is not Kind.OPTIONAL)  # type: ignore[attr-defined]


@given(st.dictionaries(st.sampled_from(PATHS), st.text(max_size=60), max_size=6))
@settings(max_examples=300)
def test_anything_typed_gives_a_valid_profile_or_faults(typed: dict[str, str]) -> None:
    texts = to_texts(DEMO_PATIENT) | {path: text for path, text in typed.items() if _typable(path)}
    parsed = parse(texts, DEMO_PATIENT)
    if parsed.profile is None:
        assert parsed.errors
    else:
        assert violations(parsed.profile) == ()


def _typable(path: str) -> bool:
    """Choices are chosen, not typed."""
    return next(field for field in FIELDS if field.path == path).kind is not Kind.CHOICE


@pytest.mark.parametrize(
    ("path", "language", "shown"),
    [
        ("stature_cm", "en", "Stature (cm)"),
        ("gait.step_length_cm", "zh", "步长 (cm)"),
        ("hip_max_deg", "en", "Maximum hip flexion (°)"),
        ("mass_kg", "en", "Mass (kg)"),
        ("gait.step_time_s", "zh", "每步时间 (s)"),
        ("dose.distance_m", "en", "Distance (m)"),
        ("dose.duration_s", "en", "Time (s)"),
        ("dose.steps", "en", "Steps"),
        ("archived", "en", "Archived"),
        ("unknown", "en", "unknown"),
    ],
)
def test_what_changed_is_named_as_in_the_form(path: str, language: str, shown: str) -> None:
    use_language(language)
    assert field_name(path) == shown
