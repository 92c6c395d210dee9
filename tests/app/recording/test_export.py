"""Exported files, read back by other people's readers: equal values, units and axes in the file."""

from __future__ import annotations

import json
from pathlib import Path

import ezc3d
import numpy as np
import pandas
import pytest
from pyarrow import Table, csv, parquet
from typer.testing import CliRunner

from app.cli import cli
from app.recording.deidentify import Deidentified
from app.recording.export import COLUMNS, COORDINATES, ExportFault, export, read_samples, unit_of
from app.recording.read import Recording, RecordingReadFault, messages, survey
from app.recording.schemas import JOINT_SETPOINT, JOINT_STATE, TOPICS, TRAIL
from app.recording.writer import RecordingWriter
from app.system.errors import AppError
from tests.app.recording.conftest import Session

ANGLES = [f"{joint}_position_rad" for joint in COORDINATES]


def measured(recorded: Session) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    return np.array([angles for _, angles, _ in recorded.ticks])


def columns(table: Table, names: list[str]) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    return np.array([table[name].to_numpy() for name in names]).T


def test_samples_are_those_of_control(recorded: Session) -> None:
    samples = read_samples(recorded.path)
    assert samples.at_ns.tolist() == [at_ns for at_ns, _, _ in recorded.ticks]
    assert np.array_equal(samples.values[:, 0], measured(recorded))
    assert np.array_equal(samples.values[:, 3], [commanded for _, _, commanded in recorded.ticks])


def test_csv_by_arrow(recorded: Session, tmp_path: Path) -> None:
    path = export(recorded.path, "csv", tmp_path)
    comments = path.read_text().count("# ")
    table = csv.read_csv(path, csv.ReadOptions(skip_rows=comments))
    assert np.array_equal(columns(table, ANGLES), measured(recorded))
    assert table["monotonic_ns"].to_pylist() == [at_ns for at_ns, _, _ in recorded.ticks]
    assert "flexion positive" in path.read_text().partition("time_s,")[0]


def test_parquet_by_arrow(recorded: Session, tmp_path: Path) -> None:
    path = export(recorded.path, "parquet", tmp_path)
    schema = parquet.read_schema(path)
    assert "flexion positive" in json.loads(schema.metadata[b"rleex"])["axes"]
    assert {schema.field(name).metadata[b"unit"].decode() for name in COLUMNS} == {"rad", "rad/s", "Nm"}
    assert np.array_equal(columns(parquet.read_table(path), ANGLES), measured(recorded))


def test_tables_by_pandas(recorded: Session, tmp_path: Path) -> None:
    """Every column of every table, bit by bit."""
    samples = read_samples(recorded.path)
    values = samples.values.reshape(len(samples.at_ns), -1)
    whole = [
        pandas.read_parquet(export(recorded.path, "parquet", tmp_path)),
        pandas.read_csv(export(recorded.path, "csv", tmp_path), comment="#"),
    ]
    for table in whole:
        assert list(table.columns) == ["time_s", "monotonic_ns", *COLUMNS]
        assert np.array_equal(table[list(COLUMNS)].to_numpy(), values, equal_nan=True)
        assert np.array_equal(table["monotonic_ns"].to_numpy(), samples.at_ns)
    motion = export(recorded.path, "opensim", tmp_path)
    for path, rows in ((motion, values[:, :4]), (motion.with_suffix(".sto"), values[:, 8:12])):
        lines = path.read_text().partition("endheader\n")[0].count("\n") + 1
        table = pandas.read_csv(path, sep="\t", skiprows=lines)
        assert np.array_equal(table.iloc[:, 1:].to_numpy(), rows, equal_nan=True)


def test_c3d_by_ezc3d(recorded: Session, tmp_path: Path) -> None:
    file = ezc3d.c3d(str(export(recorded.path, "c3d", tmp_path)))
    analog = file["parameters"]["ANALOG"]
    assert analog["LABELS"]["value"] == list(COLUMNS)
    assert analog["UNITS"]["value"] == [unit_of(name) for name in COLUMNS]
    assert file["header"]["analogs"]["frame_rate"] == 500
    assert "flexion positive" in file["parameters"]["RLEEX"]["AXES"]["value"][0]
    numbers = [COLUMNS.index(name) for name in ANGLES]
    assert np.array_equal(file["data"]["analogs"][0][numbers].T, measured(recorded).astype(np.float32))


def test_opensim_as_a_table(recorded: Session, tmp_path: Path) -> None:
    path = export(recorded.path, "opensim", tmp_path)
    head, _, _ = path.read_text().partition("endheader\n")
    assert "inDegrees=no" in head
    assert f"nRows={len(recorded.ticks)}" in head
    options = csv.ReadOptions(skip_rows=head.count("\n") + 1)
    table = csv.read_csv(path, options, csv.ParseOptions(delimiter="\t"))
    assert np.array_equal(columns(table, list(COORDINATES.values())), measured(recorded))
    assert np.allclose(np.diff(table["time"].to_numpy()), 0.002)
    assert path.with_suffix(".sto").exists()


def test_mcap_of_a_cut_file_is_whole(recorded: Session, tmp_path: Path) -> None:
    cut = tmp_path / recorded.path.name
    cut.write_bytes(recorded.path.read_bytes()[:-100])
    path = export(cut, "mcap", tmp_path / "out")
    before, after = survey(cut), survey(path)
    assert (before.whole, after.whole) == (False, True)
    assert after.counts == before.counts
    with pytest.raises(AppError) as caught:
        export(cut, "mcap", tmp_path / "out")
    assert caught.value.code is ExportFault.EXISTS


def test_what_a_recording_lost_is_said_of_its_export(recorded: Session, tmp_path: Path) -> None:
    path = tmp_path / recorded.path.name
    writer = RecordingWriter(path, TOPICS, 0)
    for one in messages(Recording(path=recorded.path), JOINT_STATE, JOINT_SETPOINT):
        writer.add(one.topic, one.at_ns, one.data)
    writer.lost.update({JOINT_STATE: 3, TRAIL: 2})
    assert writer.finish()
    assert survey(export(path, "mcap", tmp_path / "out")).lost == {JOINT_STATE: 3, TRAIL: 2}
    shifted = Deidentified("P-017", 0)
    assert survey(export(path, "mcap", tmp_path / "out", shifted)).lost == {JOINT_STATE: 3}
    lost = f"# lost: {JOINT_STATE} 3, {JOINT_SETPOINT} 0\n"
    assert lost in export(path, "csv", tmp_path / "out").read_text(encoding="utf-8")
    path.write_bytes(path.read_bytes()[:-100])
    assert read_samples(path).about["lost"] == "unknown"


def test_the_command_and_what_it_refuses(recorded: Session, tmp_path: Path) -> None:
    done = CliRunner().invoke(cli, ["export", str(recorded.path), "--to", "csv", "--output", str(tmp_path)])
    assert done.exit_code == 0, done.output
    assert (tmp_path / f"{recorded.setup.session}.csv").exists()
    with pytest.raises(AppError) as caught:
        CliRunner().invoke(
            cli,
            ["export", str(recorded.path), "nobody", "--to", "csv", "--output", str(tmp_path / "none")],
            catch_exceptions=False,
        )
    assert caught.value.code is RecordingReadFault.NO_RECORDING
    assert not (tmp_path / "none").exists(), "the first is not written when the second is not there"
    empty = tmp_path / "empty.mcap"
    assert RecordingWriter(empty, TOPICS, 0).finish()
    with pytest.raises(AppError) as caught:
        export(empty, "csv", tmp_path)
    assert caught.value.code is ExportFault.NO_SAMPLES


def test_a_cut_file_is_exported_to_where_it_ends_and_that_is_said(recorded: Session, tmp_path: Path) -> None:
    cut = tmp_path / recorded.path.name
    cut.write_bytes(recorded.path.read_bytes()[: recorded.path.stat().st_size // 2])
    for path, said in ((cut, True), (recorded.path, False)):
        done = CliRunner().invoke(
            cli, ["export", str(path), "--to", "csv", "--output", str(tmp_path / path.parent.name)]
        )
        assert done.exit_code == 0, done.output
        assert ("was cut off" in done.output.replace("\n", " ")) is said


def test_late_ticks_hold_the_sample_before(recorded: Session) -> None:
    samples = read_samples(recorded.path)
    kept = np.r_[0:100, 103:200]
    thinned = type(samples)(recording=samples.recording, at_ns=samples.at_ns[kept], values=samples.values[kept])
    even = thinned.at_rate()
    assert len(even.at_ns) == 200
    assert np.array_equal(even.values[100:103], np.repeat(samples.values[99:100], 3, axis=0))
    assert np.array_equal(even.values[103:], samples.values[103:200])
