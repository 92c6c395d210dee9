"""A recording in other people's formats: Parquet, CSV, C3D, OpenSim's motion and storage files, MCAP joined and whole.

Every file says its units and axes. Angles in radians at the joint, hip and knee flexion positive, standing = 0;
torques in Nm in the same direction.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.recording import schemas
from app.recording.deidentify import KEPT_TOPICS, Deidentified
from app.recording.read import CUT, Recording, messages, session_of
from app.recording.samples import ABOUT, COLUMNS, ExportFault, Samples, read_samples, unit_of
from app.recording.writer import RecordingWriter
from app.system.errors import AppError
from app.system.files import partial_file
from app.system.paths import PICTURES_SUFFIX
from hal.joints.device import JOINT_NAMES
from hal.joints.protocol import TICK_HZ
from logs.reading.errors import cause_of

# The coordinates of Rajagopal's full-body model (2016), whose hips and knees flex positive as ours do.
COORDINATES = {
    "left_hip": "hip_flexion_l",
    "left_knee": "knee_angle_l",
    "right_hip": "hip_flexion_r",
    "right_knee": "knee_angle_r",
}

C3D_FRAMES = 65535  # at most, in a C3D file
C3D_A_FRAME = 100  # samples in a frame of a long file
SLICE_TICKS = 1000  # written at a time: as Python's numbers an hour takes gigabytes


def to_csv(samples: Samples, target: Path) -> None:
    """Comments with # first, then names, then a line a tick."""
    with target.open("w", encoding="utf-8", newline="") as file:
        file.writelines(f"# {name}: {text}\n" for name, text in samples.about.items())
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(samples.columns)
        columns = list(samples.columns.values())
        for some in _slices(len(samples.at_ns)):
            writer.writerows(zip(*(column[some].tolist() for column in columns), strict=True))


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
    """Analogue channels at control's rate, as 32-bit floats, with labels, units and descriptions. Raises AppError.

    C3D counts frames in 16 bits. There are no points, so a longer recording has fewer frames of more samples each.
    """
    import ezc3d

    even = samples.at_rate()
    ticks = len(even.at_ns)
    a_frame = 1 if ticks <= C3D_FRAMES else C3D_A_FRAME
    frames = -(-ticks // a_frame)
    if frames > C3D_FRAMES:
        raise AppError(
            ExportFault.TOO_LONG, path=samples.recording.path, hours=C3D_FRAMES * C3D_A_FRAME / TICK_HZ / 3600
        )
    file = ezc3d.c3d()
    parameters = file["parameters"]
    parameters["POINT"]["RATE"]["value"] = [TICK_HZ / a_frame]
    parameters["POINT"]["FRAMES"]["value"] = [frames]
    analog = parameters["ANALOG"]
    analog["RATE"]["value"] = [float(TICK_HZ)]
    analog["LABELS"]["value"] = list(COLUMNS)
    analog["UNITS"]["value"] = [unit_of(name) for name in COLUMNS]
    analog["DESCRIPTIONS"]["value"] = [ABOUT["axes"]] * len(COLUMNS)
    for name, text in (samples.about | {"samples": str(ticks)}).items():
        file.add_parameter("RLEEX", name.upper(), [text])
    values = np.full((1, len(COLUMNS), frames * a_frame), np.nan)
    values[0, :, :ticks] = even.values.reshape(ticks, -1).T
    file["data"]["points"] = np.zeros((4, 0, frames))
    file["data"]["analogs"] = values
    file.write(str(target))


def to_motion(samples: Samples, target: Path) -> None:
    """Angles in OpenSim's format, by the names of Rajagopal's model."""
    even = samples.at_rate()
    _write_storage(target, even, [COORDINATES[joint] for joint in JOINT_NAMES], even.values[:, 0])


def to_storage(samples: Samples, target: Path) -> None:
    """Torques in OpenSim's format, the same."""
    even = samples.at_rate()
    _write_storage(target, even, [f"{COORDINATES[joint]}_moment" for joint in JOINT_NAMES], even.values[:, 2])


def to_mcap(source: Path, target: Path, deidentified: Deidentified | None = None) -> Recording:
    """A whole file of what can be read; the recording as far as it was read."""
    if target.exists():
        raise AppError(ExportFault.EXISTS, path=target)
    recording = Recording(path=source)
    found = messages(recording)
    topics: tuple[schemas.Topic, ...] = schemas.TOPICS
    if deidentified is not None:
        found, topics = deidentified.samples(recording, found), KEPT_TOPICS
    first = next(found, None)  # the clock is known from then on
    if first is None:
        raise AppError(ExportFault.NO_SAMPLES, path=source)
    with partial_file(target) as partial:
        writer = RecordingWriter(partial, topics, 0 if deidentified else recording.clock_offset_ns)
        writer.add(first.topic, first.at_ns, first.data)
        for number, one in enumerate(found):
            writer.add(one.topic, one.at_ns, one.data)
            if number % 1000 == 0:
                writer.settle(one.at_ns)
        kept = {topic.name for topic in topics}
        writer.lost.update({topic: number for topic, number in recording.lost.items() if topic in kept})
        if not recording.complete:
            writer.source_damage = recording.damage or recording.source_damage or CUT
        writer.finish()
        if writer.fault is not None:
            raise AppError(ExportFault.UNWRITABLE, path=target, detail=writer.fault)
        partial.replace(target)
    return recording


def to_tables(samples: Samples, writers: dict[Path, Callable[[Samples, Path], None]]) -> None:
    """Each file by its writer: all of them or none."""
    with ExitStack() as stack:
        partials = {target: stack.enter_context(partial_file(target)) for target in writers}
        for target, write in writers.items():
            write(samples, partials[target])
        for target, partial in partials.items():
            partial.replace(target)


FORMATS: dict[str, dict[str, Callable[[Samples, Path], None]]] = {  # by suffix
    "parquet": {".parquet": to_parquet},
    "csv": {".csv": to_csv},
    "c3d": {".c3d": to_c3d},
    "opensim": {".mot": to_motion, ".sto": to_storage},
}


@dataclass(frozen=True, slots=True)
class Exported:
    """The files that were written, and the recording as far as it was read."""

    files: tuple[Path, ...]
    recording: Recording


def export(path: Path, form: str, folder: Path, deidentified: Deidentified | None = None) -> Exported:
    """Write a recording in one format into a folder; nothing is left of an export that fails. Raises AppError."""
    if path.name.endswith(PICTURES_SUFFIX):
        raise AppError(ExportFault.PICTURES, path=path)
    name = deidentified.name if deidentified else session_of(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if form == "mcap":
            target = folder / f"{name}.mcap"
            return Exported((target,), to_mcap(path, target, deidentified))
        writers = {folder / f"{name}{suffix}": write for suffix, write in FORMATS[form].items()}
        samples = read_samples(path)
        if deidentified is not None:
            samples = samples.deidentified_by(deidentified)
        to_tables(samples, writers)
    except OSError as error:
        raise AppError(ExportFault.UNWRITABLE, path=folder / name, detail=cause_of(error)) from error
    return Exported(tuple(writers), samples.recording)


def _write_storage(target: Path, samples: Samples, names: list[str], values: NDArray[np.float64]) -> None:
    about = "; ".join(f"{name} {text}" for name, text in samples.about.items())
    size = f"nRows={len(values)}", f"nColumns={len(names) + 1}"
    head = [samples.about["session"], "version=1", *size, "inDegrees=no", about]
    with target.open("w", encoding="utf-8") as file:
        file.write("\n".join([*head, "endheader", "\t".join(["time", *names])]) + "\n")
        time_s = samples.time_s
        for some in _slices(len(values)):
            for at_s, row in zip(time_s[some].tolist(), values[some].tolist(), strict=True):
                file.write("\t".join(map(repr, [at_s, *row])) + "\n")


def _slices(ticks: int) -> list[slice]:
    return [slice(first, first + SLICE_TICKS) for first in range(0, ticks, SLICE_TICKS)]
