"""SI inside, centimetres and degrees in files: one rule on field names, applied to whole profiles.

`stature_m = 1.7` in the program is `stature_cm = 170` in a file. Distances walked stay in metres for people too.
"""

from __future__ import annotations

import difflib
import math
import types
import typing
from collections.abc import Mapping
from enum import Enum
from typing import Any

import msgspec
from msgspec import Struct

from profiles.errors import ProfileError

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
    if isinstance(held, tuple):
        return [_people(item, path, factor) for item in held]
    if isinstance(held, Enum):
        return held.value
    if isinstance(held, float) and factor != 1.0:
        return round(held * factor, _DIGITS)
    return held


def from_file(table: Mapping[str, Any], kind: type[Struct], prefix: str = "") -> dict[str, Any]:
    """A file's table as builtins in SI, for `msgspec.convert`. Raises ProfileError for a field that does not exist."""
    fields = {field.name: field.type for field in msgspec.structs.fields(kind)}
    by_key = {file_key(prefix + name)[0].removeprefix(prefix): name for name in fields}
    built: dict[str, Any] = {}
    for key, value in table.items():
        if key not in by_key:
            raise ProfileError(_unknown(prefix + key, [prefix + known for known in by_key]))
        name = by_key[key]
        built[name] = _si(value, fields[name], prefix + name)
    return built


def _si(value: Any, kind: Any, path: str) -> Any:
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


def _unknown(key: str, known: list[str]) -> str:
    close = difflib.get_close_matches(key, known, n=1, cutoff=0.7)
    advice = f"did you mean {close[0]}?" if close else f"the fields are {', '.join(known)}."
    return f"there is no field {key}: {advice}"
