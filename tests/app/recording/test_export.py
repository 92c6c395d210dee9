"""Exported files, read back by other people's readers: equal values, units and axes in the file."""

from __future__ import annotations

import json
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import ezc3d
import numpy as np
import pandas
import pytest
from pyarrow import Table, csv, parquet
from typer.testing import CliRunner

from app.cli import cli
from app.ipc.recording import Picture
from app.recording.deidentify import Deidentified
from app.recording.export import COORDINATES, export, to_c3d, to_csv, to_motion
from app.recording.index import RecordingIndex
from app.recording.pictures import PicturesFile
from app.recording.read import Recording, RecordingReadFault, messages, survey
from app.recording.samples import COLUMNS, ExportFault, Samples, read_samples, unit_of
from app.recording.schemas import JOINT_SETPOINT, JOINT_STATE, TOPICS, TRAIL, JointState, JointStates, time_of
from app.recording.writer import RecordingWriter
from app.system.errors import AppError
from hal.joints.protocol import TICK_HZ, TICK_NS
from logs.records import Recording as PicturesConsent
from tests.app.recording.conftest import Collector, Session
from tests.support.disks import full_disk

ANGLES = [f"{joint}_position_rad" for joint in COORDINATES]


def measured(recorded: Session) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    return np.array([angles for _, angles, _ in recorded.ticks])


def exported(path: Path, form: str, folder: Path, deidentified: Deidentified | None = None) -> Path:
    return export(path, form, folder, deidentified).files[0]


def columns(table: Table, names: list[str]) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    return np.array([table[name].to_numpy() for name in names]).T


def test_samples_are_those_of_control(recorded: Session) -> None:
    samples = read_samples(recorded.path)
    assert samples.at_ns.tolist() == [at_ns for at_ns, _, _ in recorded.ticks]
    assert np.array_equal(samples.values[:, 0], measured(recorded))
    assert np.array_equal(samples.values[:, 3], [commanded for _, _, commanded in recorded.ticks], equal_nan=True)


def test_csv_by_arrow(recorded: Session, tmp_path: Path) -> None:
    path = exported(recorded.path, "csv", tmp_path)
    comments = path.read_text().count("# ")
    table = csv.read_csv(path, csv.ReadOptions(skip_rows=comments))
    assert np.array_equal(columns(table, ANGLES), measured(recorded))
    assert table["monotonic_ns"].to_pylist() == [at_ns for at_ns, _, _ in recorded.ticks]
    assert "flexion positive" in path.read_text().partition("time_s,")[0]


def test_parquet_by_arrow(recorded: Session, tmp_path: Path) -> None:
    path = exported(recorded.path, "parquet", tmp_path)
    schema = parquet.read_schema(path)
    assert "flexion positive" in json.loads(schema.metadata[b"rleex"])["axes"]
    assert {schema.field(name).metadata[b"unit"].decode() for name in COLUMNS} == {"rad", "rad/s", "Nm"}
    assert np.array_equal(columns(parquet.read_table(path), ANGLES), measured(recorded))


def test_tables_by_pandas(recorded: Session, tmp_path: Path) -> None:
    """Every column of every table, bit by bit."""
    samples = read_samples(recorded.path)
    values = samples.values.reshape(len(samples.at_ns), -1)
    whole = [
        pandas.read_parquet(exported(recorded.path, "parquet", tmp_path)),
        pandas.read_csv(exported(recorded.path, "csv", tmp_path), comment="#"),
    ]
    for table in whole:
        assert list(table.columns) == ["time_s", "monotonic_ns", *COLUMNS]
        assert np.array_equal(table[list(COLUMNS)].to_numpy(), values, equal_nan=True)
        assert np.array_equal(table["monotonic_ns"].to_numpy(), samples.at_ns)
    motion = exported(recorded.path, "opensim", tmp_path)
    for path, rows in ((motion, values[:, :4]), (motion.with_suffix(".sto"), values[:, 8:12])):
        lines = path.read_text().partition("endheader\n")[0].count("\n") + 1
        table = pandas.read_csv(path, sep="\t", skiprows=lines)
        assert np.array_equal(table.iloc[:, 1:].to_numpy(), rows, equal_nan=True)


def test_c3d_by_ezc3d(recorded: Session, tmp_path: Path) -> None:
    file = ezc3d.c3d(str(exported(recorded.path, "c3d", tmp_path)))
    analog = file["parameters"]["ANALOG"]
    assert analog["LABELS"]["value"] == list(COLUMNS)
    assert analog["UNITS"]["value"] == [unit_of(name) for name in COLUMNS]
    assert file["header"]["analogs"]["frame_rate"] == 500
    assert "flexion positive" in file["parameters"]["RLEEX"]["AXES"]["value"][0]
    numbers = [COLUMNS.index(name) for name in ANGLES]
    assert np.array_equal(file["data"]["analogs"][0][numbers].T, measured(recorded).astype(np.float32))


def synthetic(ticks: int) -> Samples:
    """Joints that hold another value in each tick and channel."""
    at_ns = np.arange(ticks, dtype=np.int64) * TICK_NS
    values = np.random.default_rng(1).random((ticks, 6, 4))
    return Samples(recording=Recording(path=Path("s.mcap")), at_ns=at_ns, values=values)


@pytest.mark.parametrize("ticks", [65_535, 65_536])
def test_a_c3d_is_read_back_as_long_as_it_was(ticks: int, tmp_path: Path) -> None:
    """Frames are counted in 16 bits; a longer file has several samples in each, and its last may not be full."""
    samples = synthetic(ticks)
    to_c3d(samples, tmp_path / "s.c3d")
    file = ezc3d.c3d(str(tmp_path / "s.c3d"))
    analogs, header = file["data"]["analogs"][0], file["header"]
    assert header["analogs"]["frame_rate"] == TICK_HZ
    assert np.array_equal(analogs[:, :ticks].T, samples.values.reshape(ticks, -1).astype(np.float32))
    assert np.isnan(analogs[:, ticks:]).all()
    assert file["parameters"]["ANALOG"]["RATE"]["value"] == [TICK_HZ]
    assert file["parameters"]["RLEEX"]["SAMPLES"]["value"] == [str(ticks)]


def test_what_no_c3d_can_count_is_refused(tmp_path: Path) -> None:
    """Seven million ticks, of which this holds the first and the last."""
    ends_ns = np.array([0, 7_000_000 * TICK_NS])
    samples = Samples(recording=Recording(path=Path("s.mcap")), at_ns=ends_ns, values=np.zeros((2, 6, 0)))
    with pytest.raises(AppError) as caught:
        to_c3d(samples, tmp_path / "s.c3d")
    assert caught.value.code is ExportFault.TOO_LONG


def test_opensim_as_a_table(recorded: Session, tmp_path: Path) -> None:
    path = exported(recorded.path, "opensim", tmp_path)
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
    path = exported(cut, "mcap", tmp_path / "out")
    before, after = survey(cut), survey(path)
    assert (before.whole, after.whole) == (False, True)
    assert after.counts == before.counts
    with pytest.raises(AppError) as caught:
        exported(cut, "mcap", tmp_path / "out")
    assert caught.value.code is ExportFault.EXISTS


def test_what_a_recording_lost_is_said_of_its_export(recorded: Session, tmp_path: Path) -> None:
    path = tmp_path / recorded.path.name
    writer = RecordingWriter(path, TOPICS, 0)
    for one in messages(Recording(path=recorded.path), JOINT_STATE, JOINT_SETPOINT):
        writer.add(one.topic, one.at_ns, one.data)
    writer.lost.update({JOINT_STATE: 3, TRAIL: 2})
    assert writer.finish()
    assert survey(exported(path, "mcap", tmp_path / "out")).lost == {JOINT_STATE: 3, TRAIL: 2}
    shifted = Deidentified("P-017", 0)
    assert survey(exported(path, "mcap", tmp_path / "out", shifted)).lost == {JOINT_STATE: 3}
    lost = f"# lost: {JOINT_STATE} 3, {JOINT_SETPOINT} 0\n"
    assert lost in exported(path, "csv", tmp_path / "out").read_text(encoding="utf-8")
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
        exported(empty, "csv", tmp_path)
    assert caught.value.code is ExportFault.NO_SAMPLES


def test_a_cut_file_is_exported_to_where_it_ends_and_that_is_said(recorded: Session, tmp_path: Path) -> None:
    cut = tmp_path / recorded.path.name
    cut.write_bytes(recorded.path.read_bytes()[: recorded.path.stat().st_size // 2])
    for path, said in ((cut, True), (recorded.path, False)):
        done = CliRunner().invoke(
            cli, ["export", str(path), "--to", "csv", "--output", str(tmp_path / path.parent.name)]
        )
        assert done.exit_code == 0, done.output
        assert ("cut off or damaged" in done.output.replace("\n", " ")) is said


def test_late_ticks_hold_the_sample_before(recorded: Session) -> None:
    samples = read_samples(recorded.path)
    kept = np.r_[0:100, 103:200]
    thinned = type(samples)(recording=samples.recording, at_ns=samples.at_ns[kept], values=samples.values[kept])
    even = thinned.at_rate()
    assert len(even.at_ns) == 200
    assert np.array_equal(even.values[100:103], np.repeat(samples.values[99:100], 3, axis=0))
    assert np.array_equal(even.values[103:], samples.values[103:200])


def with_damage(recorded: Session, path: Path) -> Path:
    """A copy with one byte of its last chunk changed."""
    data = bytearray(recorded.path.read_bytes())
    with RecordingIndex(recorded.path) as index:
        data[index._places[-1].offset + 200] ^= 0xFF
    path.write_bytes(data)
    return path


def test_a_damaged_file_is_exported_to_there_and_that_is_said_with_it(recorded: Session, tmp_path: Path) -> None:
    damaged, copied = with_damage(recorded, tmp_path / recorded.path.name), tmp_path / "out" / recorded.path.name
    for form in ("csv", "mcap"):
        done = CliRunner().invoke(cli, ["export", str(damaged), "--to", form, "-o", str(copied.parent)])
        assert done.exit_code == 0, done.output
        assert "cut off or damaged" in done.output.replace("\n", " ")
    copy = survey(copied)
    assert (copy.whole, copy.damage, copy.source_damage, copy.complete) == (True, "", survey(damaged).damage, False)
    assert "a copy of a recording" in CliRunner().invoke(cli, ["recording", "info", str(copied)]).output
    for path in (copied.with_suffix(".csv"), exported(copied, "csv", tmp_path / "again")):
        assert "# whole: false\n# lost: unknown\n" in path.read_text(encoding="utf-8")


@pytest.mark.parametrize("form", ["mcap", "csv", "opensim"])
def test_an_export_that_fails_leaves_no_file_and_may_be_repeated(recorded: Session, tmp_path: Path, form: str) -> None:
    with full_disk(20_000), pytest.raises(AppError) as caught:
        export(recorded.path, form, tmp_path)
    assert caught.value.code is ExportFault.UNWRITABLE
    assert not list(tmp_path.iterdir())
    files = export(recorded.path, form, tmp_path).files
    assert sorted(tmp_path.iterdir()) == sorted(files)


def test_every_file_that_was_written_is_named(recorded: Session, tmp_path: Path) -> None:
    done = CliRunner().invoke(cli, ["export", str(recorded.path), "--to", "opensim", "-o", str(tmp_path)])
    assert done.exit_code == 0, done.output
    for suffix in (".mot", ".sto"):
        assert f"{recorded.setup.session}{suffix}." in done.output.replace("\n", "")


@pytest.mark.parametrize("form", ["mcap", "csv"])
def test_pictures_are_never_exported(tmp_path: Path, form: str) -> None:
    pictures = PicturesFile(tmp_path, "s", 0, Collector())
    pictures.follow(PicturesConsent(on=True, consent=True))
    pictures.take(Picture(captured_ns=1, image_jpeg=b"x"), 0)
    pictures.close()
    done = CliRunner().invoke(cli, ["export", str(pictures.path), "--to", form, "-o", str(tmp_path / "out")])
    assert isinstance(done.exception, AppError)
    assert done.exception.code is ExportFault.PICTURES
    assert not (tmp_path / "out").exists()


def test_an_hours_joints_fit_into_memory(tmp_path: Path) -> None:
    """30 s here; as lists of lists they had taken 31 MB."""
    writer, rng = RecordingWriter(tmp_path / "s.mcap", TOPICS, 0), np.random.default_rng(1)
    for number, values in enumerate(rng.random((30 * TICK_HZ, 4, 3)).tolist()):
        at_ns = number * TICK_NS
        joints = tuple(JointState(name, *three) for name, three in zip(COORDINATES, values, strict=True))
        for topic in (JOINT_STATE, JOINT_SETPOINT):
            writer.add(topic, at_ns, JointStates(time_of(at_ns), joints))
        writer.settle(at_ns)
    assert writer.finish()
    tracemalloc.start()
    try:
        samples = read_samples(writer.path)
        _, most_bytes = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert samples.values.shape == (30 * TICK_HZ, 6, 4)
    assert most_bytes < 12e6


@pytest.mark.parametrize("write", [to_csv, to_motion])
def test_an_hours_table_fits_into_memory(write: Callable[[Samples, Path], None], tmp_path: Path) -> None:
    """40 s here; beside the samples all rows at once as Python's numbers had taken 20 and 6 MB."""
    samples = synthetic(40 * TICK_HZ)
    tracemalloc.start()
    try:
        write(samples, tmp_path / "s")
        _, most_bytes = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert most_bytes < samples.values.nbytes + 2e6  # on the grid of 500 Hz, and a slice
