"""A recording in other people's formats: Parquet, CSV, C3D, OpenSim's motion and storage files, MCAP joined and whole.

Every file says its units and axes. Angles in radians at the joint, hip and knee flexion positive, standing = 0;
torques in Nm in the same direction.
"""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum, auto
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import MCAP0_MAGIC
from numpy.typing import NDArray

from app.recording import schemas
from app.recording.deidentify import KEPT_TOPICS, Deidentified
from app.recording.encryption import open_recording
from app.recording.read import Recording, RecordingReadFault, messages, session_of
from app.recording.schemas import JOINT_FIELDS
from app.recording.writer import RecordingWriter
from app.system.errors import AppError
from hal.joints.device import JOINT_NAMES
from hal.joints.protocol import TICK_HZ, TICK_NS
from logs.reading.errors import cause_of

QUANTITIES = ("position_rad", "velocity_rad_s", "torque_nm", "target_rad", "target_velocity_rad_s", "feedforward_nm")
COLUMNS = tuple(f"{joint}_{quantity}" for quantity in QUANTITIES for joint in JOINT_NAMES)
ABOUT = {
    "axes": "angles at the joint; hip and knee flexion positive, standing = 0; torques in the same direction",
    "units": "in each column's name: rad, rad/s, Nm, s",
    "time": "time_s: since the first sample; monotonic_ns + wall_minus_monotonic_ns = UTC since 1970",
    "missing": "a quantity that was not measured is NaN",
}
DATES_SHIFTED = {"dates": "shifted by whole days, the same for all sessions of a patient"}
# The coordinates of Rajagopal's full-body model (2016), whose hips and knees flex positive as ours do.
COORDINATES = {
    "left_hip": "hip_flexion_l",
    "left_knee": "knee_angle_l",
    "right_hip": "hip_flexion_r",
    "right_knee": "knee_angle_r",
}


class ExportFault(Enum):
    """Why a recording is not exported."""

    NO_SAMPLES = auto()  # path
    EXISTS = auto()  # path
    UNWRITABLE = auto()  # path, detail


@dataclass(frozen=True, slots=True, kw_only=True)
class Samples:
    """The joints of a recording: times (n,), values (n, 6, 4) in the order of QUANTITIES and Joint."""

    recording: Recording
    at_ns: NDArray[np.int64]
    values: NDArray[np.float64]
    deidentified: Deidentified | None = None

    @property
    def time_s(self) -> NDArray[np.float64]:
        """Since the first sample."""
        since: NDArray[np.float64] = (self.at_ns - self.at_ns[0]) / 1e9
        return since

    @property
    def columns(self) -> dict[str, NDArray[Any]]:
        """By name, in COLUMNS' order, after both times."""
        flat = self.values.reshape(len(self.at_ns), -1)
        times: dict[str, NDArray[Any]] = {"time_s": self.time_s, "monotonic_ns": self.at_ns}
        return times | {name: flat[:, number] for number, name in enumerate(COLUMNS)}

    @property
    def about(self) -> dict[str, str]:
        """Session, clock, units and axes."""
        recording, deidentified = self.recording, self.deidentified
        session = deidentified.name if deidentified else session_of(recording.path)
        clock_ns = recording.clock_offset_ns + (deidentified.shift_ns if deidentified else 0)
        found = {"session": session, "whole": str(recording.whole).lower(), "lost": _lost_joints(recording)} | ABOUT
        return found | {"wall_minus_monotonic_ns": str(clock_ns)} | (DATES_SHIFTED if deidentified else {})

    def at_rate(self) -> Samples:
        """On a grid of control's rate, for formats without times: each tick's newest sample, late ones held."""
        ticks = round((int(self.at_ns[-1]) - int(self.at_ns[0])) / TICK_NS) + 1
        grid_ns = self.at_ns[0] + np.arange(ticks, dtype=np.int64) * TICK_NS
        newest = np.searchsorted(self.at_ns, grid_ns + TICK_NS // 2, side="right") - 1
        return replace(self, at_ns=grid_ns, values=self.values[newest])


def read_samples(path: Path) -> Samples:
    """Measured and commanded joints, tick by tick. Raises AppError."""
    recording = Recording(path=path)
    found: dict[str, dict[int, list[list[float]]]] = {schemas.JOINT_STATE: {}, schemas.JOINT_SETPOINT: {}}
    for one in messages(recording, *found):
        joints = one.value["joints"]
        found[one.topic][one.at_ns] = [[joint.get(field, np.nan) for joint in joints] for field in JOINT_FIELDS]
    measured, commanded = found.values()
    times = sorted(measured.keys() & commanded.keys())  # the newest tick of a cut file may lack one
    if not times:
        raise AppError(ExportFault.NO_SAMPLES, path=path)
    values = np.array([measured[at_ns] + commanded[at_ns] for at_ns in times])
    return Samples(recording=recording, at_ns=np.array(times, dtype=np.int64), values=values)


def to_csv(samples: Samples, target: Path) -> None:
    """Comments with # first, then names, then a line a tick."""
    with target.open("w", encoding="utf-8", newline="") as file:
        file.writelines(f"# {name}: {text}\n" for name, text in samples.about.items())
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(samples.columns)
        writer.writerows(zip(*(column.tolist() for column in samples.columns.values()), strict=True))


def to_parquet(samples: Samples, target: Path) -> None:
    """Units and axes in the schema's metadata, each column's unit in its own."""
    import pyarrow
    from pyarrow import parquet

    fields = [
        pyarrow.field(name, pyarrow.int64() if name == "monotonic_ns" else pyarrow.float64(), metadata={"unit": unit})
        for name in samples.columns
        for unit in [unit_of(name)]
    ]
    schema = pyarrow.schema(fields, metadata={"rleex": json.dumps(samples.about)})
    parquet.write_table(pyarrow.table(list(samples.columns.values()), schema=schema), target)


def to_c3d(samples: Samples, target: Path) -> None:
    """Analogue channels at control's rate, as 32-bit floats, with labels, units and descriptions."""
    import ezc3d

    even = samples.at_rate()
    file = ezc3d.c3d()
    frames = len(even.at_ns)
    parameters = file["parameters"]
    parameters["POINT"]["RATE"]["value"] = [float(TICK_HZ)]
    parameters["POINT"]["FRAMES"]["value"] = [min(frames, 65535)]
    analog = parameters["ANALOG"]
    analog["RATE"]["value"] = [float(TICK_HZ)]
    analog["LABELS"]["value"] = list(COLUMNS)
    analog["UNITS"]["value"] = [unit_of(name) for name in COLUMNS]
    analog["DESCRIPTIONS"]["value"] = [ABOUT["axes"]] * len(COLUMNS)
    for name, text in samples.about.items():
        file.add_parameter("RLEEX", name.upper(), [text])
    file["data"]["points"] = np.zeros((4, 0, frames))
    file["data"]["analogs"] = even.values.reshape(1, frames, -1).transpose(0, 2, 1)
    file.write(str(target))


def to_opensim(samples: Samples, target: Path) -> None:
    """Angles as a .mot file, torques as a .sto file beside it, by the names of Rajagopal's model."""
    even = samples.at_rate()
    names = [COORDINATES[joint] for joint in JOINT_NAMES]
    _write_storage(target, even, names, even.values[:, 0])
    moments = [f"{name}_moment" for name in names]
    _write_storage(target.with_suffix(".sto"), even, moments, even.values[:, 2])


def to_mcap(source: Path, target: Path, deidentified: Deidentified | None = None) -> None:
    """A whole file of what can be read."""
    if target.exists():
        raise AppError(ExportFault.EXISTS, path=target)
    recording = Recording(path=source)
    found = messages(recording)
    topics: tuple[schemas.Topic, ...] = schemas.TOPICS
    shift_ns = 0
    if deidentified is not None:
        found, topics, shift_ns = deidentified.samples(recording, found), KEPT_TOPICS, deidentified.shift_ns
    first = next(found, None)  # the clock is known from then on
    if first is None:
        raise AppError(ExportFault.NO_SAMPLES, path=source)
    writer = RecordingWriter(target, topics, recording.clock_offset_ns + shift_ns)
    writer.add(first.topic, first.at_ns, first.data)
    for number, one in enumerate(found):
        writer.add(one.topic, one.at_ns, one.data)
        if number % 1000 == 0:
            writer.settle(one.at_ns)
    kept = {topic.name for topic in topics}
    writer.lost.update({topic: number for topic, number in recording.lost.items() if topic in kept})
    writer.finish()
    if writer.fault is not None:
        raise AppError(ExportFault.UNWRITABLE, path=target, detail=writer.fault)


FORMATS: dict[str, Callable[[Samples, Path], None]] = {
    "parquet": to_parquet,
    "csv": to_csv,
    "c3d": to_c3d,
    "opensim": to_opensim,
}
SUFFIXES = {"opensim": ".mot"}


def export(path: Path, form: str, folder: Path, deidentified: Deidentified | None = None) -> Path:
    """Write a recording in one format into a folder; the file. Raises AppError."""
    name = deidentified.name if deidentified else session_of(path)
    target = folder / f"{name}{SUFFIXES.get(form, f'.{form}')}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if form == "mcap":
            to_mcap(path, target, deidentified)
        else:
            FORMATS[form](replace(read_samples(path), deidentified=deidentified), target)
    except OSError as error:
        raise AppError(ExportFault.UNWRITABLE, path=target, detail=cause_of(error)) from error
    return target


def is_cut(path: Path) -> bool:
    """Whether a recording lacks its end, as after a crash. Raises AppError."""
    try:
        with open_recording(path) as file:
            file.seek(-len(MCAP0_MAGIC), os.SEEK_END)
            return file.read() != MCAP0_MAGIC
    except OSError as error:
        raise AppError(RecordingReadFault.UNREADABLE, path=path, detail=cause_of(error)) from error


def unit_of(column: str) -> str:
    """A column's unit, from its name."""
    ends = {"_rad_s": "rad/s", "_rad": "rad", "_nm": "Nm", "_ns": "ns", "_s": "s"}
    return next(unit for end, unit in ends.items() if column.endswith(end))


def _lost_joints(recording: Recording) -> str:
    """How many messages of the joints a recording lost, by topic: a cut file does not say."""
    if not recording.whole:
        return "unknown"
    lost = {topic: recording.lost.get(topic, 0) for topic in (schemas.JOINT_STATE, schemas.JOINT_SETPOINT)}
    return ", ".join(f"{topic} {number}" for topic, number in lost.items())


def _write_storage(target: Path, samples: Samples, names: list[str], values: NDArray[np.float64]) -> None:
    about = "; ".join(f"{name} {text}" for name, text in samples.about.items())
    head = [target.stem, "version=1", f"nRows={len(values)}", f"nColumns={len(names) + 1}", "inDegrees=no", about]
    with target.open("w", encoding="utf-8") as file:
        file.write("\n".join([*head, "endheader", "\t".join(["time", *names])]) + "\n")
        for at_s, row in zip(samples.time_s.tolist(), values.tolist(), strict=True):
            file.write("\t".join(map(repr, [at_s, *row])) + "\n")
