"""The joints of a recording, tick by tick, as one array with units and axes."""

from __future__ import annotations

from array import array
from dataclasses import dataclass, replace
from enum import Enum, auto
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from app.recording import schemas
from app.recording.deidentify import Deidentified
from app.recording.read import Recording, messages, session_of
from app.recording.schemas import JOINT_FIELDS
from app.system.errors import AppError
from hal.joints.device import JOINT_NAMES, Joint
from hal.joints.protocol import TICK_NS

QUANTITIES = ("position_rad", "velocity_rad_s", "torque_nm", "target_rad", "target_velocity_rad_s", "feedforward_nm")
COLUMNS = tuple(f"{joint}_{quantity}" for quantity in QUANTITIES for joint in JOINT_NAMES)
ABOUT = {
    "axes": "angles at the joint; hip and knee flexion positive, standing = 0; torques in the same direction",
    "units": "in each column's name: rad, rad/s, Nm, s",
    "time": "time_s: since the first sample; monotonic_ns + wall_minus_monotonic_ns = UTC since 1970",
    "missing": "NaN: not measured; of a target: the joint is held nowhere, off or damped",
}
DATES_SHIFTED = {"dates": "shifted by whole days, the same for all sessions of a patient; monotonic_ns: such a UTC"}
_decode = msgspec.json.Decoder(schemas.JointStates).decode


class ExportFault(Enum):
    """Why a recording is not exported."""

    NO_SAMPLES = auto()  # path
    EXISTS = auto()  # path
    PICTURES = auto()  # path
    UNWRITABLE = auto()  # path, detail
    TOO_LONG = auto()  # path, hours


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
        clock_ns = 0 if deidentified else recording.clock_offset_ns
        found = {"session": session, "whole": str(recording.complete).lower(), "lost": _lost_joints(recording)} | ABOUT
        return found | {"wall_minus_monotonic_ns": str(clock_ns)} | (DATES_SHIFTED if deidentified else {})

    def deidentified_by(self, how: Deidentified) -> Samples:
        """With its name, and at the shifted UTC."""
        return replace(self, deidentified=how, at_ns=self.at_ns + self.recording.clock_offset_ns + how.shift_ns)

    def at_rate(self) -> Samples:
        """On a grid of control's rate, for formats without times: each tick's newest sample, late ones held."""
        ticks = round((int(self.at_ns[-1]) - int(self.at_ns[0])) / TICK_NS) + 1
        grid_ns = self.at_ns[0] + np.arange(ticks, dtype=np.int64) * TICK_NS
        newest = np.searchsorted(self.at_ns, grid_ns + TICK_NS // 2, side="right") - 1
        return replace(self, at_ns=grid_ns, values=self.values[newest])


def read_samples(path: Path) -> Samples:
    """Measured and commanded joints, tick by tick. Raises AppError."""
    recording = Recording(path=path)
    topics = schemas.JOINT_STATE, schemas.JOINT_SETPOINT
    found = {topic: (array("q"), array("d")) for topic in topics}  # an hour is 1.8 million samples of each
    for one in messages(recording, *topics):
        times, values = found[one.topic]
        joints = _decode(one.data).joints
        times.append(one.at_ns)
        for field in JOINT_FIELDS:
            of_joints = (getattr(joint, field) for joint in joints)
            values.extend(np.nan if value is msgspec.UNSET else value for value in of_joints)
    (measured_ns, measured), (commanded_ns, commanded) = (
        (np.frombuffer(times, np.int64), np.frombuffer(values).reshape(-1, len(JOINT_FIELDS), len(Joint)))
        for times, values in found.values()
    )
    # The newest tick of a cut file may lack one.
    at_ns, first, second = np.intersect1d(measured_ns, commanded_ns, return_indices=True)
    if not len(at_ns):
        raise AppError(ExportFault.NO_SAMPLES, path=path)
    return Samples(recording=recording, at_ns=at_ns, values=np.hstack((measured[first], commanded[second])))


def unit_of(column: str) -> str:
    """A column's unit, from its name."""
    ends = {"_rad_s": "rad/s", "_rad": "rad", "_nm": "Nm", "_ns": "ns", "_s": "s"}
    return next(unit for end, unit in ends.items() if column.endswith(end))


def _lost_joints(recording: Recording) -> str:
    """How many messages of the joints a recording lost, by topic: a cut file does not say."""
    if not recording.complete:
        return "unknown"
    lost = {topic: recording.lost.get(topic, 0) for topic in (schemas.JOINT_STATE, schemas.JOINT_SETPOINT)}
    return ", ".join(f"{topic} {number}" for topic, number in lost.items())
