"""SI inside, centimetres and degrees in files: one rule on field names, applied to whole profiles.

`stature_m = 1.7` in the program is `stature_cm = 170` in a file. Distances walked stay in metres for people too.
"""

from __future__ import annotations

import difflib
import math
import re
import types
import typing
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

import msgspec
from msgspec import Struct

from profiles.errors import ProfileError, ProfileFault
from profiles.schema import Calibration, GestureUsed, Profile

SUFFIXES = {"_m": ("_cm", 100.0, "cm"), "_rad": ("_deg", math.degrees(1.0), "°")}
KEPT_IN_METRES = frozenset({"dose.distance_m"})
UNITS = {"_m": "m", "_cm": "cm", "_deg": "°", "_kg": "kg", "_s": "s", "_px": "px"}
_DIGITS = 9  # a nanometre: hides the conversion's rounding, loses nothing that anyone measured


def file_key(path: str) -> tuple[str, float]:
    """The name of a dotted SI field in files, and the factor from the program's value to the file's."""
    if path not in KEPT_IN_METRES:
        for suffix, (people, factor, _) in SUFFIXES.items():
            if path.endswith(suffix):
                return path.removesuffix(suffix) + people, factor
    return path, 1.0


def unit_of(path: str) -> str:
    """The unit in which people see a dotted SI field, "" when it has none."""
    key, _ = file_key(path)
    return next((unit for suffix, unit in UNITS.items() if key.endswith(suffix)), "")


def to_file(value: Struct, prefix: str = "") -> dict[str, Any]:
    """A struct as nested tables in people's units; what is None is left out."""
    table: dict[str, Any] = {}
    for name in value.__struct_fields__:
        held = getattr(value, name)
        if held is None or held == ():
            continue
        path = prefix + name
        key, factor = file_key(path)
        table[key.removeprefix(prefix)] = _people(held, path, factor)
    return table


def _people(held: Any, path: str, factor: float) -> Any:
    if isinstance(held, Struct):
        return to_file(held, path + ".")
    if isinstance(held, tuple) and all(isinstance(item, Enum) for item in held):
        return " ".join(str(item.value) for item in held)
    if isinstance(held, tuple):
        return [_people(item, path, factor) for item in held]
    if isinstance(held, Enum):
        return held.value
    if isinstance(held, float) and factor != 1.0:
        return round(held * factor, _DIGITS)
    return held


def flat(table: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested tables as one, by dotted field."""
    fields: dict[str, Any] = {}
    for key, value in table.items():
        fields |= flat(value, f"{prefix}{key}.") if isinstance(value, Mapping) else {prefix + key: value}
    return fields


def changed(old: Mapping[str, Any], new: Mapping[str, Any], fields: Iterable[str]) -> dict[str, tuple[Any, Any]]:
    """Those of the fields that differ, in their order, with both values; None: absent."""
    return {field: (old.get(field), new.get(field)) for field in fields if old.get(field) != new.get(field)}


def from_file(table: Mapping[str, Any], kind: type[Struct], prefix: str = "") -> dict[str, Any]:
    """A file's table as builtins in SI, for `msgspec.convert`. Raises ProfileError for a field that does not exist."""
    fields = {field.name: field.type for field in msgspec.structs.fields(kind)}
    by_key = {file_key(prefix + name)[0].removeprefix(prefix): name for name in fields}
    built: dict[str, Any] = {}
    for key, value in table.items():
        if key not in by_key:
            raise _unknown(prefix + key, [prefix + known for known in by_key])
        name = by_key[key]
        built[name] = _si(value, fields[name], prefix + name)
    return built


def _si(value: Any, kind: Any, path: str) -> Any:
    if isinstance(value, str) and isinstance(kind, types.GenericAlias):  # as `_people` writes a tuple of codes
        return value.split()
    inner = _struct_in(kind)
    if inner is not None and isinstance(value, Mapping):
        return from_file(value, inner, path + ".")
    if inner is not None and isinstance(value, list):
        return [_si(item, inner, path) for item in value]
    _, factor = file_key(path)
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    return round(value / factor, _DIGITS + 2) if number and factor != 1.0 else value


def _struct_in(kind: Any) -> type[Struct] | None:
    """The struct that a field's type is made of, directly, in a tuple or in an optional."""
    if isinstance(kind, type) and issubclass(kind, Struct):
        return kind
    if isinstance(kind, types.GenericAlias | types.UnionType) or typing.get_origin(kind):
        return next((found for part in typing.get_args(kind) if (found := _struct_in(part))), None)
    return None


def _unknown(field: str, known: list[str]) -> ProfileError:
    close = difflib.get_close_matches(field, known, n=1, cutoff=0.7)
    if close:
        return ProfileError(ProfileFault.MISSPELT_FIELD, field=field, close=close[0])
    return ProfileError(ProfileFault.UNKNOWN_FIELD, field=field, known=", ".join(known))


IDENTIFIER = re.compile(r"[A-Za-z0-9](?:[A-Za-z0-9-]{0,38}[A-Za-z0-9])?")
WALK, WALK_END = GestureUsed.FIVE, GestureUsed.SIX  # as in `app.ipc.states.ACTION_OF`
NOTE_LIMIT = 2000  # characters

# Dotted field → lowest and highest value in people's units (file_key tells them), both allowed.
RANGES: dict[str, tuple[float, float]] = {
    "stature_m": (120, 220),  # adults, as in both anthropometric tables, with room
    "mass_kg": (30, 200),
    "palm.measured_width_m": (4, 16),  # the reference segment, 3 to 12 cm, is a fixed share of it
    "thigh_length_m": (25, 65),
    "shank_length_m": (25, 65),
    "press_threshold_m": (7, 40),  # the paper's hand is lost under 7 cm; a resting hand is at 25 to 60
    "hip_max_rad": (10, 130),
    "knee_max_rad": (10, 140),
    "gait.step_length_m": (5, 80),
    "gait.swing_clearance_m": (1, 20),
    "gait.step_time_s": (0.8, 10),
    "gait.stair_rise_m": (2, 25),
    "gait.stair_tread_m": (15, 45),
    "gait.obstacle_height_m": (1, 30),
    "gait.obstacle_depth_m": (1, 40),
    "gait.chair_height_m": (30, 70),
    "gait.transfer_time_s": (1.5, 20),
    "gait.body_weight_support": (0, 1),
    "gait.assist_left": (0, 1),
    "gait.assist_right": (0, 1),
    "dose.steps": (0, 20_000),
    "dose.distance_m": (0, 10_000),
    "dose.duration_s": (0, 4 * 3600),
}
REFERENCE_RANGE_CM = (3, 12)
CALIBRATION_RANGES: dict[str, tuple[float, float]] = {
    "focal_px": (50, 10_000),
    "distance_m": (10, 100),
    "residual": (0, 0.2),
    "width_px": (0, 10_000),
    "height_px": (0, 10_000),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Violation:
    """One field, as named in files, that is out of its range or means nothing: a fault and its values."""

    field: str
    code: ProfileFault
    values: Mapping[str, object]


def violations(profile: Profile) -> tuple[Violation, ...]:
    """Everything that is wrong with a profile, in the order of its fields; () when it is fine."""
    return tuple(_violations(profile))


def check(profile: Profile) -> Profile:
    """The profile itself. Raises ProfileError with the first violation."""
    for wrong in _violations(profile):
        raise ProfileError(wrong.code, **wrong.values)
    return profile


def _violations(profile: Profile) -> Iterator[Violation]:
    yield from _texts(profile)
    yield from _vocabulary(profile.vocabulary)
    for field, (low, high) in RANGES.items():
        if wrong := _outside(field, _get(profile, field), low, high):
            yield wrong
    for calibration in profile.calibrations:
        yield from _calibration(calibration)


def _texts(profile: Profile) -> Iterator[Violation]:
    if profile.schema != 1:
        yield Violation(field="schema", code=ProfileFault.SCHEMA, values={"schema": profile.schema})
    if not IDENTIFIER.fullmatch(profile.identifier):
        values = {"identifier": profile.identifier}
        yield Violation(field="identifier", code=ProfileFault.IDENTIFIER, values=values)
    if len(profile.note) > NOTE_LIMIT:
        length = {"count": len(profile.note), "limit": NOTE_LIMIT}
        yield Violation(field="note", code=ProfileFault.NOTE_LENGTH, values=length)
    if any(not (char.isprintable() or char in "\n\t") for char in profile.note):
        yield Violation(field="note", code=ProfileFault.NOTE_CONTROL, values={})


def _vocabulary(gestures: tuple[GestureUsed, ...]) -> Iterator[Violation]:
    """A walk goes on by itself: who may begin one by gesture must be able to end it by gesture."""
    if not gestures:
        yield Violation(field="vocabulary", code=ProfileFault.VOCABULARY_EMPTY, values={})
    twice = next((one for place, one in enumerate(gestures) if one in gestures[:place]), None)
    if twice is not None:
        yield Violation(field="vocabulary", code=ProfileFault.VOCABULARY_TWICE, values={"gesture": twice.value})
    if WALK in gestures and WALK_END not in gestures:
        values = {"walk": WALK.value, "end": WALK_END.value}
        yield Violation(field="vocabulary", code=ProfileFault.WALK_WITHOUT_END, values=values)


def _calibration(calibration: Calibration) -> Iterator[Violation]:
    for field, (low, high) in CALIBRATION_RANGES.items():
        if wrong := _outside(field, _get(calibration, field), low, high, group="calibrations."):
            yield wrong
    if calibration.focal_px > 0:
        reference_m = calibration.focal_anchor_px_m / calibration.focal_px
        if wrong := _outside("reference_m", reference_m, *REFERENCE_RANGE_CM, group="calibrations."):
            yield replace(wrong, field="calibrations.focal_anchor_px_cm")


def _outside(field: str, value: float | None, low: float, high: float, *, group: str = "") -> Violation | None:
    if value is None:
        return None
    key, factor = file_key(field)
    shown = round(value * factor, 6)
    if low <= shown <= high:  # false for NaN
        return None
    unit = unit_of(field)
    values = {"field": group + key, "value": shown, "low": low, "high": high}
    return Violation(
        field=group + key,
        code=ProfileFault.OUT_OF_RANGE,
        values=values | {"unit": f" {unit}" if unit and unit != "°" else unit},
    )


def _get(value: Struct, field: str) -> Any:
    held: Any = value
    for name in field.split("."):
        held = getattr(held, name)
    return held
