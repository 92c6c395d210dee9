"""A recording that leaves the house: the same joints, no date, nobody's words."""

from __future__ import annotations

from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
from typer.testing import CliRunner

from app.cli import cli
from app.ipc.states import Action, Event
from app.recording import schemas
from app.recording.deidentify import DAY_NS, MOST_DAYS, deidentify
from app.recording.encryption import KEY_BYTES, load_or_make_secret
from app.recording.export import export
from app.recording.read import STAMP, Recording, RecordingReadFault, messages, survey
from app.recording.samples import read_samples
from app.recording.writer import RecordingWriter
from app.system.errors import AppError
from logs.reason import reason
from logs.trail import DiskFault
from tests.app.recording.conftest import Session

BEGAN = "2026-11-22T10:00:00.000Z"


def exported(recorded: Session, folder: Path, form: str) -> Path:
    home = recorded.setup.home
    arguments = ["export", str(recorded.path), "--to", form, "-o", str(folder), "--deidentify", "--home", str(home)]
    done = CliRunner().invoke(cli, arguments)
    assert done.exit_code == 0, done.output
    (path,) = folder.glob(f"*.{form}")
    return path


def test_the_samples_are_the_same_and_the_clock_goes_back_by_whole_days(recorded: Session, tmp_path: Path) -> None:
    path = exported(recorded, tmp_path, "mcap")
    before, after = read_samples(recorded.path), read_samples(path)
    assert np.array_equal(before.values, after.values, equal_nan=True)
    back_ns = set((before.at_ns + before.recording.clock_offset_ns - after.at_ns).tolist())
    assert len(back_ns) == 1
    assert (shift_ns := back_ns.pop()) % DAY_NS == 0
    assert DAY_NS <= shift_ns <= MOST_DAYS * DAY_NS
    for one in messages(Recording(path=path), schemas.JOINT_STATE, schemas.JOINT_SETPOINT):
        when = one.value["timestamp"]
        assert when["sec"] * 10**9 + when["nsec"] == one.at_ns


def test_no_file_tells_when_the_host_was_started(recorded: Session, tmp_path: Path) -> None:
    """It is the same for all patients of a day, so the difference of two files would be that of their shifts."""
    columns = exported(recorded, tmp_path, "csv").read_text(encoding="utf-8").partition("\ntime_s,")
    assert "# wall_minus_monotonic_ns: 0\n" in columns[0]
    first = columns[2].splitlines()[1].split(",")
    samples = read_samples(exported(recorded, tmp_path, "mcap"))
    assert samples.recording.clock_offset_ns == 0
    assert int(first[1]) == samples.at_ns[0] > read_samples(recorded.path).at_ns[0]


def test_trail_log_and_operators_are_left_out_and_nothing_else(recorded: Session, tmp_path: Path) -> None:
    before, after = survey(recorded.path), survey(exported(recorded, tmp_path, "mcap"))
    gone = {schemas.TRAIL, schemas.LOG, schemas.OPERATOR}
    assert after.counts == {topic: count for topic, count in before.counts.items() if topic not in gone}
    assert after.whole


def test_of_a_reason_the_code_and_the_numbers_stay_and_the_texts_go(tmp_path: Path) -> None:
    """A trail that could not be written names its file: session, user, date."""
    path = tmp_path / "20261127T182103Z-6bcb.mcap"
    fault = reason(DiskFault.NOT_WRITTEN, path=Path("/home/anna/logs") / path.name, detail="quota", waiting=3)
    why = reason(Event.AUDIT_WRITE_FAILED, reason=fault, causes=(fault, fault), action=Action.WALK)
    gait = schemas.Gait(
        state="standing",
        action=None,
        progress=0.0,
        effect="refuse",
        armed=True,
        powered=True,
        steps=0,
        distance_walked_m=0.0,
        events=("audit-write-failed",),
        refusal=why,
        refusal_count=1,
        why_not=why,
    )
    verdict = schemas.Verdict(
        frame=1, hand=True, gesture=None, raw_gesture=None, confidence=0.5, votes=1, explanation=why, refusal=None
    )
    writer = RecordingWriter(path, schemas.TOPICS, 10**18, floor_bytes=0)
    writer.add(schemas.GAIT, 1, gait)
    writer.add(schemas.VERDICT, 2, verdict)
    assert writer.finish()
    (copy,) = export(path, "mcap", tmp_path / "out", deidentify("P-017", BEGAN, bytes(KEY_BYTES))).files
    found = {one.topic: one.value for one in messages(Recording(path=copy))}
    bare = {"code": "DiskFault.NOT_WRITTEN", "values": {"path": "…", "detail": "…", "waiting": 3}}
    kept = {"reason": bare, "causes": [bare, bare], "action": {"code": "Action.WALK", "values": {}}}
    kept_why = {"code": "Event.AUDIT_WRITE_FAILED", "values": kept}
    before = {one.topic: one.value for one in messages(Recording(path=path))}
    assert found[schemas.GAIT] == before[schemas.GAIT] | {"refusal": kept_why, "why_not": kept_why}
    assert found[schemas.VERDICT] == before[schemas.VERDICT] | {"explanation": kept_why}


def test_the_file_names_neither_session_nor_operator(recorded: Session, tmp_path: Path) -> None:
    path = exported(recorded, tmp_path, "csv")
    about = path.read_text(encoding="utf-8").partition("time_s,")[0]
    stamp = recorded.setup.session.partition("-")[0]
    assert stamp not in about
    assert stamp[:8] not in path.name
    assert recorded.setup.operator not in about.split()
    assert f"# session: {path.stem}\n" in about
    assert "# dates: shifted" in about


def test_one_patients_sessions_keep_their_distance_in_time() -> None:
    key = bytes(KEY_BYTES)
    first, later = (deidentify("P-017", f"2026-11-{day}T10:00:00.000Z", key) for day in (22, 25))
    assert first.shift_ns == later.shift_ns
    began, again = (datetime.strptime(one.name, f"P-017-{STAMP}") for one in (first, later))
    assert again - began == timedelta(days=3)
    assert deidentify("P-018", BEGAN, key).shift_ns != first.shift_ns
    assert deidentify("P-017", BEGAN, b"\1" * KEY_BYTES).shift_ns != first.shift_ns


def test_the_secret_is_made_once(tmp_path: Path) -> None:
    assert load_or_make_secret(tmp_path / "keys") == load_or_make_secret(tmp_path / "keys")
    assert load_or_make_secret(tmp_path / "others") != load_or_make_secret(tmp_path / "keys")


def test_without_a_patient_it_is_refused(recorded: Session, tmp_path: Path) -> None:
    path = tmp_path / "bare.mcap"
    recording = Recording(path=recorded.path)
    found = list(messages(recording, schemas.JOINT_STATE))
    writer = RecordingWriter(path, schemas.TOPICS, recording.clock_offset_ns)
    for one in found[:10]:
        writer.add(one.topic, one.at_ns, one.data)
    writer.finish()
    done = CliRunner().invoke(cli, ["export", str(path), "--to", "csv", "-o", str(tmp_path / "out"), "--deidentify"])
    assert isinstance(done.exception, AppError)
    assert done.exception.code is RecordingReadFault.NO_PATIENT
    assert not (tmp_path / "out").exists()
