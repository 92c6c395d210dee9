"""Outcomes as FHIR, from outside, read back by fhir.resources: equal values, units, dates, and who is named."""

from __future__ import annotations

from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import msgspec
import pytest
from fhir.resources.bundle import Bundle
from fhir.resources.device import Device
from fhir.resources.observation import Observation
from fhir.resources.patient import Patient
from typer.testing import CliRunner

from app.cli import cli
from app.evaluate.outcomes.walks import RecordedWalk, Walk
from app.motion.plan import patient_of
from app.outcomes.fhir import bundle_of
from app.outcomes.session import SessionOutcomes, find_outcomes
from app.system.errors import AppError
from hal.joints.device import DEFAULT_DEVICE, load_exoskeleton
from logs.records import GuidedTestResult
from profiles.schema import DEMO_PATIENT, GaitParameters
from testing.trails import write_sample
from tests.support.disks import full_disk

DEVICE = load_exoskeleton(DEFAULT_DEVICE)
READABLE = {"{steps}": "steps", "{steps}/min": "steps/min"}  # the others are written as UCUM has them
UNITS = {
    "steps": "{steps}",
    "walking_time_s": "s",
    "up_time_s": "s",
    "distance_m": "m",
    "speed_m_s": "m/s",
    "cadence_steps_min": "{steps}/min",
    "step_length_left_m": "m",
    "step_length_right_m": "m",
    "step_time_left_s": "s",
    "step_time_right_s": "s",
    "step_length_asymmetry_percent": "%",
    "step_time_asymmetry_percent": "%",
}


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One session of P-017 with a recording of a short walk."""
    home = tmp_path_factory.mktemp("home")
    profile = msgspec.structs.replace(DEMO_PATIENT, gait=GaitParameters(step_time_s=1.6))
    parameters = {
        name: value for name, value in msgspec.to_builtins(profile).items() if name not in {"note", "identifier"}
    }
    trail = write_sample(home, minutes=0.2, seed=1, parameters=parameters)
    RecordedWalk(patient_of(profile, DEVICE), DEVICE, trail.with_suffix(".mcap")).perform(Walk(strides=1))
    return home


@pytest.fixture(scope="module")
def found(home: Path) -> SessionOutcomes:
    return find_outcomes(home / "logs", "last")


def exported(home: Path, folder: Path, *options: str) -> Any:  # its fields are all optional to mypy
    done = CliRunner().invoke(cli, ["export", "last", "--to", "fhir", "-o", str(folder), "--home", str(home), *options])
    assert done.exit_code == 0, done.output
    (path,) = folder.iterdir()
    return Bundle.model_validate_json(path.read_bytes())


@pytest.mark.parametrize("command", ["export", "outcomes"])
def test_what_a_full_disk_cuts_leaves_the_older_file(home: Path, tmp_path: Path, command: str) -> None:
    path = tmp_path / f"{next((home / 'logs').glob('*.jsonl')).stem}.fhir.json"
    path.write_text("older", encoding="utf-8")
    options = {"export": ["--to", "fhir", "-o", str(tmp_path)], "outcomes": ["--json", str(path)]}[command]
    arguments = [command, "last", "--home", str(home), *options]
    with full_disk(100):
        done = CliRunner().invoke(cli, arguments)
    assert isinstance(done.exception, AppError | OSError)
    assert [(one, one.read_text(encoding="utf-8")) for one in tmp_path.iterdir()] == [(path, "older")]
    assert CliRunner().invoke(cli, arguments).exit_code == 0
    assert path.stat().st_size > 100


def observations(bundle: Any) -> dict[str, Any]:
    found = [entry.resource for entry in bundle.entry]
    read: list[Any] = [one for one in found if isinstance(one, Observation)]
    return {one.code.coding[0].code: one for one in read}


def test_values_and_units_are_those_of_the_measures(home: Path, found: SessionOutcomes, tmp_path: Path) -> None:
    read = observations(exported(home, tmp_path))
    values = {code: read[code].valueQuantity for code in UNITS}
    assert {code: float(one.value) for code, one in values.items()} == {
        code: getattr(found.measures, code) for code in UNITS
    }
    assert {code: one.code for code, one in values.items()} == UNITS
    assert {code: one.unit for code, one in values.items()} == {
        code: READABLE.get(unit, unit) for code, unit in UNITS.items()
    }
    unmeasured = msgspec.structs.replace(found.measures, cadence_steps_min=None)
    others = observations(Bundle.model_validate(bundle_of(msgspec.structs.replace(found, measures=unmeasured))))
    assert read.keys() - others.keys() == {"cadence_steps_min"}, "what was not measured is left out"
    for joint, motion in found.measures.range_of_motion.items():
        bounds = read[f"{joint}_range_of_motion"].valueRange
        assert (float(bounds.low.value), float(bounds.high.value)) == (motion.low_deg, motion.high_deg)


def test_every_observation_names_the_pseudonym_the_device_and_its_time(
    home: Path, found: SessionOutcomes, tmp_path: Path
) -> None:
    bundle = exported(home, tmp_path)
    by_url: dict[str, Any] = {entry.fullUrl: entry.resource for entry in bundle.entry}
    assert len(by_url) == len(bundle.entry)
    began = datetime.fromisoformat(found.began)
    for one in observations(bundle).values():
        patient = by_url[one.subject.reference]
        assert type(patient) is Patient
        assert type(by_url[one.device.reference]) is Device
        assert by_url[one.subject.reference].identifier[0].value == found.patient
        assert one.status == "final"
        assert abs(one.effectivePeriod.start - began) < timedelta(milliseconds=1)


def test_ratings_have_loincs_codes_and_tests_their_own_time(found: SessionOutcomes) -> None:
    test = GuidedTestResult(
        test="ten metre walk",
        outcome="completed",
        started_ns=found.began_ns + 5 * 10**9,
        began_ns=found.began_ns + 6 * 10**9,
        ended_ns=found.began_ns + 31 * 10**9,
        duration_s=25.0,
        distance_m=10.0,
        steps=30,
        speed_m_s=0.4,
    )
    rated = msgspec.structs.replace(found, pain=3, exertion=13, tests=(test,))
    read = observations(Bundle.model_validate(bundle_of(rated)))
    assert read["pain"].valueInteger == 3
    assert [one.code for one in read["pain"].code.coding] == ["pain", "72514-3"]
    assert [one.code for one in read["exertion"].code.coding] == ["exertion", "82289-0"]
    assert read["pain"].category[0].coding[0].code == "survey"
    speed = read["ten_metre_speed"]
    assert float(speed.valueQuantity.value) == 0.4
    began = datetime.fromisoformat(found.began)
    assert abs(speed.effectivePeriod.start - began - timedelta(seconds=6)) < timedelta(milliseconds=1)
    assert abs(speed.effectivePeriod.end - began - timedelta(seconds=31)) < timedelta(milliseconds=1)


def test_deidentified_all_dates_go_back_by_the_same_whole_days(
    home: Path, found: SessionOutcomes, tmp_path: Path
) -> None:
    plain = exported(home, tmp_path / "plain")
    shifted = exported(home, tmp_path / "shifted", "--deidentify")
    (path,) = (tmp_path / "shifted").iterdir()
    assert path.name.startswith(f"{found.patient}-")
    assert found.session not in path.read_text(encoding="utf-8")
    assert found.began[:10] not in path.read_text(encoding="utf-8")
    back = plain.timestamp - shifted.timestamp
    assert timedelta(days=1) <= back <= timedelta(days=365)
    assert back.seconds == back.microseconds == 0
    before, after = observations(plain), observations(shifted)
    assert before.keys() == after.keys()
    for code, one in before.items():
        assert one.effectivePeriod.end - after[code].effectivePeriod.end == back
        assert one.valueQuantity == after[code].valueQuantity


def test_the_shift_is_the_homes_own(home: Path, tmp_path: Path) -> None:
    """The same at each export; its secret is for the owner alone."""
    first, second = (exported(home, tmp_path / name, "--deidentify") for name in ("a", "b"))
    assert first == second
    assert (home / "keys" / "deidentify.key").stat().st_mode & 0o777 == 0o600
