from __future__ import annotations

import os
from datetime import UTC, datetime
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from profiles.errors import ProfileError, ProfileFault
from profiles.fields import RANGES, file_key, violations
from profiles.files import decode, encode
from profiles.schema import DEMO_PATIENT, Calibration, GaitParameters, Palm, Profile, Sex
from profiles.store import ChangeCause, ProfileStore, differences
from testing.authors import Named

AT = datetime(2026, 3, 1, tzinfo=UTC)


def changed(profile: Profile, **fields: object) -> Profile:
    return msgspec.structs.replace(profile, **fields)


def with_field(profile: Profile, field: str, value: float) -> Profile:
    group, _, name = field.rpartition(".")
    if not group:
        return changed(profile, **{name: value})
    return changed(profile, **{group: msgspec.structs.replace(getattr(profile, group), **{name: value})})


def test_what_is_saved_is_loaded(store: ProfileStore, patient: Profile, at: datetime) -> None:
    full = changed(
        patient,
        palm=Palm(measured_width_m=0.0815),
        thigh_length_m=0.431,
        hip_max_rad=1.2345,
        calibrations=(
            Calibration(
                camera="Webcam C920",
                focal_anchor_px_m=58.25,
                focal_px=950.0,
                distance_m=0.3,
                residual=0.01,
                calibrated_at="2026-01-01T00:00:00+00:00",
            ),
        ),
    )
    store.create(full, by=Named("anna"), at=at)
    assert differences(full, store.load("P-0042")) == {}
    assert store.load("P-0042").hip_max_rad == pytest.approx(1.2345, abs=1e-10)


def test_files_speak_centimetres_and_degrees(patient: Profile) -> None:
    text = encode(changed(patient, hip_max_rad=1.5707963267948966))
    assert "stature_cm = 175.6" in text
    assert "hip_max_deg = 90.0" in text
    assert "step_length_cm = 30.0" in text
    assert "distance_m = 30.0" in text  # the distance to walk stays in metres


@given(
    stature_m=st.floats(1.2, 2.2),
    mass_kg=st.floats(30, 200),
    clearance_m=st.floats(0.01, 0.2),
    note=st.text(max_size=99),
)
def test_any_profile_in_range_survives_the_file(
    stature_m: float, mass_kg: float, clearance_m: float, note: str
) -> None:
    profile = Profile(
        identifier="p",
        sex=Sex.FEMALE,
        stature_m=stature_m,
        mass_kg=mass_kg,
        gait=GaitParameters(swing_clearance_m=clearance_m),
        note=note if all(char.isprintable() for char in note) else "",
    )
    back = decode(encode(profile), "here")
    assert back.stature_m == pytest.approx(stature_m, abs=1e-10)
    assert back.gait.swing_clearance_m == pytest.approx(clearance_m, abs=1e-10)
    assert (back.mass_kg, back.note) == (profile.mass_kg, profile.note)


def test_comments_survive_a_save(store: ProfileStore, patient: Profile, at: datetime, tmp_path: Path) -> None:
    store.create(patient, by=Named("anna"), at=at)
    path = tmp_path / "profiles" / "P-0042.toml"
    path.write_text(path.read_text().replace("mass_kg = 81.5", "mass_kg = 81.5 # with shoes"))
    store.save(changed(patient, stature_m=1.8), by=Named("anna"), at=at)
    assert "mass_kg = 81.5 # with shoes" in path.read_text()
    assert "stature_cm = 180.0" in path.read_text()


def test_a_calibration_comes_and_goes_without_touching_the_rest(
    store: ProfileStore, patient: Profile, at: datetime
) -> None:
    store.create(patient, by=Named("anna"), at=at)
    one = Calibration(
        camera="c", focal_anchor_px_m=58.0, focal_px=950, distance_m=0.3, residual=0.01, calibrated_at="2026"
    )
    for calibrations in ((one,), (one, msgspec.structs.replace(one, camera="d")), ()):
        wanted = changed(patient, calibrations=calibrations)
        store.save(wanted, by=Named("anna"), at=at)
        assert differences(wanted, store.load("P-0042")) == {}


def test_every_change_is_kept_with_who_and_what(store: ProfileStore, patient: Profile, at: datetime) -> None:
    store.create(patient, by=Named("anna"), at=at)
    longer = changed(patient, gait=GaitParameters(step_length_m=0.4))
    store.save(longer, by=Named("ben"), at=at, why="walks better")
    assert store.save(longer, by=Named("ben"), at=at) is None
    first, second = store.history("P-0042")
    assert first.by == "anna"
    assert second.changes == {"gait.step_length_cm": (30.0, 40.0)}
    assert (second.by, second.why, second.at) == ("ben", "walks better", "2026-03-01T09:30:00+00:00")


def test_archived_patients_leave_the_list_and_stay(store: ProfileStore, patient: Profile, at: datetime) -> None:
    store.create(patient, by=Named("anna"), at=at)
    store.archive("P-0042", by=Named("anna"), at=at)
    assert [one.identifier for one in store.list().profiles] == ["demo"]
    assert [one.identifier for one in store.list(archived=True).profiles] == ["P-0042", "demo"]
    store.archive("P-0042", by=Named("anna"), at=at, archived=False)
    assert not store.load("P-0042").archived


def test_the_demo_patient_needs_no_file_and_can_be_changed(store: ProfileStore, at: datetime) -> None:
    assert store.load("demo") == DEMO_PATIENT
    store.save(changed(DEMO_PATIENT, mass_kg=70.0), by=Named("anna"), at=at)
    assert store.load("demo").mass_kg == 70.0
    assert store.history("demo")[0].changes == {"mass_kg": (65.0, 70.0)}


def test_an_identifier_is_taken_once_whatever_its_case(store: ProfileStore, patient: Profile, at: datetime) -> None:
    store.create(patient, by=Named("anna"), at=at)
    with pytest.raises(ProfileError, match="PATIENT_EXISTS"):
        store.create(changed(patient, identifier="p-0042"), by=Named("anna"), at=at)
    with pytest.raises(ProfileError, match="PATIENT_EXISTS"):
        store.create(changed(patient, identifier="demo"), by=Named("anna"), at=at)


def test_an_imported_identifier_that_differs_in_case_only_is_refused(
    store: ProfileStore, patient: Profile, at: datetime, tmp_path: Path
) -> None:
    store.create(patient, by=Named("anna"), at=at)
    other = ProfileStore(tmp_path / "other")
    other.create(changed(patient, identifier="p-0042"), by=Named("ben"), at=at)
    other.export("p-0042", tmp_path / "out.toml")
    with pytest.raises(ProfileError, match="PATIENT_EXISTS"):
        store.import_file(tmp_path / "out.toml", by=Named("anna"), at=at)
    assert [one.identifier for one in store.list().profiles] == ["P-0042", "demo"]


@pytest.mark.parametrize("name", ["", "../etc", "a/b", "a.b", "ä", "-a", "a" * 41, "a b", "\x1b[2J"])
def test_hostile_identifiers_never_become_paths(store: ProfileStore, patient: Profile, at: datetime, name: str) -> None:
    with pytest.raises(ProfileError, match="IDENTIFIER"):
        store.load(name)
    with pytest.raises(ProfileError, match="IDENTIFIER"):
        store.save(changed(patient, identifier=name), by=Named("anna"), at=at)


def test_export_and_import_carry_a_patient_to_another_home(
    store: ProfileStore, patient: Profile, at: datetime, tmp_path: Path
) -> None:
    store.create(patient, by=Named("anna"), at=at)
    store.export("P-0042", tmp_path / "out.toml")
    other = ProfileStore(tmp_path / "other")
    other.import_file(tmp_path / "out.toml", by=Named("ben"), at=at)
    assert other.load("P-0042") == store.load("P-0042")
    assert other.history("P-0042")[0].why == ChangeCause.IMPORTED.key


@pytest.mark.parametrize(
    ("broken", "message"),
    [
        ('stature_cm = "tall"', "stature_cm"),
        ("stature_cm = 17", "stature_cm value=17.0 low=120 high=220 unit= cm"),
        ("stature_cm = nan", "BAD_NUMBER field=stature_cm"),
        ("stature_m = 1.7", "close=stature_cm"),
        ("stature_cm = ", "TOML"),
        ("hair = 3\nstature_cm = 170", "UNKNOWN_FIELD field=hair"),
        ("stature_cm = 170\n[gait]\nstep_length_cm = []", "gait.step_length_cm"),
        ("stature_cm = 170\n[gait]\nstep_length_cm = 300", "gait.step_length_cm value=300.0 low=5 high=80"),
        ("stature_cm = 170\n[gait]\nstep_lengt_cm = 30", "close=gait.step_length_cm"),
        ("", "missing required field stature_cm"),
    ],
)
def test_a_broken_file_names_field_and_range(store: ProfileStore, tmp_path: Path, broken: str, message: str) -> None:
    path = tmp_path / "profiles" / "x.toml"
    path.parent.mkdir()
    path.write_text(f'identifier = "x"\nsex = "male"\nmass_kg = 80\n{broken}\n')
    with pytest.raises(ProfileError) as caught:
        store.load("x")
    assert message in str(caught.value)
    assert str(path) in str(caught.value)
    ((name, error),) = store.list().broken
    assert (name, str(error)) == ("x.toml", str(caught.value))


@pytest.mark.parametrize("content", [b"\xff\xfe\x00", b"a = 1\n" * 400_000], ids=["not text", "megabytes"])
def test_what_is_no_profile_at_all_is_refused(store: ProfileStore, tmp_path: Path, content: bytes) -> None:
    (tmp_path / "profiles").mkdir()
    (tmp_path / "profiles" / "x.toml").write_bytes(content)
    with pytest.raises(ProfileError, match=r"NOT_UTF8|TOO_LARGE"):
        store.load("x")


@pytest.mark.parametrize("field", RANGES)
def test_each_range_holds_at_its_ends_and_not_beyond(patient: Profile, field: str) -> None:
    low, high = RANGES[field]
    key, factor = file_key(field)
    for shown in (low, high):
        assert violations(with_field(patient, field, shown / factor)) == ()
    for shown in (low - 0.01, high + 0.01, float("nan"), float("inf")):
        (wrong,) = violations(with_field(patient, field, shown / factor))
        assert wrong.field == key
        assert (wrong.code, wrong.values["low"], wrong.values["high"]) == (ProfileFault.OUT_OF_RANGE, low, high)


def test_a_calibration_that_is_no_palm_is_refused(patient: Profile) -> None:
    odd = Calibration(
        camera="c", focal_anchor_px_m=950 * 0.13, focal_px=950, distance_m=0.3, residual=0.01, calibrated_at="2026"
    )
    (wrong,) = violations(changed(patient, calibrations=(odd,)))
    assert (wrong.values["low"], wrong.values["high"]) == (3, 12)


@pytest.mark.parametrize("note", ["x" * 2001, "bell\a", "\x1b[31m"])
def test_notes_are_bounded_and_harmless(patient: Profile, note: str) -> None:
    assert [wrong.field for wrong in violations(changed(patient, note=note))] == ["note"]


@pytest.mark.parametrize(
    "failing",  # call, which one; mass and changes afterwards
    [
        ("fsync", 1, 81.5, 1),
        ("fsync", 2, 81.5, 1),
        ("replace", 1, 81.5, 1),
        ("replace", 2, 81.5, 2),  # the history is in place, the profile is not
        ("fsync", 3, 90.0, 2),  # of the folder
    ],
)
def test_a_full_disk_loses_nothing(
    store: ProfileStore,
    patient: Profile,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    failing: tuple[str, int, float, int],
) -> None:
    call, nth, *left = failing
    store.create(patient, by=Named("anna"), at=AT)
    calls = 0
    owner = os if call == "fsync" else Path
    real = getattr(owner, call)

    def full(*arguments: object) -> object:
        nonlocal calls
        calls += 1
        if calls == nth:
            raise OSError(28, "No space left on device")
        return real(*arguments)

    monkeypatch.setattr(owner, call, full)
    with pytest.raises(ProfileError, match="No space left on device") as caught:
        store.save(changed(patient, mass_kg=90.0), by=Named("anna"), at=AT)
    monkeypatch.undo()
    assert caught.value.code is ProfileFault.NOT_SAVED
    assert [store.load("P-0042").mass_kg, len(store.history("P-0042"))] == left
    assert not list((tmp_path / "profiles").rglob(".*.new"))


def test_a_check_of_the_caller_can_refuse_a_save(patient: Profile, at: datetime, tmp_path: Path) -> None:
    def stairs(profile: Profile) -> None:
        if profile.gait.stair_rise_m > 0.2:
            raise ProfileError(ProfileFault.OUT_OF_RANGE, field="stairs")

    store = ProfileStore(tmp_path, checks=(stairs,))
    store.create(patient, by=Named("anna"), at=at)
    with pytest.raises(ProfileError, match="stairs"):
        store.save(changed(patient, gait=GaitParameters(stair_rise_m=0.25)), by=Named("anna"), at=at)
    assert store.load("P-0042").gait.stair_rise_m == 0.12


def test_a_profile_that_fits_no_longer_is_still_archived_annotated_and_calibrated(
    patient: Profile, at: datetime, tmp_path: Path
) -> None:
    def never(_: Profile) -> None:
        raise ProfileError(ProfileFault.OUT_OF_RANGE, field="stairs")

    ProfileStore(tmp_path).create(patient, by=Named("anna"), at=at)
    store = ProfileStore(tmp_path, checks=(never,))
    kept = changed(patient, note="old leg", press_threshold_m=0.25, palm=Palm(measured_width_m=0.08))
    store.save(kept, by=Named("anna"), at=at)
    store.archive("P-0042", by=Named("anna"), at=at)
    assert store.load("P-0042") == changed(kept, archived=True)
    with pytest.raises(ProfileError, match="stairs"):
        store.save(changed(kept, mass_kg=71.5), by=Named("anna"), at=at)
