"""The patient form's fields as one table; what is typed becomes a profile, or a coded fault of a field. Pure."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from enum import Enum
from typing import Any

import msgspec

from app.system.config import JointsConfig, load_device
from logs.reason import Reason, reason, reason_of
from profiles.fields import file_key, to_file, unit_of, violations
from profiles.schema import DistanceUsed, GestureUsed, HandUsed, Population, Profile, Sex
from profiles.store import Check

MAX_SHOWN = 30  # characters of a wrong value that are quoted back


class Kind(Enum):
    """How a field is typed."""

    TEXT = "text"
    NUMBER = "number"
    OPTIONAL = "optional number"  # empty: not measured
    WHOLE = "whole number"
    CHOICE = "choice"
    CODES = "codes"  # some of the choices, with spaces between them


class FieldFault(Enum):
    """Why a field's text is no value."""

    EMPTY = "empty"
    NOT_A_NUMBER = "not a number"
    NOT_WHOLE = "not whole"
    UNKNOWN_CODE = "unknown code"
    UNKNOWN_UNIT = "unknown unit"


@dataclass(frozen=True, slots=True)
class Field:
    """One row of the form; `path` is the profile's dotted SI name."""

    path: str
    kind: Kind = Kind.NUMBER
    choices: type[Enum] | None = None

    @property
    def id(self) -> str:
        """As a widget's id."""
        return self.path.replace(".", "-")

    @property
    def unit(self) -> str:
        """As people see it."""
        return unit_of(self.path)


# Fields that belong together.
SECTIONS: dict[str, tuple[Field, ...]] = {
    "person": (
        Field("identifier", Kind.TEXT),
        Field("sex", Kind.CHOICE, Sex),
        Field("stature_m"),
        Field("mass_kg"),
        Field("hand", Kind.CHOICE, HandUsed),
        Field("vocabulary", Kind.CODES, GestureUsed),
        Field("note", Kind.TEXT),
    ),
    "palm": (
        Field("palm.population", Kind.CHOICE, Population),
        Field("palm.measured_width_m", Kind.OPTIONAL),
        Field("press_threshold_m"),
        Field("distance_source", Kind.CHOICE, DistanceUsed),
    ),
    "gait": (
        Field("gait.step_length_m"),
        Field("gait.swing_clearance_m"),
        Field("gait.step_time_s"),
        Field("gait.stair_rise_m"),
        Field("gait.stair_tread_m"),
        Field("gait.obstacle_height_m"),
        Field("gait.obstacle_depth_m"),
        Field("gait.chair_height_m"),
        Field("gait.transfer_time_s"),
        Field("gait.body_weight_support"),
        Field("gait.assist_left"),
        Field("gait.assist_right"),
    ),
    "dose": (Field("dose.steps", Kind.WHOLE), Field("dose.distance_m"), Field("dose.duration_s")),
    "legs": (
        Field("thigh_length_m", Kind.OPTIONAL),
        Field("shank_length_m", Kind.OPTIONAL),
        Field("hip_max_rad", Kind.OPTIONAL),
        Field("knee_max_rad", Kind.OPTIONAL),
    ),
}
FIELDS = tuple(field for fields in SECTIONS.values() for field in fields)

# What people may type behind a number, as a factor to the unit that the field is shown in.
_UNITS: dict[str, dict[str, float]] = {
    "cm": {"cm": 1.0, "mm": 0.1, "m": 100.0},
    "m": {"m": 1.0, "cm": 0.01},
    "°": {"°": 1.0, "deg": 1.0, "rad": math.degrees(1.0)},
    "kg": {"kg": 1.0, "g": 0.001},
    "s": {"s": 1.0, "ms": 0.001, "min": 60.0, "h": 3600.0},
    "": {"%": 0.01},
}
# A Chinese keyboard's digits, letters and signs of two cells, and its comma of lists.
_HALF_WIDTH = str.maketrans({wide: wide - 0xFEE0 for wide in range(0xFF01, 0xFF5F)} | {"、": ","})
_NUMBER = re.compile(r"([+-]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][+-]?\d{1,3})?)\s*(\D*)")


@dataclass(frozen=True, slots=True)
class Parsed:
    """The profile that was typed, or by path what is wrong with each field (then profile is None)."""

    profile: Profile | None
    errors: dict[str, Reason]


def to_texts(profile: Profile) -> dict[str, str]:
    """Each field's text by path, in the units of the form."""
    table = to_file(profile)
    return {field.path: _text(_dig(table, file_key(field.path)[0])) for field in FIELDS}


def parse(typed: dict[str, str], base: Profile) -> Parsed:
    """Texts by path to a profile; what has no text (calibrations, archived, a field that is absent) is `base`'s."""
    built = msgspec.to_builtins(base)
    errors: dict[str, Reason] = {}
    for field in FIELDS:
        if field.path not in typed:
            continue
        text = typed[field.path].strip()
        value = _codes(field, text) if field.kind is Kind.CODES else _value(field, text)
        if isinstance(value, Reason):
            errors[field.path] = value
        else:
            _put(built, field.path, value)
    profile = msgspec.convert(built, type=Profile)  # what can't be read has the value of `base` meanwhile
    errors = {_path_of(one.field): reason_of(one) for one in reversed(violations(profile))} | errors
    return Parsed(None if errors else profile, errors)


def half_width(text: str) -> str:
    """For what is read, never for what somebody has written: `１７０．５` means 170.5."""
    return text.translate(_HALF_WIDTH)


def _value(field: Field, text: str) -> str | float | Reason | None:
    """The SI value, or why there is none."""
    if field.path == "identifier" and not text:
        return reason(FieldFault.EMPTY)
    if field.kind in (Kind.TEXT, Kind.CHOICE):
        return text
    if not text:
        return None if field.kind is Kind.OPTIONAL else reason(FieldFault.EMPTY)
    number = _number(text, field.unit)
    if isinstance(number, Reason):
        return number
    if field.kind is Kind.WHOLE:
        return int(number) if number == int(number) else reason(FieldFault.NOT_WHOLE, text=_quoted(text))
    return number / file_key(field.path)[1]


def _codes(field: Field, text: str) -> list[str] | Reason:
    known = [str(one.value) for one in field.choices or ()]
    typed = half_width(text).replace(",", " ").split()
    unknown = next((one for one in typed if one not in known), None)
    if unknown is not None:
        return reason(FieldFault.UNKNOWN_CODE, text=_quoted(unknown), known=" ".join(known))
    return typed


def _number(text: str, unit: str) -> float | Reason:
    found = _NUMBER.fullmatch(half_width(text))
    if found is None:
        return reason(FieldFault.NOT_A_NUMBER, text=_quoted(text), unit=unit or "–")
    typed_unit = found[2].strip()
    factors = _UNITS[unit]
    if typed_unit and typed_unit not in factors:
        return reason(FieldFault.UNKNOWN_UNIT, unit=_quoted(typed_unit), known=", ".join(factors))
    number = float(found[1].replace(",", ".")) * (factors[typed_unit] if typed_unit else 1.0)
    if not math.isfinite(number):
        return reason(FieldFault.NOT_A_NUMBER, text=_quoted(text), unit=unit or "–")
    return number


def _quoted(text: str) -> str:
    printable = "".join(char if char.isprintable() else "?" for char in text[: MAX_SHOWN + 1])
    return printable if len(text) <= MAX_SHOWN else printable[:MAX_SHOWN] + "…"


def _text(value: Any) -> str:
    if value is None:
        return ""
    return f"{value:g}" if isinstance(value, float) else str(value)


def _dig(table: dict[str, Any], path: str) -> Any:
    value: Any = table
    for name in path.split("."):
        value = value.get(name) if isinstance(value, dict) else None
    return value


def _put(built: dict[str, Any], path: str, value: Any) -> None:
    *parents, last = path.split(".")
    for name in parents:
        built = built[name]
    built[last] = value


def _path_of(key: str) -> str:
    return next((field.path for field in FIELDS if file_key(field.path)[0] == key), key)


def fits(joints: JointsConfig) -> Check:
    """A check for the store: raises ProfileError with the first action that fails, its joint and numbers."""

    def check(profile: Profile) -> None:
        from app.motion.preflight import refuse_unfit  # the planner: not before the first paint

        if profile.archived:
            return
        device = load_device(joints)
        refuse_unfit(device)(profile)

    return check
