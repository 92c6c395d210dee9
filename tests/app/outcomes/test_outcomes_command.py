"""`rleex outcomes` from outside, and the measures beside MuJoCo's truth."""

from __future__ import annotations

import json
import os
from pathlib import Path

import msgspec
import pytest
from typer.testing import CliRunner

from app.cli import cli
from app.evaluate.outcomes.compare import Case, compare
from app.evaluate.outcomes.walks import RecordedWalk, Walk
from app.motion.plan import patient_of
from app.outcomes import history
from app.outcomes.history import HistoryFault, kept_outcomes, outcomes_of, outcomes_of_patient, trails_of
from app.outcomes.session import OutcomesFault, OutcomeSource, find_outcomes
from app.recording.read import RecordingReadFault
from app.recording.schemas import TOPICS
from app.recording.writer import LIBRARY, VERSION, RecordingWriter
from app.system.errors import AppError
from app.system.paths import Home
from hal.joints.device import DEFAULT_DEVICE, load_exoskeleton
from logs.line import seal
from logs.read import records
from logs.records import ActionEnd, VocabularyEnrolled
from profiles.schema import DEMO_PATIENT, DoseTargets, GaitParameters
from testing.trails import write_sample

DEVICE = load_exoskeleton(DEFAULT_DEVICE)


@pytest.mark.parametrize(
    ("name", "walk"),
    [("even", Walk(strides=1)), ("uneven", Walk(steps=5, length_m=(0.22, 0.34), time_s=(2.6, 2.0)))],
)
def test_within_one_percent_of_mujoco(name: str, walk: Walk) -> None:
    (found,) = compare([Case(name=name, profile=DEMO_PATIENT, walk=walk)], DEVICE)
    assert found.measured.steps == found.true.steps
    assert found.passed, found.errors
    asymmetry = found.measured.step_length_asymmetry_percent
    assert asymmetry is not None
    assert (asymmetry > 30) == (name == "uneven")


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two sessions of P-017, the first with a recording of a short walk; one of P-018."""
    home = tmp_path_factory.mktemp("home")
    gait = GaitParameters(step_time_s=1.6)
    profile = msgspec.structs.replace(DEMO_PATIENT, gait=gait)
    parameters = {
        name: value for name, value in msgspec.to_builtins(profile).items() if name not in {"note", "identifier"}
    }
    first = write_sample(home, minutes=0.2, seed=1, parameters=parameters)
    write_sample(home, minutes=0.2, seed=2)
    write_sample(home, minutes=0.2, seed=3, patient="P-018")
    RecordedWalk(patient_of(profile, DEVICE), DEVICE, first.with_suffix(".mcap")).perform(Walk(strides=1))
    return home


def sessions(home: Path) -> list[str]:
    return [path.stem for path in sorted((home / "logs").glob("*-000?.jsonl"))]


def run(*arguments: str) -> tuple[int, str]:
    done = CliRunner().invoke(cli, list(arguments))
    return done.exit_code, done.output + str(done.exception or "")


def test_a_patients_sessions_in_a_table_and_as_json(home: Path, tmp_path: Path) -> None:
    first, second, _ = sessions(home)
    code, text = run("outcomes", "--patient", "P-017", "--home", str(home), "--json", str(tmp_path / "o.json"))
    assert code == 0, text
    assert "distance walked, m" in text
    assert "4 / 100 (4%)" in text  # dose
    assert "±0.16" in text
    assert "speed, m/s, ±0.16: minimal important change, in 283 people" in text
    assert f"{second} has no recording" in text
    recorded, trail = json.loads((tmp_path / "o.json").read_bytes())
    assert (recorded["session"], recorded["source"]) == (first, "recording")
    assert recorded["measures"]["steps"] == 4
    assert 0.8 < recorded["measures"]["distance_m"] < 0.9
    assert trail["source"] == "trail"
    assert trail["measures"]["distance_m"] is None


def test_sessions_of_several_patients_are_refused(home: Path) -> None:
    first, _, third = sessions(home)
    with pytest.raises(AppError) as caught:
        outcomes_of(home / "logs", [first, third])
    assert caught.value.code is HistoryFault.OTHER_PATIENTS
    assert caught.value.values["patients"] == "P-017, P-018"
    with pytest.raises(AppError) as caught:
        outcomes_of_patient(Home(home), "P-999")
    assert caught.value.code is HistoryFault.NO_SESSIONS


def test_an_unreadable_session_is_named_and_the_others_are_told(home: Path, tmp_path: Path) -> None:
    first, second, _ = sessions(home)
    logs = tmp_path / "logs"
    logs.mkdir()
    for name in (f"{first}.jsonl", f"{second}.jsonl"):
        (logs / name).write_bytes((home / "logs" / name).read_bytes())
    (logs / f"{first}.mcap").write_bytes(b"no recording")
    found, refused = outcomes_of_patient(Home(tmp_path), "P-017")
    assert [one.session for one in found] == [second]
    assert [error.code for error in refused] == [RecordingReadFault.NOT_MCAP]
    code, text = run("outcomes", "--patient", "P-017", "--home", str(tmp_path))
    assert code == 0
    assert f"{first}.mcap" in text
    (logs / f"{second}.jsonl").unlink()
    code, text = run("outcomes", "--patient", "P-017", "--home", str(tmp_path))
    assert code != 0


def test_trainings_and_enrolments_are_no_sessions_of_the_patient(tmp_path: Path) -> None:
    ended = VocabularyEnrolled(patient="P-017", vocabulary=("5",))
    session = write_sample(tmp_path, minutes=0.05, seed=1, purpose="session")
    older = write_sample(tmp_path, minutes=0.05, seed=2)  # of a time that recorded no purpose
    write_sample(tmp_path, minutes=0.05, seed=3, of_console=(ended,))
    write_sample(tmp_path, minutes=0.05, seed=4, purpose="training")
    write_sample(tmp_path, minutes=0.05, seed=5, purpose="enrolment")
    write_sample(tmp_path, minutes=0.05, seed=6, purpose="session", patient="P-018")
    assert trails_of(tmp_path / "logs", "P-017") == ([session, older], [])


def trail_and_recording(home: Path, folder: Path) -> tuple[Path, Path]:
    """The first session's, copied."""
    first, *_ = sessions(home)
    copies = folder / f"{first}.jsonl", folder / f"{first}.mcap"
    for path in copies:
        path.write_bytes((home / "logs" / path.name).read_bytes())
    return copies


def test_what_was_measured_stays_when_its_recording_is_deleted(home: Path, tmp_path: Path) -> None:
    trail, recording = trail_and_recording(home, tmp_path)
    kept = tmp_path / "outcomes"
    measured = kept_outcomes(kept, trail)
    assert measured.measures.distance_m is not None
    recording.unlink()
    assert kept_outcomes(kept, trail) == measured
    recording.write_bytes(b"another")
    with pytest.raises(AppError):  # it is measured again
        kept_outcomes(kept, trail)
    recording.unlink()
    trail.write_bytes(trail.read_bytes() + trail.read_bytes().splitlines(keepends=True)[-1])
    assert kept_outcomes(kept, trail).source is OutcomeSource.TRAIL


@pytest.mark.parametrize(("copied", "newer"), [(True, False), (False, True), (True, True)])
def test_what_a_deleted_recording_gave_outlives_a_copy_of_the_home_and_new_definitions(
    home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, copied: bool, newer: bool
) -> None:
    trail, recording = trail_and_recording(home, tmp_path)
    measured = kept_outcomes(tmp_path / "outcomes", trail)
    assert measured.source is OutcomeSource.RECORDING
    recording.unlink()
    if copied:
        os.utime(trail, ns=(0, 0))
    if newer:
        monkeypatch.setattr(history, "DEFINITIONS", history.DEFINITIONS + 1)
    assert kept_outcomes(tmp_path / "outcomes", trail) == measured
    assert kept_outcomes(tmp_path / "outcomes", trail) == measured


def test_what_a_deleted_recording_gave_an_older_version_is_not_written_over(home: Path, tmp_path: Path) -> None:
    trail, recording = trail_and_recording(home, tmp_path)
    kept_outcomes(tmp_path / "outcomes", trail)
    (kept,) = (tmp_path / "outcomes").iterdir()
    older = kept.read_bytes().replace(b'"measured_s"', b'"seconds"')
    kept.write_bytes(older)
    recording.unlink()
    assert kept_outcomes(tmp_path / "outcomes", trail).source is OutcomeSource.TRAIL
    assert kept.read_bytes() == older


def test_sessions_are_told_once_in_order_and_of_the_patient_asked_for(home: Path) -> None:
    first, second, third = sessions(home)
    logs = home / "logs"
    assert [one.session for one in outcomes_of(logs, [second, first, second])] == [first, second]
    assert [one.session for one in outcomes_of(logs, [third, second], "P-018")] == [third]
    with pytest.raises(AppError) as caught:
        outcomes_of(logs, [first], "P-018")
    assert caught.value.code is HistoryFault.NO_SESSIONS


def test_two_files_with_one_session_name_are_refused_by_their_paths(home: Path, tmp_path: Path) -> None:
    """The trails of two computers have one name; the second one had taken the place of the first."""
    _, second, _ = sessions(home)
    laptop, exoskeleton = home / "logs" / f"{second}.jsonl", tmp_path / f"{second}.jsonl"
    exoskeleton.write_bytes(laptop.read_bytes())
    with pytest.raises(AppError) as caught:
        outcomes_of(home / "logs", [second, str(exoskeleton)])
    assert caught.value.code is HistoryFault.ONE_NAME
    assert caught.value.values == {"session": second, "first": laptop, "second": exoskeleton}
    link = tmp_path / "logs"
    link.symlink_to(home / "logs")
    (one,) = outcomes_of(home / "logs", [second, str(link / laptop.name), str(laptop)])
    assert one.session == second


def test_a_trail_and_its_recording_are_one_session(home: Path) -> None:
    first, *_ = sessions(home)
    (one,) = outcomes_of(home / "logs", [first, str(home / "logs" / f"{first}.mcap")])
    assert one.session == first


def test_a_cut_recording_is_measured_as_far_as_it_goes(home: Path, tmp_path: Path) -> None:
    first, *_ = sessions(home)
    whole = (home / "logs" / f"{first}.mcap").read_bytes()
    (tmp_path / f"{first}.jsonl").write_bytes((home / "logs" / f"{first}.jsonl").read_bytes())
    (tmp_path / f"{first}.mcap").write_bytes(whole[: len(whole) // 2])
    cut = find_outcomes(tmp_path, first)
    assert cut.source is OutcomeSource.CUT_RECORDING
    assert cut.measures.steps in {1, 2, 3}
    assert cut.measured_s < find_outcomes(home / "logs", first).measured_s
    assert "cut or damaged" in run("outcomes", str(tmp_path / f"{first}.mcap"))[1]


def test_newer_empty_and_unnamed_recordings(home: Path, tmp_path: Path) -> None:
    first, second, _ = sessions(home)
    data = (home / "logs" / f"{first}.mcap").read_bytes()
    newer = tmp_path / f"{first}.mcap"
    newer.write_bytes(data.replace(f"{LIBRARY} {VERSION}".encode(), f"{LIBRARY} {VERSION + 1}".encode(), 1))
    with pytest.raises(AppError) as caught:
        find_outcomes(tmp_path, str(newer))
    assert caught.value.code is RecordingReadFault.NEWER
    newer.write_bytes(data)
    with pytest.raises(AppError) as caught:
        find_outcomes(tmp_path, str(newer))  # no trail beside it, none within
    assert caught.value.code is OutcomesFault.NO_PATIENT
    (tmp_path / f"{second}.jsonl").write_bytes((home / "logs" / f"{second}.jsonl").read_bytes())
    other = tmp_path / f"{second}.mcap"
    other.write_bytes(data)
    with pytest.raises(AppError) as caught:
        find_outcomes(tmp_path, second)  # its trail holds no profile
    assert caught.value.code is OutcomesFault.NO_LENGTHS


def test_the_report_prints_them(home: Path, tmp_path: Path) -> None:
    first, second, _ = sessions(home)
    page = tmp_path / "report.html"
    assert run("audit", "report", first, "--home", str(home), "-o", str(page))[0] == 0
    text = page.read_text()
    assert "distance walked, m" in text
    assert "±0.16" in text
    assert "Tilson" in text, "where the minimal important change is from"
    assert run("audit", "report", second, "--home", str(home), "-o", str(page))[0] == 0
    assert "has no recording" in page.read_text()
    assert run("--language", "zh", "audit", "report", first, "--home", str(home), "-o", str(page))[0] == 0
    assert "行走距离" in page.read_text()


def test_a_trail_alone_counts_each_step_once(tmp_path: Path) -> None:
    """An action's end holds the steps of its session so far, stairs among them."""
    trail = write_sample(tmp_path, minutes=2)
    ends = [one.body for one in records(trail) if isinstance(one.body, ActionEnd)]
    taken = sum(end.action.startswith("step") for end in ends)
    assert taken > 6
    assert find_outcomes(tmp_path / "logs", trail.stem).measures.steps == taken


def test_a_session_without_walking_says_so(tmp_path: Path) -> None:
    parameters = {name: value for name, value in msgspec.to_builtins(DEMO_PATIENT).items() if name != "identifier"}
    trail = write_sample(tmp_path, minutes=0.01, parameters=parameters)
    RecordedWalk(patient_of(DEMO_PATIENT, DEVICE), DEVICE, trail.with_suffix(".mcap")).perform(Walk())
    code, text = run("outcomes", trail.stem, "--home", str(tmp_path))
    assert code == 0, text
    assert "no walking on the level" in text
    found = find_outcomes(tmp_path / "logs", trail.stem).measures
    assert (found.steps, found.distance_m, found.speed_m_s, found.range_of_motion) == (0, None, None, {})
    assert found.up_time_s == pytest.approx(4.0, abs=0.01)


def test_what_the_other_computer_knows_of_a_session_is_left_out_and_that_is_said(tmp_path: Path) -> None:
    """The laptop's trail has no record of control, and its recording no joints."""
    dose = {"dose": msgspec.to_builtins(DoseTargets(steps=80, duration_s=600.0))}
    trail = write_sample(tmp_path, minutes=0.5, parameters=dose)
    lines = [json.loads(line) for line in trail.read_bytes().splitlines()]
    lines[0]["body"]["configuration"] = {"joints": {"host": "exo.local:7447"}}
    of_laptop = [line for line in lines if line["process"] not in {"control", "planner"} and line.pop("hash")]
    trail.write_bytes(b"".join(seal(json.dumps(line).encode())[0] for line in of_laptop))
    for recorded in (False, True):
        if recorded:
            assert RecordingWriter(trail.with_suffix(".mcap"), TOPICS, 0).finish()
        code, text = run("outcomes", trail.stem, "--home", str(tmp_path))
        assert code == 0, text
        assert "exo.local:7447" in text
        assert "/ 80" not in text
        assert "no walking" not in text
        found = find_outcomes(tmp_path / "logs", trail.stem)
        assert (found.measures.steps, found.measures.walking_time_s, found.actions) == (None, None, {})
        assert found.dose is not None
        assert (found.dose.steps, found.dose.duration_s > 0) == (None, True)
        assert found.discomfort == 2
